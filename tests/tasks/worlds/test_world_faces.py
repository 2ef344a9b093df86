"""Third-party environments behind the Gymnasium face: they can end by themselves."""

import copy
import pickle

import numpy as np
import pytest

from tasks import to_gymnasium
from tasks.worlds import words


def world_word(max_steps=30, **habits) -> str:
    """A word for a toy that starts at the origin and goes where it is pushed."""
    options = {"args": {"start": [0.0, 0.0], **habits}, "max_steps": max_steps}
    return words.compose("gym:tests.tasks.worlds.toys:HacToy/Point-v0", options)


EAST = np.array([1.0, 0.0])


def test_a_world_that_fails_terminates_and_the_next_episode_begins():
    word = world_word(fails_above=0.5)
    env = to_gymnasium.GoalEnv(word)
    for _ in range(2):
        env.reset(seed=0)
        ends = [env.step(EAST)[1:] for _ in range(8)]
        assert [end[1] for end in ends].index(True) == 3  # at 0.1, 0.25, 0.42, 0.61
        reward, terminated, truncated, info = ends[3]
        assert (reward, terminated, truncated) == (-1.0, True, False)
        assert (info["is_success"], info["diverged"]) == (False, False)
    envs = to_gymnasium.GoalVectorEnv(word, 2)
    envs.reset(seed=0)
    ends = [envs.step(np.array([EAST, -EAST]))[2].tolist() for _ in range(12)]
    assert [end[0] for end in ends] == [step % 5 == 3 for step in range(12)]
    assert not any(end[1] for end in ends)


@pytest.mark.parametrize("max_steps", [7, 30])  # the environment's own limit is 30
def test_a_world_is_truncated_at_its_limit_after_which_it_stands_still(max_steps):
    word = world_word(max_steps)
    env = to_gymnasium.GoalEnv(word)
    envs = to_gymnasium.GoalVectorEnv(word)
    wanted = [False] * (max_steps - 1) + [True]
    env.reset(seed=0)
    assert [env.step(-EAST)[3] for _ in range(max_steps)] == wanted
    envs.reset(seed=0)
    assert [envs.step(-EAST[None])[3].item() for _ in range(max_steps)] == wanted


@pytest.mark.parametrize("copy_of", [copy.copy, copy.deepcopy, pickle.dumps])
def test_a_world_cannot_be_copied_and_says_so(copy_of):
    env = to_gymnasium.GoalEnv(world_word())
    env.reset(seed=0)
    with pytest.raises(TypeError, match="cannot be copied or pickled; make another environment"):
        copy_of(env)


def test_our_tasks_with_settings_of_a_file_can_be_copied(tmp_path):
    file = tmp_path / "own.toml"
    file.write_text(_SETTINGS)
    env = to_gymnasium.GoalEnv(str(file))
    np.testing.assert_array_equal(env.observation_offset, [0.5, 0.0, 0.0])
    env.reset(seed=0)
    env.step(np.ones(1))
    twin = copy.deepcopy(env)
    ours, theirs = env.step(np.ones(1))[0], twin.step(np.ones(1))[0]
    np.testing.assert_array_equal(ours["observation"], theirs["observation"])


_SETTINGS = """
task = "pendulum_climb"
max_steps = 50
observation = { offset = [0.5, 0.0, 0.0], scale = [1.0, 1.0, 8.0] }
goal = { low = [-3.2, -8.0], high = [3.2, 8.0], threshold = [0.1, 0.6] }
subgoal = { low = [-3.2, -8.0], high = [3.2, 8.0], threshold = [0.1, 0.6] }
"""
