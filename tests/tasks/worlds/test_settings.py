"""The file of settings: written, read back, edited, and answered if it is wrong."""

import dataclasses
import re

import numpy as np
import pytest

import tasks
from tasks.worlds import settings as lib
from tests.tasks.worlds.test_words import POINT

SETTINGS = lib.Settings(
    max_steps=40,
    observation_offset=(0.0, 0.5, 0.0, 0.0),
    observation_scale=(1.0, 2.0, 0.25, 1e-3),
    goal_low=(-1.0, -1.0),
    goal_high=(1.0, 1.0),
    goal_threshold=(0.1, 0.1),
    subgoal_low=(-2.0, -1.0),
    subgoal_high=(1.0, 3.0),
    subgoal_threshold=(0.2, 0.3),
    horizons={1: (7, 6), 2: (4, 4, 3)},
)
NAMES = ("x", "y"), ("x", "y")


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "point_fit.toml"
    path.write_text(lib.as_toml(SETTINGS, POINT, path.name, NAMES, judged=True))
    return path


def test_what_is_written_is_read_back(file):
    word, found = lib.from_toml(file.read_text(), "a")
    assert (word, found) == (POINT, SETTINGS)
    assert lib.read(SETTINGS.as_json(), "a") == SETTINGS
    long = dataclasses.replace(SETTINGS, observation_scale=tuple(np.linspace(1e-3, 9, 105)))
    quoted = "gym:x:Y-v0?" + '{"args":{"a":"it\'s \\\\ one"}}'
    assert lib.from_toml(lib.as_toml(long, quoted, "f", NAMES, judged=True), "a") == (quoted, long)


def test_a_file_is_a_task_with_these_spaces(file):
    task = tasks.find(str(file))
    assert (task.name, task.word) == ("point_fit", str(file))
    env = task.load_vector(2)
    assert env.max_steps == 40 and env.horizons == SETTINGS.horizons
    np.testing.assert_array_equal(env.observation_offset, SETTINGS.observation_offset)
    np.testing.assert_array_equal(env.subgoal_space.low, [-2, -1])
    assert env.reset(np.arange(2)).observation.shape == (2, 4)
    edited = file.read_text().replace("max_steps = 40", "max_steps = 9")
    file.write_text(edited)
    assert tasks.find(str(file)).spec.max_steps == 9


def test_the_files_threshold_decides_where_the_environment_does_not(tmp_path):
    plain = 'gym:HacToy/Plain-v0?{"goal":"obs[0:1]","goal_threshold":[0.1]}'
    three = dataclasses.replace(
        SETTINGS,
        observation_offset=(0.0,) * 3,
        observation_scale=(1.0,) * 3,
        **{f"{which}_{name}": own for which in ("goal", "subgoal") for name, own in
           (("low", (-1.0,)), ("high", (1.0,)), ("threshold", (0.7,)))},
    )  # fmt: skip
    file = tmp_path / "plain_fit.toml"
    file.write_text(lib.as_toml(three, plain, file.name, (("x",), ("x",)), judged=False))
    assert "achieved within the threshold" in file.read_text()
    env = tasks.find(str(file)).load_vector(4)
    assert env.goal_space.achieved(np.array([0.5]), np.array([0.0]))
    assert (np.abs(env.reset(np.arange(4)).desired_goal) <= 1).all()
    file.write_text(file.read_text().replace("low = [-1.0]", "low = [0.99999]", 1))
    with pytest.raises(ValueError, match="no point that random episodes reach lies within"):
        tasks.find(str(file))


def test_thresholds_that_every_state_meets_are_said(file):
    assert not tasks.find(str(file)).warnings
    file.write_text(file.read_text().replace("threshold = [0.2, 0.3]", "threshold = [1.5, 2.0]"))
    (said,) = tasks.find(str(file)).warnings
    assert "nearly every subgoal is achieved at once" in said


def test_a_task_of_the_suite_with_other_spaces_is_judged_as_before(tmp_path):
    own = tasks.spec("pendulum_climb")
    changed = dataclasses.replace(
        SETTINGS,
        max_steps=50,
        observation_offset=(0.0, 0.0, 0.0),
        observation_scale=(1.0, 1.0, 9.0),
        goal_threshold=(9.0, 9.0),
    )
    file = tmp_path / "other.toml"
    file.write_text(lib.as_toml(changed, "pendulum_climb", file.name, NAMES, judged=True))
    task = tasks.find(str(file))
    env, plain = task.load_vector(3), tasks.load_vector("pendulum_climb", 3)
    assert env.max_steps == 50 and env.observation_scale[2] == 9.0
    a, b = (e.reset(np.arange(3)) for e in (env, plain))
    np.testing.assert_array_equal(a.observation, b.observation)
    apart = np.array([[0.0, 0.9 * own.goal_space.threshold[1]], [1.0, 0.0]])
    assert env.goal_space.achieved(apart, np.zeros((2, 2))).tolist() == [True, False]
    assert task.load(seed=0).reset().first()


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("max_steps = 40", "max_steps = 0", "max_steps takes a count, not 0"),
        ("max_steps = 40", "max_steps = true", "max_steps takes a count, not True"),
        ("task = ", "tsak = ", "task is missing"),
        ("[goal]", "[gaol]", "no setting 'gaol'"),
        ("low = [-1.0, -1.0]", "", "goal.low is missing"),
        ("scale = [1.0, 2.0", "scale = [1.0, 'b'", "observation.scale takes a list of finite"),
        ("scale = [1.0, 2.0, ", "scale = [1.0, ", "offset has 4 numbers, observations 3|has 3"),
        ("low = [-2.0, -1.0]", "low = [9.0, -1.0]", "subgoal: low must be below high"),
        ("threshold = [0.2, 0.3]", "treshold = [0.2, 0.3]", "no setting 'subgoal.treshold'"),
        ("threshold = [0.1, 0.1]", "threshold = [0.1, -0.1]", "goal: thresholds must be positive"),
        ("1 = [7, 6]", "1 = [7]", "horizons.1 takes 2 counts"),
        ("1 = [7, 6]", "one = [7]", "horizons.one takes"),
        ("[horizons]", "[horizon]", "no setting 'horizon'"),
        ("threshold = [0.2, 0.3]", "threshold = [0.2, 0.3]\nscale = [1]", "'subgoal.scale'"),
        ("max_steps", "= max_steps", "it is not TOML"),
    ],
)
def test_a_wrong_file_is_answered_by_name(file, old, new, problem):
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(ValueError, match=f"^{re.escape(str(file))}.*({problem})"):
        tasks.find(str(file))


def test_horizons_that_are_no_table_are_answered_by_name(file):
    text, _ = file.read_text().split("[horizons]")
    file.write_text(f"horizons = [17, 18]\n{text}")
    with pytest.raises(ValueError, match=r"horizons is a table.*not \[17, 18\]"):
        tasks.find(str(file))


def test_a_file_that_is_not_there_or_called_like_a_task_is_refused(tmp_path, file):
    with pytest.raises(ValueError, match=r"no such file.*launch/fit\.py"):
        tasks.find(str(tmp_path / "none.toml"))
    taken = file.rename(tmp_path / "pick_place.toml")
    with pytest.raises(ValueError, match="give the file another name"):
        tasks.find(str(taken))
