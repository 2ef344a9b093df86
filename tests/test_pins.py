"""Every version that `make setup` installs is pinned, and so is each file by its hash."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent


def pinned(file: str) -> dict[str, str]:
    """The version of every package that a file pins."""
    lines = re.findall(r"^([\w.-]+)==(\S+)", (ROOT / file).read_text(), flags=re.MULTILINE)
    return {canonicalize_name(name): version for name, version in lines}


def declared() -> list[Requirement]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"].values()
    return [Requirement(line) for part in (project["dependencies"], *extras) for line in part]


def test_hashes_are_of_the_pinned_versions_and_torch_comes_in_several_builds():
    pins = pinned("constraints.txt")
    assert pins.pop("torch") == "2.13.0"
    assert pinned("hashes.txt") == pins


def test_every_pinned_package_has_a_hash():
    text = (ROOT / "hashes.txt").read_text()
    entries = re.split(r"\n(?=\S)", text.strip())
    assert len(entries) == len(pinned("hashes.txt"))
    for entry in entries:
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", entry), entry


@pytest.mark.parametrize("requirement", declared(), ids=str)
def test_what_is_declared_is_bounded_and_pinned_within_its_bounds(requirement):
    assert any(spec.operator in ("<", "==") for spec in requirement.specifier), "no upper bound"
    assert requirement.specifier.contains(
        pinned("constraints.txt")[canonicalize_name(requirement.name)]
    )
