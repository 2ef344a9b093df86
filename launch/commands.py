"""The console commands `hac-run`, `hac-play`, ...: each is the program of that name in this folder.

Each runs the program's own `__main__` part, which sets what numpy, torch and mujoco read at import.
So this file must not import anything that imports them.
"""

import runpy


def run() -> None:
    """`hac-run` is `python launch/run.py`: trains agents on tasks."""
    _program("launch.run")


def play() -> None:
    """`hac-play` is `python launch/play.py`: shows a trained policy."""
    _program("launch.play")


def doctor() -> None:
    """`hac-doctor` is `python launch/doctor.py`: checks what this machine can do."""
    _program("launch.doctor")


def status() -> None:
    """`hac-status` is `python launch/status.py`: shows the progress of an experiment."""
    _program("launch.status")


def view() -> None:
    """`hac-view` is `python launch/view.py`: a live page of a trained policy."""
    _program("launch.view")


def fit() -> None:
    """`hac-fit` is `python launch/fit.py`: estimates settings for an environment."""
    _program("launch.fit")


def check_task() -> None:
    """`hac-check-task` is `python launch/check_task.py`: checks a user's task."""
    _program("launch.check_task")


def new_task() -> None:
    """`hac-new-task` is `python launch/new_task.py`: writes a task file for an MJCF model."""
    _program("launch.new_task")


def _program(module: str) -> None:
    """Runs a module as if it had been typed; it ends with SystemExit."""
    runpy.run_module(module, run_name="__main__")
