"""An installation that is not editable finds its MJCF files too."""

from pathlib import Path

import setuptools
from setuptools.config import pyprojecttoml

ROOT = Path(__file__).resolve().parents[2]


def test_every_mjcf_file_is_installed_beside_the_tasks(monkeypatch):
    monkeypatch.chdir(ROOT)
    distribution = setuptools.Distribution()
    pyprojecttoml.apply_configuration(distribution, ROOT / "pyproject.toml")
    distribution.include_package_data = False  # looking for more would write metadata
    build = distribution.get_command_obj("build_py")
    build.ensure_finalized()
    installed = {
        Path(*package.split("."), file)
        for package, _, _, files in build.data_files
        for file in files
    }
    assert installed == {path.relative_to(ROOT) for path in (ROOT / "assets").rglob("*.xml")}
    assert installed and "tasks" in distribution.packages
