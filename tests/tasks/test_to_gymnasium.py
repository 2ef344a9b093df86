"""The Gymnasium face: registration, the checkers of two libraries, and training with one."""

import copy
import os
import pickle
import subprocess
import sys
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import stable_baselines3
import torch
from gymnasium.utils import env_checker
from stable_baselines3.common import env_checker as sb3_env_checker

import tasks
from tasks import to_gymnasium

ROOT = Path(__file__).resolve().parents[2]
_IDS = {name: to_gymnasium.environment_id(name) for name in tasks.ALL}
# Published names, which must stay; a new task brings one more.
_PUBLISHED_IDS = {
    "HACSuite/PendulumClimb-v0",
    "HACSuite/PendulumBalance-v0",
    "HACSuite/UR5Reacher-v0",
    "HACSuite/CartpoleSwingup-v0",
    "HACSuite/PickPlace-v0",
}


def test_every_task_is_registered():
    registered = {name for name in gymnasium.registry if name.startswith("HACSuite/")}
    assert _PUBLISHED_IDS <= registered == set(_IDS.values())


@pytest.mark.requires_gl
@pytest.mark.parametrize("name", tasks.ALL)
def test_passes_gymnasium_checker(name):
    env = gymnasium.make(_IDS[name], render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Unbounded observation spaces are meant: velocities have no bound.
        warnings.filterwarnings("ignore", message=".*Box observation space m.* is .*infinity")
        env_checker.check_env(env.unwrapped)
    env.close()


@pytest.mark.requires_gl
@pytest.mark.parametrize("name", tasks.ALL)
def test_passes_stable_baselines3_checker(name):
    env = gymnasium.make(_IDS[name], render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sb3_env_checker.check_env(env.unwrapped)
    env.close()


@pytest.mark.parametrize("name", tasks.ALL)
def test_follows_composer(name):
    """An episode by seed equals Composer's, with actions of [-1, 1] spanning the motors' range."""
    env = gymnasium.make(_IDS[name], test=True)
    observation, info = env.reset(seed=3)
    seed = np.random.Generator(np.random.PCG64(np.random.SeedSequence(3))).integers(2**32)
    composer = tasks.load(name, seed=int(seed), test=True)
    timestep = composer.reset()
    spec = composer.action_spec()
    random_state = np.random.RandomState(0)
    for _ in range(40):
        for key in ("achieved_goal", "desired_goal"):
            np.testing.assert_array_equal(observation[key], timestep.observation[key])
        np.testing.assert_array_equal(
            info["achieved_subgoal"], timestep.observation["achieved_subgoal"]
        )
        assert not info["diverged"]
        action = random_state.choice([-1.0, 0.0, 1.0], size=env.action_space.shape)
        observation, reward, terminated, truncated, info = env.step(action)
        natural = np.choose(
            action.astype(int) + 1, [spec.minimum, (spec.minimum + spec.maximum) / 2, spec.maximum]
        )
        timestep = composer.step(natural)
        assert reward == timestep.reward
        assert (terminated or truncated) == timestep.last()
        if timestep.last():
            break


def test_rewards_are_vectorised_over_leading_axes():
    env = gymnasium.make(_IDS["pendulum_climb"]).unwrapped
    goal = np.array([0.0, 1.3])
    achieved = goal + np.array([[[0.0, 0.0], [0.07, -0.07]], [[0.08, 0.0], [0.0, -0.2]]])
    rewards = env.compute_reward(achieved, np.broadcast_to(goal, achieved.shape), {})
    np.testing.assert_array_equal(rewards, [[0.0, 0.0], [-1.0, -1.0]])
    assert env.compute_reward(goal, goal, {}) == 0.0


def test_truncates_at_the_horizon_and_not_before():
    env = gymnasium.make(_IDS["pendulum_balance"])
    env.reset(seed=0)
    steps = tasks.spec("pendulum_balance").max_steps
    assert env.spec.max_episode_steps == env.unwrapped.max_steps == steps
    ends = [env.step(np.zeros(1))[2:4] for _ in range(steps)]
    assert ends == [(False, False)] * (steps - 1) + [(False, True)]


def test_a_diverged_episode_is_truncated_and_says_so():
    env = gymnasium.make(_IDS["pendulum_climb"])
    env.reset(seed=0)
    env.unwrapped._env._data[0].qvel[0] = 1e12
    _, reward, terminated, truncated, info = env.step(np.zeros(1))
    assert (reward, terminated, truncated) == (-1.0, False, True)
    assert (info["is_success"], info["diverged"]) == (False, True)


def test_a_limit_of_ones_own_takes_the_place_of_the_tasks():
    env = gymnasium.make(_IDS["pendulum_climb"], max_episode_steps=310)
    env.reset(seed=0, options={"test": True})
    assert 310 > env.unwrapped.max_steps == 300
    assert [env.step(np.zeros(1))[3] for _ in range(310)] == [False] * 309 + [True]


def test_the_option_of_a_reset_decides_where_its_episode_begins():
    training, test = (gymnasium.make(_IDS["ur5_reacher"], test=test) for test in (False, True))
    (hard, _), (wide, _) = test.reset(seed=5), training.reset(seed=5)
    assert (hard["observation"] != wide["observation"]).any()
    asked, _ = training.reset(seed=5, options={"test": True})
    np.testing.assert_array_equal(asked["observation"], hard["observation"])
    asked, _ = test.reset(seed=5, options={"test": False})
    np.testing.assert_array_equal(asked["observation"], wide["observation"])
    asked, _ = training.reset(seed=5, options={})  # it held for one episode
    np.testing.assert_array_equal(asked["observation"], wide["observation"])


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"tset": True}, "no option 'tset'; its options are test"),
        ({"test": "yes"}, "test=True or test=False, got 'yes'"),
    ],
)
def test_a_wrong_option_is_refused(options, problem):
    env = gymnasium.make(_IDS["pendulum_climb"])
    with pytest.raises(ValueError, match=problem):
        env.reset(options=options)


