"""The console commands `hac-run`, `hac-play`, ...: each is the program of that name in this folder.

A program's own `__main__` part is run, which sets what numpy, torch and mujoco read when they are
imported; so nothing that imports them may be imported here.
"""

import runpy


def run() -> None:
    """`hac-run` is `python launch/run.py`: trains agents on tasks."""
    _program("launch.run")


def play() -> None:
    """`hac-play` is `python launch/play.py`: shows a trained policy."""
    _program("launch.play")


def doctor() -> None:
    """`hac-doctor` is `python launch/doctor.py`: says what this machine can do."""
    _program("launch.doctor")


def status() -> None:
    """`hac-status` is `python launch/status.py`: says how an experiment stands."""
    _program("launch.status")


def view() -> None:
    """`hac-view` is `python launch/view.py`: a live page of a trained policy."""
    _program("launch.view")


def fit() -> None:
    """`hac-fit` is `python launch/fit.py`: estimates the settings of another's environment."""
    _program("launch.fit")


def check_task() -> None:
    """`hac-check-task` is `python launch/check_task.py`: what is wrong with a task of one's own."""
    _program("launch.check_task")


def new_task() -> None:
    """`hac-new-task` is `python launch/new_task.py`: a task file to begin with, from an MJCF."""
    _program("launch.new_task")


def _program(module: str) -> None:
    """Runs a module as if it had been typed; it ends with SystemExit."""
    runpy.run_module(module, run_name="__main__")
