"""Launches on a tiny task, each in a forked process that can be killed at any moment.

Everything from the words of the command to results.csv is real, but for the task, the pictures and
the worker processes: jobs run one after the other in the launch's own process, and save themselves
at every boundary.
"""

import contextlib
import functools
import math
import os
import select
import signal
import sys
import time
import types
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest

import tasks
from analysis import program
from analysis.reading import schema
from launch import experiment
from launch.asking import request
from launch.folder import manifest
from launch.folder.layout import RunFolder
from launch.jobs import checkpointing, recorder
from launch.jobs.messages import Finished, Started
from launch.pictures import summary
from tests.hac_suite.tiny_envs import PointEnv

TASK = "pendulum_climb"
MAX_STEPS = 20
USUAL = (
    f"--task={TASK}", "--novideo", "--config.episodes_per_period=12", "--config.test_episodes=2",
    "--config.updates_per_episode=1", "--config.batch_size=16", "--config.hidden_sizes=(8,8)",
    "--config.replay_capacity=300",
)  # fmt: skip


@pytest.fixture
def tiny(monkeypatch) -> None:
    tiny_task(monkeypatch)


def tiny_task(monkeypatch: pytest.MonkeyPatch) -> None:
    """Puts the tiny task in place of the real one."""
    found, find = types.SimpleNamespace(name=TASK, word=TASK), tasks.find
    found.load_vector = functools.partial(PointEnv, max_steps=MAX_STEPS)
    found.spec = found.load_vector(1)
    found.spec.horizons = {}
    found.copy_bytes = 0
    monkeypatch.setattr(tasks, "find", lambda word: found if word == TASK else find(word))
    monkeypatch.setattr(tasks, "spec", lambda word: tasks.find(word).spec)
    in_one_process(monkeypatch)
    monkeypatch.setattr(checkpointing, "MOST_SECONDS_BETWEEN", 0.0)
    monkeypatch.setattr(checkpointing, "MOST_SHARE", math.inf)


def in_one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves worker processes and pictures out of launches."""
    monkeypatch.setattr(experiment, "execute", _execute)
    monkeypatch.setattr(recorder, "write_figure", lambda path: None)
    monkeypatch.setattr(recorder, "write_index", lambda *_: None)
    monkeypatch.setattr(summary, "present", lambda *_: None)
    monkeypatch.setattr(summary, "summarise", lambda *_: None)
    monkeypatch.setattr(manifest, "commit", lambda: None)


def _execute(jobs, work, hooks, **_) -> None:
    for job in jobs:
        hooks.on_message(job, Started())
        work(job, functools.partial(hooks.on_message, job))
        hooks.on_message(job, Finished(0.0))


def live(
    out: Path,
    *words: str,
    usual: Sequence[str] = USUAL,
    kill_after: float | None = None,
    first: Callable[[], object] = lambda: None,
) -> tuple[int, str]:
    """Launches; returns the exit status (minus the signal that ended it) and what was printed.

    Args:
      usual: words before the others.
      kill_after: seconds after which SIGKILL comes.
      first: called in the launch's process before anything else.
    """
    reader, writer = os.pipe()
    process = os.fork()
    if not process:
        os.close(reader)
        _launch_and_exit(writer, ["launch/run.py", *usual, f"--out={out}", *words], first)
    os.close(writer)
    printed = _killed_after(process, reader, kill_after)
    _, status = os.waitpid(process, 0)
    return os.waitstatus_to_exitcode(status), printed


def _launch_and_exit(output: int, argv: list[str], first: Callable[[], object]) -> None:
    os.dup2(output, 1)
    os.dup2(output, 2)
    status = 99
    try:
        with (
            open(1, "w", buffering=1, closefd=False) as sys.stdout,
            contextlib.redirect_stderr(sys.stdout),
        ):
            first()
            status = program.answer(lambda: experiment.run(request.parse(argv), argv), str)
    finally:
        os._exit(status)


def _killed_after(process: int, reader: int, seconds: float | None) -> str:
    """Waits for the process to end, and kills it when its time has come; returns its output."""
    end = math.inf if seconds is None else time.monotonic() + seconds
    chunks = [b""]
    with open(reader, "rb", buffering=0) as pipe:
        while True:
            left = end - time.monotonic()
            ready, _, _ = select.select([pipe], [], [], None if left == math.inf else max(left, 0))
            if not ready:
                os.kill(process, signal.SIGKILL)
                end = math.inf
                continue
            chunks.append(pipe.read(65536))
            if not chunks[-1]:
                return b"".join(chunks).decode()


def outcome(out: Path, task: str = TASK) -> dict:
    """All that a finished experiment leaves that must not depend on how it was interrupted."""
    folder = RunFolder(out, task)
    header, *lines = folder.results.read_text().splitlines()
    clocks = [header.split(",").index(name) for name in schema.CLOCKS]
    rows = sorted(
        tuple(cell for column, cell in enumerate(line.split(",")) if column not in clocks)
        for line in lines
    )
    policies = {file.name: file.read_bytes() for file in folder.policies.iterdir()}
    return {"rows": rows, "policies": policies, "checkpoints": folder.checkpoints.exists()}


def standings(out: Path) -> dict[str, int]:
    """The episode of the newest whole checkpoint of each unfinished run, by its folder's name."""
    found = {}
    for folder in RunFolder(out, TASK).checkpoints.glob("*"):
        newest, complaints = checkpointing.checkpoint.newest(folder)
        assert not complaints, complaints
        found[folder.name] = newest.train_episodes if newest else 0
    return found


def fallen_back(before: Mapping[str, int], now: Mapping[str, int]) -> int:
    """How many runs stand further back on the disk than before."""
    return sum(now.get(name, 0) < episodes for name, episodes in before.items())


def wait_for(holds: Callable[[], bool], seconds: float) -> None:
    """Waits until something holds."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.05)


def wait_until_gone(group: int, seconds: float = 60) -> None:
    """Waits until no process of the group is left."""

    def gone() -> bool:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        return False

    wait_for(gone, seconds)
