"""A launch as launch/run.py makes it, with work of one's own in place of training."""

from pathlib import Path

from launch import experiment
from launch.asking import request
from tests.launch import fake_jobs

TASK = "pendulum_climb"


def words(out: Path, *more: str) -> list[str]:
    """A command: one agent of one task unless there are more words, and no video."""
    usual = [f"--task={TASK}", "--subgoal_layers=1", "--novideo", f"--out={out}"]
    return ["launch/run.py", *usual, *more]


def launch(out: Path, *more: str, work=fake_jobs.train) -> int:
    """Carries out that command; returns the exit status.

    Raises:
      CommandError: as `experiment.run`.
    """
    argv = words(out, *more)
    return experiment.run(request.parse(argv), argv, work=work)
