"""The Gymnasium face: registration, the checkers of two libraries, and training with one."""

import warnings

import gymnasium
import numpy as np
import pytest
import stable_baselines3
import torch
from gymnasium.utils import env_checker
from stable_baselines3.common import env_checker as sb3_env_checker

import tasks
from tasks import to_gymnasium

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
    steps = tasks.load_vector("pendulum_balance", 1).max_steps
    ends = [env.step(np.zeros(1))[2:4] for _ in range(steps)]
    assert ends == [(False, False)] * (steps - 1) + [(False, True)]


def test_a_diverged_episode_is_truncated_and_says_so():
    env = gymnasium.make(_IDS["pendulum_climb"])
    env.reset(seed=0)
    env.unwrapped._env._data[0].qvel[0] = 1e12
    _, reward, terminated, truncated, info = env.step(np.zeros(1))
    assert (reward, terminated, truncated) == (-1.0, False, True)
    assert info == {"is_success": False, "diverged": True}


def test_unknown_render_mode_is_refused():
    with pytest.raises(ValueError, match="rgb_array"):
        to_gymnasium.GoalEnv("pendulum_climb", render_mode="human")


@pytest.fixture
def one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


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
