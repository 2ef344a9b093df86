"""People who edit, move or remove a run folder while a launch is at work in it."""

import os
from pathlib import Path

import pytest

from analysis.reading.results import load
from launch.folder import lock, results
from launch.folder.layout import RunFolder
from launch.jobs import recorder
from tests.launch.lives import TASK, live, outcome, tiny

__all__ = ["tiny"]

WORDS = ("--seeds=2", "--subgoal_layers=1", "--periods=2", "--workers=1")


def before_period(number: int, disturb):
    """What makes somebody disturb the folder before the rows of that period are added."""

    def patch() -> None:
        add = recorder.Recorder.add

        def disturbed(self, job, rows):
            if rows[0]["period"] == number:
                disturb(self.folders[TASK])
            add(self, job, rows)

        recorder.Recorder.add = disturbed  # type: ignore[method-assign]

    return patch


def take_the_last_newline(folder: RunFolder) -> None:
    folder.results.write_bytes(folder.results.read_bytes().rstrip(b"\n"))


def test_rows_are_not_glued_where_an_editor_took_the_last_newline(tmp_path, tiny):
    assert live(tmp_path / "whole", *WORDS)[0] == 0
    status, printed = live(tmp_path / "here", *WORDS, first=before_period(1, take_the_last_newline))
    assert status == 0, printed
    assert len(load(tmp_path / "here" / TASK)) == 2 * 3
    assert outcome(tmp_path / "here") == outcome(tmp_path / "whole")


def replace(folder: RunFolder) -> None:
    """Another launch in the place of a folder that was moved away."""
    folder.path.rename(folder.path.with_name("away"))
    with RunFolder(folder.path.parent, TASK).lock():
        pass


def remove_the_folder(folder: RunFolder) -> None:
    folder.path.rename(folder.path.with_name("away"))


def remove_the_header(folder: RunFolder) -> None:
    folder.results.write_bytes(folder.results.read_bytes().split(b"\n", 1)[1])


def empty(folder: RunFolder) -> None:
    folder.results.write_bytes(b"")


def remove_the_file(folder: RunFolder) -> None:
    folder.results.unlink()


@pytest.mark.parametrize(
    ("disturb", "said"),
    [
        (replace, "was moved, removed or replaced while a launch was using it"),
        (remove_the_folder, "was moved, removed or replaced"),
        (remove_the_header, "lost its header while a launch was using it"),
        (empty, "lost its header"),
        (remove_the_file, "No such file"),
    ],
)
def test_a_launch_stops_in_one_line_rather_than_write_into_what_is_not_its_own(
    tmp_path, tiny, disturb, said
):
    status, printed = live(tmp_path, *WORDS, first=before_period(1, disturb))
    assert status == 1 and "Traceback" not in printed, printed
    (line,) = [line for line in printed.splitlines() if line.startswith("error: ")]
    assert said in line and "finished results are kept" in line
    if disturb is replace:
        assert [file.name for file in (tmp_path / TASK).iterdir()] == [lock.NAME]
    if disturb in (empty, remove_the_file):  # all rows come back from the checkpoints
        status, printed = live(tmp_path, *WORDS)
        assert status == 0 and len(load(tmp_path / TASK)) == 2 * 3, printed


def test_a_folder_that_is_replaced_between_opening_and_locking_is_noticed(tmp_path, monkeypatch):
    def replaced(file, kind) -> None:
        os.replace(tmp_path / "other", tmp_path / lock.NAME)

    (tmp_path / "other").touch()
    monkeypatch.setattr(lock.fcntl, "flock", replaced)
    with pytest.raises(lock.FolderTaken), lock.held(tmp_path):
        pass


def test_rows_of_a_table_without_a_header_are_refused(tmp_path: Path):
    file = tmp_path / "results.csv"
    file.write_text("a,b\n1,2\n")
    with pytest.raises(results.Changed, match="lost its header"):
        results.append(file, [])
