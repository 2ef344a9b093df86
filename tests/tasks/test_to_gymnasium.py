"""The Gymnasium face: registration, the checkers of two libraries, and training with one."""

import copy
import os
import pickle
import re
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
from tests.cases import some_slow

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
@pytest.mark.parametrize("name", some_slow(tasks.ALL, *set(tasks.ALL) - {"pick_place"}))
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
    env.unwrapped._env._batch.qvel[0, 0] = 1e12
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
    np.testing.assert_array_equal(env.observation_offset, np.zeros(spec.observation_dim))


@pytest.mark.parametrize(
    "copy_of", [copy.copy, copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))]
)
@pytest.mark.parametrize("name", ["pick_place", "pendulum_climb"])
def test_a_copy_goes_on_from_where_the_environment_stands(name, copy_of):
    env = gymnasium.make(_IDS[name], test=True).unwrapped
    env.action_space.seed(3)
    env.reset(seed=4)
    action = np.full(env.action_space.shape, 0.4)
    for _ in range(5):
        env.step(action)
    twin = copy_of(env)
    for _ in range(5):
        ours, theirs = env.step(action), twin.step(action)
        for key, value in ours[0].items():
            np.testing.assert_array_equal(value, theirs[0][key])
        assert ours[1:4] == theirs[1:4]
    assert twin.spec == env.spec and twin.spec is not None
    np.testing.assert_array_equal(env.action_space.sample(), twin.action_space.sample())
    for _ in range(2):  # and the episodes that follow are the same
        np.testing.assert_array_equal(env.reset()[0]["observation"], twin.reset()[0]["observation"])


@pytest.mark.parametrize("shape", [(), (1,), (3,), (1, 2), (2, 2), (0,)])
def test_actions_of_another_shape_are_refused_and_not_broadcast(shape):
    env = gymnasium.make(_IDS["ur5_reacher"]).unwrapped
    right = env.action_space.shape
    if shape == right:
        pytest.skip("that is its shape")
    env.reset(seed=0)
    with pytest.raises(ValueError, match=re.escape(f"an action has shape {right}, got {shape}")):
        env.step(np.zeros(shape))
    many = gymnasium.make_vec(_IDS["ur5_reacher"], num_envs=4)
    many.reset(seed=0)
    with pytest.raises(ValueError, match=re.escape(f"an action has shape (4, {right[0]})")):
        many.step(np.zeros(shape))


def test_a_closed_environment_says_so():
    env = gymnasium.make(_IDS["pendulum_climb"]).unwrapped
    env.reset(seed=0)
    env.close()
    env.close()  # again
    for use in (env.reset, lambda: env.step(np.zeros(1)), lambda: env._env.render(0)):
        with pytest.raises(ValueError, match="pendulum_climb is closed; make another"):
            use()


@pytest.mark.parametrize("number", [0, -1, 10**9])
def test_a_number_of_environments_that_nobody_means_is_refused_at_once(number):
    with pytest.raises(ValueError, match=f"num_envs must be from 1 to 100000, got {number}"):
        tasks.load_vector("pendulum_climb", number)


def test_a_wrapped_environment_is_copied_with_its_time_limit():
    env = gymnasium.make(_IDS["pendulum_climb"], max_episode_steps=7)
    env.reset(seed=0)
    [env.step(np.zeros(1)) for _ in range(5)]
    twin = copy.deepcopy(env)
    assert [twin.step(np.zeros(1))[3] for _ in range(2)] == [False, True]


def test_without_gl_rendering_says_what_to_set():
    made = subprocess.run(
        [sys.executable, "-c", _RENDER], capture_output=True, text=True, cwd=ROOT,
        env={**os.environ, "MUJOCO_GL": "disabled"},
    )  # fmt: skip
    assert made.returncode == 1
    last = made.stderr.strip().splitlines()[-1]
    assert re.match(r"RuntimeError: rendering failed.*MUJOCO_GL=egl.*'disabled'.*doctor", last)


_RENDER = """
import gymnasium
env = gymnasium.make("tasks:HACSuite/PendulumClimb-v0", render_mode="rgb_array")
env.reset(seed=0)
env.render()
"""


# -- Many at once


@pytest.mark.parametrize("name", ["pendulum_climb", "pick_place"])
def test_make_vec_takes_the_fast_path_and_plays_the_same(name):
    made = {
        mode: gymnasium.make_vec(
            _IDS[name], 3, vectorization_mode=mode, max_episode_steps=6, test=True
        )
        for mode in ("sync", None)
    }
    sync, fast = made["sync"], made[None]
    assert type(fast.unwrapped).__name__ == "GoalVectorEnv"
    assert fast.single_observation_space == sync.single_observation_space
    assert fast.action_space == sync.action_space
    results = [envs.reset(seed=5, options={"test": False}) for envs in (sync, fast)]
    _assert_same(*results)
    random_state = np.random.RandomState(0)
    for _ in range(16):  # over two ends of episodes
        actions = random_state.uniform(-1, 1, fast.action_space.shape)
        _assert_same(*(envs.step(actions) for envs in (sync, fast)))
    assert fast.goal_space is tasks.spec(name).goal_space


def _assert_same(one, other):
    for a, b in zip(one, other, strict=True):
        if isinstance(a, dict):
            assert a.keys() == b.keys()
            for key in a:
                np.testing.assert_array_equal(a[key], b[key], key)
        else:
            np.testing.assert_array_equal(a, b)


def test_make_vec_ends_an_episode_at_the_goal_and_begins_another():
    envs = gymnasium.make_vec(_IDS["pendulum_climb"], 2)
    envs.reset(seed=0)
    envs.unwrapped._env._goals[1] = envs.step(np.zeros((2, 1)))[0]["achieved_goal"][1]
    _, rewards, terminated, truncated, infos = envs.step(np.zeros((2, 1)))
    assert (rewards.tolist(), terminated.tolist()) == ([-1, 0], [False, True])
    assert infos["is_success"].tolist() == [False, True] and not truncated.any()
    observations, rewards, terminated, *_ = envs.step(np.ones((2, 1)))
    assert rewards.tolist() == [-1, 0] and not terminated.any()
    np.testing.assert_array_equal(observations["desired_goal"][1], [0.0, 1.3])


def test_make_vec_resets_those_of_a_mask_and_refuses_wrong_options():
    envs = gymnasium.make_vec(_IDS["pendulum_climb"], 2)
    before, _ = envs.reset(seed=[3, 4])
    mask = np.array([False, True])
    after, _ = envs.reset(options={"reset_mask": mask})
    same = (after["observation"] == before["observation"]).all(axis=1)
    assert same.tolist() == [True, False]
    with pytest.raises(ValueError, match="no option 'tset'"):
        envs.reset(options={"tset": True})
    with pytest.raises(ValueError, match="1 numbers for 2"):
        envs.reset(seed=[1])


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
