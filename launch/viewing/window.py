"""Plays test episodes of a policy in MuJoCo's own window."""

import threading
import time
from typing import Any

import mujoco.viewer
import numpy as np

import hac_suite
import tasks
from analysis.program import CommandError
from launch.folder import policies
from launch.jobs.local import StopSignal
from launch.pictures.stage import Camera, Stage, simulation_of
from launch.viewing.episode import Episode
from launch.viewing.player import Player

_SPEED = 0.5  # times real time
_HOLD_SECONDS = 1.5  # that the end of an episode is shown
_POLL_SECONDS = 0.02
_CLOSING_SECONDS = 20.0
_FAILED = "MuJoCo's window did not open: {error}; --viewer=page needs no display"


def play(found: policies.Found, word: str, stop: StopSignal) -> None:
    """Plays one test episode after another until the window is closed or `stop` is set.

    Raises:
      CommandError: the policy cannot be played, or no window opens.
    """
    env = tasks.load_vector(word, 1)
    try:
        _play(env, found, stop)
    finally:
        env.close()


def _play(env: Any, found: policies.Found, stop: StopSignal) -> None:
    try:
        policy = hac_suite.Policy.load(found.path)
        player = Player(Episode(env, policy, 0), env.control_timestep, speed=_SPEED)
    except (KeyError, TypeError, ValueError) as error:
        raise CommandError(f"policy {found.path}: {error}") from error
    simulation = simulation_of(env)
    if simulation is None:
        raise CommandError(
            f"{found.task}: MuJoCo does not simulate it, so its window cannot show it"
        )
    camera = Stage(env).camera
    before = set(threading.enumerate())
    try:
        opened = mujoco.viewer.launch_passive(*simulation, show_left_ui=False, show_right_ui=False)
    except RuntimeError as error:
        raise CommandError(_FAILED.format(error=error)) from error
    threads = set(threading.enumerate()) - before
    seed = 0
    with opened as window:
        _look_from(window.cam, camera)
        player.play(time.monotonic())
        while window.is_running() and stop.number is None:
            if player.episode.over:
                time.sleep(_HOLD_SECONDS)
                seed += 1
                player.begin(Episode(env, policy, seed))
            if player.tick(time.monotonic()):
                with window.lock():
                    _bring_up_to_date(env, *simulation)
                window.sync()
            time.sleep(player.seconds_to_wait(time.monotonic(), _POLL_SECONDS))
    for thread in threads:  # one that still draws while Python ends would crash it
        thread.join(_CLOSING_SECONDS)


def _bring_up_to_date(env: Any, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Writes the state of the environment into the data that the window shows."""
    simulation = simulation_of(env)
    assert simulation is not None, "it had one when the window opened"
    if simulation[1] is not data:  # an environment of our own gives a copy each time
        mujoco.mj_copyData(data, model, simulation[1])


def _look_from(view: mujoco.MjvCamera, camera: Camera) -> None:
    """As the task's own pictures are taken, but free to be turned."""
    ahead = camera.look_at - camera.position
    view.lookat[:] = camera.look_at
    view.distance = np.linalg.norm(ahead)
    view.azimuth = np.degrees(np.arctan2(ahead[1], ahead[0]))
    view.elevation = np.degrees(np.arcsin(ahead[2] / view.distance))
