"""An installation that is not editable finds its MJCF files and policies too."""

import os
import subprocess
import sys
from pathlib import Path

import setuptools
from setuptools.config import pyprojecttoml

ROOT = Path(__file__).resolve().parents[2]


def test_every_asset_is_installed_beside_the_tasks(monkeypatch):
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
        if package.startswith("assets")
    }
    assets = {path.relative_to(ROOT) for path in (ROOT / "assets").rglob("*") if path.is_file()}
    assert installed == assets
    assert {path.suffix for path in assets} == {".xml", ".json", ".safetensors"}
    assert {"tasks", "launch.configs"} <= set(distribution.packages)


def test_importing_the_tasks_without_a_display_warns_of_nothing():
    hidden = {"DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL", "PYOPENGL_PLATFORM"}
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    done = subprocess.run(
        [sys.executable, "-c", "import tasks"],
        cwd=ROOT, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
