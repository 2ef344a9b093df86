"""MuJoCo's window, without a display: what it is given to show."""

import contextlib

import mujoco.viewer
import numpy as np
import pytest

from analysis.program import CommandError
from launch.folder import policies
from launch.jobs.local import StopSignal
from launch.viewing import window


class Window:
    """In place of the window: notes what it would show, and is closed after a while."""

    def __init__(self, model, data, **_):
        self.data, self.cam = data, mujoco.MjvCamera()
        self.shown: list[np.ndarray] = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def lock(self):
        return contextlib.nullcontext()

    def is_running(self):
        return len(self.shown) < 5

    def sync(self):
        self.shown.append(self.data.qpos.copy())


def test_the_window_shows_every_step(monkeypatch):
    opened = []

    def launch(*simulation, **settings):
        opened.append(Window(*simulation, **settings))
        return opened[0]

    monkeypatch.setattr(mujoco.viewer, "launch_passive", launch)
    found = policies.published("pendulum_climb")[0]
    window.play(found, "pendulum_climb", StopSignal())
    assert len(np.unique(opened[0].shown, axis=0)) == 5


def test_a_display_that_is_missing_is_said_in_a_line(monkeypatch):
    def fail(*_, **__):
        raise RuntimeError("no display")

    monkeypatch.setattr(mujoco.viewer, "launch_passive", fail)
    found = policies.published("pendulum_climb")[0]
    with pytest.raises(CommandError, match="did not open: no display; --viewer=page"):
        window.play(found, "pendulum_climb", StopSignal())
