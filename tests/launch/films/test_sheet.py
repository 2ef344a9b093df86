"""Sheets and columns: what they are made of, also of an environment that only draws itself."""

import numpy as np
import pytest

import hac_suite
import tasks
from analysis.program import CommandError
from launch.drawing import pacing
from launch.films.columns import Columns, shown_steps
from launch.films.sheet import Sheet
from launch.folder import policies
from launch.pictures import course as course_lib

TASK, SEED = "ur5_reacher", 11


def policy(layers: int) -> hac_suite.Policy:
    (path,) = [f.path for f in policies.published(TASK) if f.subgoal_layers == layers]
    return hac_suite.Policy.load(path)


class DrawsItself:
    """A task without the simulation that a film looks into."""

    def __init__(self, env):
        self._env = env

    def __getattr__(self, name):
        if name == "simulation":
            raise AttributeError(name)
        return getattr(self._env, name)

    def render(self, i, *, height, width):
        """White, and as bright at the top as the arm is far."""
        picture = np.full((height, width, 3), 255, np.uint8)
        picture[: height // 2] = round(80 * abs(self._env._view().observation[0, 0])) % 256
        return picture


@pytest.fixture
def drawing_itself(monkeypatch):
    load = tasks.load_vector
    monkeypatch.setattr(course_lib.tasks, "load_vector", lambda *args: DrawsItself(load(*args)))


def test_an_environment_that_draws_itself_is_filmed_as_it_does(drawing_itself):
    course = course_lib.record(policy(1), SEED)
    assert course.steps > 20 and not course.poses
    assert sorted(course.photos)[-1] == course.steps and len(course.photos) <= 161
    sheet = Sheet(course, pacing.pace(course.steps, course.control_timestep), (640, 360), None)
    first, last = sheet.frame(0.0), sheet.frame(course.steps)
    sheet.close()
    assert first.shape == (360, 640, 3)
    assert (first[200:250, 300:340] == 255).all()  # its own picture, in the middle
    assert np.abs(first.astype(int) - last).max() > 50


@pytest.mark.parametrize("size", [(1280, 720), (480, 854), (400, 400)])
def test_lanes_are_wide_in_a_narrow_film_as_well(drawing_itself, size):
    course = course_lib.record(policy(1), SEED)
    sheet = Sheet(course, pacing.pace(course.steps, course.control_timestep), size, None)
    strip = sheet._strip
    sheet.close()
    assert strip._x(course.steps) - strip._x(0) > 0.6 * size[0]


@pytest.mark.requires_gl
def test_columns_begin_together_and_those_that_are_done_wait(tmp_path):
    courses = [course_lib.record(policy(layers), 0) for layers in (0, 2)]
    columns = Columns(courses, ["none", "two"], (640, 320), None)
    steps = [course.steps for course in courses]
    assert columns.moments[-1] == max(steps) and all(course.success for course in courses)
    done = int(np.argmin(steps))
    half = slice(0, 300) if done == 0 else slice(330, 640)
    early, late = columns.frame(float(min(steps))), columns.frame(float(max(steps)))
    columns.close()
    np.testing.assert_array_equal(early[50:200, half], late[50:200, half])
    other = slice(330, 640) if done == 0 else slice(0, 300)
    assert (early[50:200, other] != late[50:200, other]).any()


def test_failures_are_not_shown_much_longer_than_successes(drawing_itself):
    course = course_lib.record(policy(1), SEED)
    lost = course._replace(success=False, trail=np.zeros((course.steps * 4, 0, 3)))
    assert shown_steps([lost, course]) == round(1.4 * course.steps)
    assert shown_steps([lost, lost]) == lost.steps


def test_a_size_without_room_for_pictures_is_refused_with_the_least_height(drawing_itself):
    courses = [course_lib.record(policy(layers), SEED) for layers in (0, 1)]
    with pytest.raises(
        CommandError, match=r"--size=1280x240: too low .* at least (\d+)$"
    ) as raised:
        Columns(courses, ["none", "one"], (1280, 240), None)
    least = int(str(raised.value).rpartition(" ")[2])
    columns = Columns(courses, ["none", "one"], (1280, least), None)
    columns.close()
    assert columns.frame(0.0).shape == (least, 1280, 3) and least % 2 == 0
