"""A disk that fails now and then, as full and remote ones do: nothing finished is ever lost.

Every call that makes, replaces, locks or removes a file can fail; the launch itself is real.
"""

import errno
import fcntl
import os
import random
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from launch import experiment
from launch.asking import request
from launch.folder import states
from launch.folder.layout import RunFolder
from launch.jobs import checkpointing
from tests.launch.jobs.test_kills import finished
from tests.launch.lives import TASK, USUAL, fallen_back, live, outcome, standings, tiny
from tests.test_soak import memory, open_files

__all__ = ["tiny"]

WORDS = ("--seeds=2", "--subgoal_layers=0,1", "--periods=3", "--workers=1")
# What a full disk, one with errors, a remote one and a quota answer.
ANSWERS = (errno.ENOSPC, errno.EIO, errno.ESTALE, errno.ENOLCK, errno.EDQUOT, errno.EACCES)
CALLS = ((os, "replace"), (os, "fsync"), (os, "unlink"), (os, "mkdir"), (os, "open"),
         (fcntl, "flock"))  # fmt: skip


def failing(below: Path, log: Path, seed: int, share: float) -> Callable[[], None]:
    """What makes a share of a process's calls fail; each is noted by a byte in the log."""

    def patch() -> None:
        chance, noted = random.Random(seed), os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)

        def faulty(call: Callable[..., Any]) -> Callable[..., Any]:
            def called(target: Any, *args: Any, **keywords: Any) -> Any:
                # Of calls that name a path, only those that are about the run folders.
                ours = not isinstance(target, str | Path) or str(target).startswith(str(below))
                if ours and chance.random() < share:
                    os.write(noted, b"x")
                    raise OSError(chance.choice(ANSWERS), "the disk fails")
                return call(target, *args, **keywords)

            return called

        for module, name in CALLS:
            setattr(module, name, faulty(getattr(module, name)))

    return patch


class Storm(NamedTuple):
    """What a storm of faults did."""

    faults: int
    launches: int
    lost: int  # runs that stood further back than before


def storm(tmp_path: Path, faults: int, chance: random.Random) -> Storm:
    """Launches on a failing disk, again and again, then on a whole one, until enough has failed.

    What is on the disk never gets less, and the whole launch leaves what one without faults does.
    """
    log, launches, lost, folders = tmp_path / "faults", 0, 0, 0
    status, printed = live(tmp_path / "whole", *WORDS)
    assert status == 0, printed
    expected = outcome(tmp_path / "whole")
    log.touch()
    while log.stat().st_size < faults:
        here, before = tmp_path / f"storm{folders}", dict[str, int]()
        for _ in range(4):
            share = chance.choice([0.01, 0.05, 0.2])
            status, printed = live(here, *WORDS, first=failing(here, log, launches, share))
            assert status in (0, 1, 2), printed
            assert "Traceback" not in printed, printed
            now = standings(here) | finished(here)
            lost += fallen_back(before, now)
            before, launches = now, launches + 1
        status, printed = live(here, *WORDS)
        assert status == 0, printed
        assert outcome(here) == expected, folders
        folders += 1
    return Storm(log.stat().st_size, launches, lost)


@pytest.mark.slow
def test_a_disk_that_fails_now_and_then(tmp_path, tiny):
    assert storm(tmp_path, 8, random.Random(0)).lost == 0


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_thousand_faults_lose_nothing(tmp_path, tiny):
    seen = storm(tmp_path, 1000, random.Random(1))
    print(seen)
    assert seen.faults >= 1000 and seen.lost == 0


def on_disk(checkpoints: Path) -> tuple[int, int]:
    """How many files there are, and bytes of the tensors: beside them are the rows of all periods,
    which are more each period.
    """
    files = [file for file in checkpoints.rglob("*") if file.is_file()]
    return len(files), sum(f.stat().st_size for f in files if f.suffix == ".safetensors")


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_day_of_checkpoints_resumes_and_status_calls(tmp_path, tiny, monkeypatch):
    """A day has 288 checkpoints, one in five minutes; here every tenth ends a launch.

    The clock on the wall jumps, to and fro.
    """
    folder, saved, measured = RunFolder(tmp_path, TASK), [0], []
    at_boundary, now, chance = checkpointing.Saver.at_boundary, time.time, random.Random(0)

    def stopping(self, boundary):
        saved[0] += 1
        if saved[0] % 10 == 0:
            self.stop()
        at_boundary(self, boundary)
        states.read(folder.path)

    monkeypatch.setattr(checkpointing.Saver, "at_boundary", stopping)
    monkeypatch.setattr(time, "time", lambda: now() + chance.uniform(-1e5, 1e5))
    words = ["launch/run.py", *USUAL, f"--out={tmp_path}", "--seeds=1", "--subgoal_layers=1",
             "--periods=300"]  # fmt: skip
    while saved[0] < 2 * 288:
        with pytest.raises(SystemExit, match="the checkpoint holds all until here"):
            experiment.run(request.parse(words), words)
        measured.append((memory(), open_files(), *on_disk(folder.checkpoints)))
        assert not list(folder.path.rglob(".*.tmp*"))
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    quarter, end = measured[len(measured) // 4], measured[-1]
    print(saved[0], "checkpoints; memory grew by", end[0] - measured[0][0], "MiB")
    assert end[0] - quarter[0] < 8, "memory grew"
    assert end[1] == quarter[1], "descriptors are left open"
    assert end[2] == quarter[2], "there are more and more checkpoints"
    assert end[3] <= quarter[3], "checkpoints take more and more of the disk"
