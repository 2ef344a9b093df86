"""Users with few rights: what may not be written is named, and what may be is written for all."""

import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from launch.folder.layout import RunFolder
from tests.launch.lives import TASK, live, outcome, tiny

__all__ = ["tiny"]

WORDS = ("--subgoal_layers=1", "--periods=2", "--workers=1")
NOBODY = 65534


@pytest.fixture
def open_to_all() -> Iterator[Path]:
    """A folder in which every user may read and nobody else may write; pytest's are closed."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    yield folder
    shutil.rmtree(folder)


def become_nobody() -> None:
    """Gives up all rights, in a launch's process; a user who has none already stays the same."""
    if os.getuid() == 0:
        os.setgroups([])
        os.setgid(NOBODY)
        os.setuid(NOBODY)


def permissions(out: Path) -> dict[Path, int]:
    return {file: stat.S_IMODE(file.stat().st_mode) for file in out.rglob("*")}


def test_under_a_closed_umask_a_launch_goes_on_and_nobody_else_may_read(tmp_path, tiny):
    assert live(tmp_path / "whole", *WORDS, "--seeds=2")[0] == 0
    here = tmp_path / "here"
    for seeds in ("--seeds=1", "--seeds=2"):
        status, printed = live(here, *WORDS, seeds, first=lambda: os.umask(0o077))
        assert status == 0, printed
    assert outcome(here) == outcome(tmp_path / "whole")
    assert not any(mode & 0o077 for mode in permissions(here / TASK).values())


def test_a_user_without_rights_trains_in_a_folder_of_their_own(open_to_all, tiny):
    own = open_to_all / "own"
    own.mkdir()
    if os.getuid() == 0:
        os.chown(own, NOBODY, NOBODY)
    status, printed = live(own, *WORDS, "--seeds=2", first=become_nobody)
    assert status == 0, printed
    assert len(outcome(own)["rows"]) == 2 * 3


def test_in_a_folder_of_others_one_line_says_so_and_nothing_changes(open_to_all, tiny):
    assert live(open_to_all, *WORDS, "--seeds=1")[0] == 0
    folder = RunFolder(open_to_all, TASK)
    before = {file: file.read_bytes() for file in folder.path.rglob("*.*") if file.is_file()}
    if os.getuid():
        for place in [folder.path, *folder.path.rglob("*")]:
            place.chmod(0o555 if place.is_dir() else 0o444)
    for out in (open_to_all, open_to_all / "new"):
        if os.getuid():
            open_to_all.chmod(0o555)
        status, printed = live(out, *WORDS, "--seeds=2", first=become_nobody)
        assert status == 2 and "Permission denied" in printed, printed
        assert printed.startswith("error: ") and printed.count("\n") == 1, printed
    for place in [open_to_all, *folder.path.rglob("*")]:
        place.chmod(0o755)
    assert before == {file: file.read_bytes() for file in before}
    assert not (open_to_all / "new").exists()
