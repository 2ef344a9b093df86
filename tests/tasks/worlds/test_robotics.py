"""gymnasium-robotics, if it is installed: worlds that nobody here made."""

import resource
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest

import hac_suite
import tasks
from launch.pictures.stage import Stage, simulation_of

pytestmark = pytest.mark.slow
robotics = pytest.importorskip(
    "gymnasium_robotics", reason="gymnasium-robotics is not installed: pip install '.[worlds]'"
)
mujoco_utils = pytest.importorskip("gymnasium_robotics.utils.mujoco_utils")

IDS = ("PointMaze_UMaze-v3", "FetchReach-v4", "FetchPush-v4", "AntMaze_UMaze-v5", "HandReach-v3")


@pytest.mark.parametrize("id", IDS)
def test_a_world_is_made_and_steps_by_seed(id):
    task = tasks.find(f"gym:gymnasium_robotics:{id}")
    env, rng = task.load_vector(2), np.random.default_rng(0)
    actions = rng.uniform(env.action_low, env.action_high, (2, len(env.action_low)))
    runs = [[env.reset(np.array([5, 6])), env.step(actions)] for _ in range(2)]
    for first, again in zip(*runs, strict=True):
        for a, b in zip(first, again, strict=True):
            np.testing.assert_array_equal(a, b)
    state = runs[0][1]
    assert not state.diverged.any() and not state.failed.any()
    scaled = (state.observation - env.observation_offset) / env.observation_scale
    assert np.quantile(np.abs(scaled), 0.9) < 1.5
    assert env.goal_space.achieved(state.desired_goal, state.desired_goal).all()
    assert not env.goal_space.achieved(state.desired_goal + 50, state.desired_goal).any()


def test_an_ant_is_told_where_it_is():
    spec = tasks.spec("gym:AntMaze_UMaze-v5")
    assert spec.observation_names[-2:] == ("achieved_goal[0]", "achieved_goal[1]")


def test_welds_are_reset_with_the_mujoco_that_is_installed():
    """Fetch's gripper follows its mocap body: with a weld passed over it would stay or fly off."""
    env = tasks.load_vector("gym:FetchReach-v4", 1)
    start = env.reset(np.array([0])).achieved_goal[0]
    action = np.array([[1.0, 0.0, 0.0, 0.0]])
    end = [env.step(action) for _ in range(10)][-1].achieved_goal[0]
    assert 0.1 < end[0] - start[0] < 0.6
    np.testing.assert_allclose(end[1:], start[1:], atol=0.05)


@pytest.mark.parametrize(
    "make", ["FetchReach-v4", lambda: gymnasium.make("FetchReach-v4", max_episode_steps=-1)]
)
def test_an_environment_that_was_registered_by_somebody_else_is_mended(make, monkeypatch):
    monkeypatch.setattr(mujoco_utils, "mujoco", mujoco)  # as it is before any world was made
    env = tasks.from_gymnasium(make, 1, max_steps=50)
    assert not env.reset(np.array([0])).diverged.any()


def test_copies_of_a_maze_take_as_much_memory_as_is_said():
    task = tasks.find("gym:PointMaze_UMaze-v3")
    task.load_vector(3)  # those that compile
    before = _resident()
    task.load_vector(23)
    # Less, where memory that other tests have freed is used again.
    assert 0.6 < (_resident() - before) / (20 * task.copy_bytes) < 1.3


def _resident() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize()


def test_a_maze_is_seen_in_3d_and_its_goal_moved():
    env = tasks.load_vector("gym:PointMaze_UMaze-v3", 1)
    env.reset(np.array([0]), test=True)
    stage = Stage(env)
    before = stage.poses().position
    assert simulation_of(env) and len(stage.shapes) > 5 and not stage.subgoals
    goal = np.array([0.5, 0.5])
    np.testing.assert_array_equal(env.move_goal(0, goal).desired_goal[0], goal)
    for _ in range(20):
        seen = env.step(np.ones((1, 2)))
    np.testing.assert_array_equal(seen.desired_goal[0], goal)
    moved = np.abs(stage.poses().position - before).max(axis=1) > 1e-3
    assert moved.sum() == 1  # the ball, and none of the walls


def test_an_agent_is_trained():
    task = tasks.find("gym:PointMaze_UMaze-v3")
    config = hac_suite.Config(episodes_per_period=4, test_episodes=2, hidden_sizes=(16,))
    results = list(
        hac_suite.train(
            task.load_vector, config, [0], subgoal_layers=1, horizons=(17, 18), periods=1
        )
    )
    assert results[1].rows[0]["train_steps"] > 100
