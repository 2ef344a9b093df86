"""A pipe, a folder, a device or gigabytes in the place of a file: named, never waited for."""

import os
import shutil
from pathlib import Path

import pytest

from analysis.program import CommandError
from launch.folder import states
from launch.folder.layout import RunFolder
from tests.cases import some_slow
from tests.launch.lives import TASK, live, tiny, tiny_task

__all__ = ["tiny"]

WORDS = ("--seeds=1", "--subgoal_layers=0", "--workers=1")
STEM = f"{TASK}_0layers_seed0"
FILES = {
    "manifest.json": 2,
    "results.csv": 2,
    ".lock": 2,
    f"policies/{STEM}.json": 0,
    f"policies/{STEM}.safetensors": 0,
    f"checkpoints/{STEM}/000000012.json": 2,
    f"checkpoints/{STEM}/000000012.safetensors": 2,
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        tiny_task(patch)
        out = tmp_path_factory.mktemp("finished")
        assert live(out, *WORDS, "--periods=1")[0] == 0
        return out


def pipe(file: Path) -> None:
    os.mkfifo(file)


def folder(file: Path) -> None:
    file.mkdir()


def device(file: Path) -> None:
    file.symlink_to("/dev/zero")


def gigabytes(file: Path) -> None:
    with file.open("wb") as opened:
        opened.truncate(3 * 2**30)  # of nothing: they take no room


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("strange", some_slow((pipe, folder, device, gigabytes), gigabytes))
def test_what_is_no_small_file_is_answered_at_once(finished, tmp_path, tiny, strange, name):
    if strange is gigabytes and name.endswith(".safetensors") and "checkpoints" in name:
        pytest.skip("a checkpoint may be as large")
    out = tmp_path / "out"
    shutil.copytree(finished, out)
    file = RunFolder(out, TASK).path / name
    file.unlink()
    strange(file)
    try:
        states.read(file.parents[name.count("/")])
    except CommandError as error:
        assert "\n" not in str(error) and file.name in str(error)
    status, printed = live(out, *WORDS, "--periods=2", kill_after=100)
    assert "Traceback" not in printed and "Error" not in printed, printed
    if strange is gigabytes and name == ".lock":
        assert status == 0  # it is written anew
    elif FILES[name]:
        assert status == 2 and file.name in printed and len(printed.splitlines()) == 1, printed
    else:  # the final state is whole: all comes back from it
        assert status in (0, 1, 2), printed
