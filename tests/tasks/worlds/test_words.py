"""The word gym:ID: what it carries, what it is called, and what it is answered if it is wrong."""

import json
import re

import gymnasium
import numpy as np
import pytest

import tasks
from tasks.worlds import estimates, making
from tasks.worlds.copies import Options
from tasks.worlds.world import World
from tests.tasks.worlds import toys

POINT = "gym:tests.tasks.worlds.toys:HacToy/Point-v0"


def test_a_word_finds_a_task_like_any_other():
    task = tasks.find(POINT)
    assert task.name == "Point-v0"
    assert tasks.find("Point-v0") is task  # in this process
    assert task.spec.max_steps == 30 and task.spec.control_timestep == 1 / 20
    env = task.load_vector(3)
    assert env.reset(np.arange(3)).observation.shape == (3, 4)
    assert tasks.find("gym:HacToy/Point-v0").name == "Point-v0"  # registered already
    with pytest.raises(ValueError, match="not a dm_control task"):
        tasks.load(POINT)


def test_its_own_word_carries_the_estimates_to_other_processes(monkeypatch):
    task = tasks.find(POINT)

    def none(*_, **__):
        raise AssertionError("estimated again")

    monkeypatch.setattr(estimates, "random_episodes", none)
    there = tasks.find(task.word)
    assert there is not task and there.word == task.word and there.name == task.name
    assert there.origin == task.origin and there.settings == task.settings
    np.testing.assert_array_equal(there.spec.observation_scale, task.spec.observation_scale)
    assert there.spec.horizons == task.spec.horizons


def test_estimates_are_the_same_every_time():
    world = World("a", lambda: toys.Point(), Options(), max_steps=30)
    found = [
        estimates.settings(world.about(), estimates.random_episodes(world.adapter, world.about()))
        for _ in range(2)
    ]
    assert found[0] == found[1]


def test_options_are_kept_and_tell_tasks_apart():
    word = tasks.gym_word(POINT, {"args": {"terminates": True, "start": [0, 0]}, "max_steps": 12,
                                  "test_options": {"goal": [0.5, 0.5]}, "goal": ""})  # fmt: skip
    task = tasks.find(word)
    assert re.fullmatch(r"Point-v0-[0-9a-f]{6}", task.name)
    assert task.origin["task"] == word and task.origin["settings"]["max_steps"] == 12
    carried = json.loads(task.word.partition("?")[2])
    assert carried["args"] == {"terminates": True, "start": [0, 0]} and "goal" not in carried
    env = task.load_vector(2)
    state = env.reset(np.arange(2), test=True)
    np.testing.assert_array_equal(state.achieved_goal, np.zeros((2, 2)))
    np.testing.assert_array_equal(state.desired_goal, np.full((2, 2), 0.5))


@pytest.mark.parametrize(
    ("word", "problem"),
    [
        ("gym:HacToy/Nowhere-v0", "gymnasium.make.*failed.*name the module"),
        ("gym:no_such_module:X-v0", "no module 'no_such_module' to import.*PYTHONPATH"),
        ("gym:tests/toys.py:X-v0", "of your own without .py"),
        ("gym:HacToy/PointForEver-v0", "it has no time limit.*--max_steps=200"),
        ("gym:HacToy/Plain-v0", "--goal='obs"),
        (POINT + '?{"args":{"tarminates":true}}', "tarminates=True.*unexpected keyword"),
        (POINT + "?{", "is not a JSON object"),
        (POINT + '?{"arg":{}}', "no option 'arg'; there are args, "),
        (POINT + '?{"max_steps":"9"}', "max_steps is '9'; it takes a count"),
        (POINT + '?{"settings":{"max_steps":3}}', "observation.offset is missing"),
    ],
)
def test_a_wrong_word_is_answered_in_one_line(word, problem):
    with pytest.raises(ValueError, match=problem) as answer:
        tasks.find(word)
    assert "\n" not in str(answer.value)


def test_frames_are_asked_for_where_there_are_some():
    assert tasks.find(POINT).load_vector(1)._env._copies[0].env.unwrapped.render_mode == "rgb_array"
    for unasked in ("HacToy/Plain-v0", "HacToy/OldApi-v0"):
        assert making.maker("p", unasked, {})().unwrapped.render_mode is None


@pytest.mark.slow
def test_the_suites_own_environments_are_goal_environments_as_well():
    task = tasks.find("gym:HACSuite/PendulumClimb-v0")
    own = tasks.spec("pendulum_climb")
    assert task.spec.max_steps == own.max_steps
    np.testing.assert_allclose(task.spec.goal_space.threshold, own.goal_space.threshold, rtol=1e-3)
    rng = np.random.default_rng(0)
    a, b = rng.uniform(-0.1, 0.1, (2, 200, 2))
    np.testing.assert_array_equal(
        task.spec.goal_space.achieved(a, b), own.goal_space.achieved(a, b)
    )
    assert "HACSuite/PendulumClimb-v0" in gymnasium.registry
