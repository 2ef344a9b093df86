"""What is kept of an episode in others' environments that MuJoCo simulates."""

import numpy as np
import pytest

import tasks
from launch.drawing.cell import Cell, view_of
from launch.drawing.lens import Lens
from launch.drawing.view import View
from launch.pictures import course as course_lib
from launch.pictures.stage import Stage
from tests.launch.pictures.slider import WORD, Slider, Undrawn, policy

SIZE = (120, 80)


def goal_of(kind: type[Slider], seed: int) -> float:
    env = tasks.load_vector(WORD.format(kind.__name__), 1)
    return env.reset(np.array([seed]), test=True).desired_goal[0, 0]


def marked(course: course_lib.Course) -> float:
    return course.stage.model.site("target").pos[0]


def test_a_robots_handle_is_no_goal():
    env = tasks.load_vector(WORD.format("Slider"), 1)
    goal = env.reset(np.array([3]), test=True).desired_goal
    stage = Stage(env)
    assert stage.bodies == ["world", "handle", "cart"] and stage.goal == []
    idle = env.step(np.zeros((1, 1)), np.zeros(1, bool))
    np.testing.assert_array_equal(idle.desired_goal, goal)  # it was moved to see what follows it


def test_a_film_has_the_frames_that_the_environment_renders():
    course = course_lib.record(policy(Slider), 1, filmed=True)
    assert len(course.poses) == course.steps + 1  # they are kept for other views
    cell = Cell(course, view_of([course], None, SIZE), 10.0, 1.0)
    picture = np.asarray(cell.picture(0))
    cell.close()
    assert (picture[:, 25:95] == 200).all()  # as high as there is room
    assert not course_lib.record(policy(Slider), 1).photos  # which takes no GL


@pytest.mark.requires_gl
def test_a_camera_that_is_asked_for_shows_what_mujoco_simulates():
    course = course_lib.record(policy(Slider), 1, filmed=True)
    cell = Cell(course, view_of([course], "eye", SIZE), 10.0, 1.0)
    assert (np.asarray(cell.picture(0)) != 200).any()
    cell.close()


def test_the_suites_tasks_are_not_filmed_by_themselves():
    env = tasks.load_vector("pendulum_climb", 1)
    assert not course_lib._is_of_others("pendulum_climb")
    assert course_lib._eye(env, own_frames=False).photos == {}
    env.close()


@pytest.mark.parametrize("kind", [Slider, Undrawn])
def test_every_film_has_the_goal_of_its_own_episode(kind):
    """It is a site of the model, which episodes share; some move it only when they render."""
    courses = [course_lib.record(policy(kind), seed, filmed=True) for seed in (1, 2, 3)]
    goals = [goal_of(kind, seed) for seed in (1, 2, 3)]
    assert len(set(goals)) == 3
    assert list(map(marked, courses)) == pytest.approx(goals)


def test_a_camera_on_a_robot_is_none_to_see_it_from():
    course = course_lib.record(policy(Undrawn), 1)
    view = View(course.stage, None, SIZE)
    np.testing.assert_array_equal(view.position, course.stage.camera.position)
    seen = view.pixels(course.poses[0].position)
    assert ((seen > 0) & (seen < SIZE)).all()
    # Asked for, it stands where it is when the episode begins.
    riding = view_of([course], "eye", SIZE)
    start = course.poses[0].position[2]
    assert riding.position == pytest.approx(start + [0, 0, 0.2], abs=1e-6)
    assert abs(start[0]) > 0.1 and (np.abs(riding.bounds) < 1).all()


def test_a_world_in_which_no_shape_moves_is_seen_whole():
    course = course_lib.record(policy(Undrawn), 1)
    course.stage.shapes = [shape for shape in course.stage.shapes if not shape.body]
    np.testing.assert_array_equal(
        view_of([course], None, SIZE).bounds, View(course.stage, None, SIZE).bounds
    )


@pytest.mark.requires_gl
def test_nothing_that_moves_stays_behind():
    """Neither a site on the cart, which its box does not hold, nor one on the mocap body."""
    course = course_lib.record(policy(Undrawn), 1)
    for step, state in enumerate(course.states):
        state[0] = -1 + 0.4 * step
    view = View(course.stage, None, (360, 240))
    lens = Lens(course, view)
    background, late = lens._background.astype(int), lens.picture(4).astype(int)
    lens.close()
    for colour in ([1, 0, 0], [0, 1, 0]):
        assert of_colour(late, colour).sum() > 10 and not of_colour(background, colour).any()
    flag, columns = view.pixels(np.array([0.6, 0.0, 0.6])), of_colour(late, [1, 0, 0]).nonzero()[1]
    assert (columns.min() + columns.max()) / 2 == pytest.approx(flag[0], abs=3)
    for picture in (background, late):
        assert of_colour(picture, [1, 1, 0]).sum() > 10  # the goal stays


def of_colour(picture: np.ndarray, colour: list[int]) -> np.ndarray:
    """Where the parts that the colour [3] has are bright, and the others are dark."""
    return np.where(np.array(colour, bool), picture > 80, picture < 40).all(-1)
