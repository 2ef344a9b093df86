"""A launch as launch/run.py makes it, with work of one's own in place of training."""

import contextlib
import functools
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import mock

from launch import experiment
from launch.asking import request
from launch.jobs import local, worker
from tests.launch import fake_jobs

TASK = "pendulum_climb"


def words(out: Path, *more: str) -> list[str]:
    """A command: one agent of one task unless there are more words, and no video."""
    usual = [f"--task={TASK}", "--subgoal_layers=1", "--novideo", f"--out={out}"]
    return ["launch/run.py", *usual, *more]


def launch(out: Path, *more: str, work=fake_jobs.train, method: str = "fork") -> int:
    """Carries out that command; returns the exit status.

    Its workers are forked unless `method` says otherwise, which takes no time: work that is no
    training needs no fresh process.

    Raises:
      CommandError: as `experiment.run`.
    """
    argv = words(out, *more)
    if method == "spawn" or work is worker.train_job:
        return experiment.run(request.parse(argv), argv, work=work)
    with forked_workers():
        return experiment.run(request.parse(argv), argv, work=work)


@contextlib.contextmanager
def forked_workers() -> Iterator[None]:
    """Workers are forked meanwhile."""
    with (
        mock.patch.object(local, "_START_METHOD", "fork"),
        mock.patch.object(local, "_main", functools.partial(_in_a_fork, local._main)),
    ):
        yield


def _in_a_fork(main: Callable[..., None], *args: Any) -> None:
    """What a worker does, with streams as a fresh process has them and not as pytest has."""
    sys.stdout, sys.stderr = (open(number, "w", closefd=False) for number in (1, 2))  # noqa: SIM115
    main(*args)