def test_spaces_and_scales_are_at_hand():
    env, spec = gymnasium.make(_IDS["pick_place"]).unwrapped, tasks.spec("pick_place")
    assert env.goal_space is spec.goal_space and env.subgoal_space is spec.subgoal_space
    np.testing.assert_array_equal(env.observation_scale, spec.observation_scale)


@pytest.mark.parametrize("copy_of", [copy.copy, copy.deepcopy, pickle.dumps])
def test_a_copy_is_refused_in_one_line(copy_of):
    env = gymnasium.make(_IDS["pendulum_climb"]).unwrapped
    with pytest.raises(TypeError, match=r"^a GoalEnv holds .* make another with [^\n]*$"):
        copy_of(env)


def test_the_id_with_its_module_needs_no_import():
    """Gymnasium imports the module that stands before the colon; version 1 has no plugins."""
    made = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "-c", _MAKE],
        capture_output=True, text=True, cwd=ROOT, env={**os.environ, "MUJOCO_GL": "disabled"},
    )  # fmt: skip
    assert (made.returncode, made.stdout) == (0, "True False 16\n"), made.stderr


_MAKE = """
import sys
import gymnasium
before = "tasks" not in sys.modules
env = gymnasium.make("tasks:HACSuite/PickPlace-v0")
observation, info = env.reset(seed=0)
print(before, info["is_success"], len(observation["observation"]))
"""


def test_unknown_render_mode_is_refused():
    with pytest.raises(ValueError, match="rgb_array"):
        to_gymnasium.GoalEnv("pendulum_climb", render_mode="human")


@pytest.fixture
def one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.mark.slow
def test_ddpg_with_hindsight_trains(one_thread):
    model = stable_baselines3.DDPG(
        "MultiInputPolicy",
        gymnasium.make(_IDS["pick_place"]),
        replay_buffer_class=stable_baselines3.HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"},
        policy_kwargs={"net_arch": [32, 32]},
        batch_size=32,
        learning_starts=310,  # after the longest first episode
        gradient_steps=1,
        seed=0,
        device="cpu",
    )
    before = [parameter.detach().clone() for parameter in model.actor.parameters()]
    model.learn(600)
    assert model.num_timesteps >= 600
    assert any((a != b).any() for a, b in zip(before, model.actor.parameters(), strict=True))
