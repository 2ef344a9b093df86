"""The peers: stable-baselines3's agents with HerReplayBuffer, on our Gymnasium environments.

What is the library's own stays: its networks also see the achieved goal, it chooses hindsight goals
when it draws a batch, and a hindsight goal that is achieved ends no episode.
"""

import copy
from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import torch
from stable_baselines3 import DDPG, SAC, TD3, HerReplayBuffer
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import hac_suite
from hac_suite.algorithm import exploration
from hac_suite.algorithm.exploration import Purpose
from tasks.to_gymnasium import GoalEnv, environment_id

AGENTS = {"ddpg": DDPG, "sac": SAC, "td3": TD3}


class Settings(NamedTuple):
    """How an agent is set up."""

    updates: int | None  # gradient steps after an episode; None: the zoo's, one after each step
    hindsight_goals: int  # for each real transition of a batch


SETTINGS = {
    "zoo": Settings(None, 4),
    "ours20": Settings(20, 4),
    "ours40": Settings(40, 4),
    "ours20k2": Settings(20, 2),
    "ours40k2": Settings(40, 2),
}

# rl-baselines3-zoo, hyperparams/sac.yml, FetchReach-v1 (commit 22e3ff2): the only goal task for
# which it has SAC's settings. https://github.com/DLR-RM/rl-baselines3-zoo
_ZOO: dict[str, Any] = {
    "buffer_size": 1_000_000,
    "batch_size": 256,
    "gamma": 0.95,
    "learning_rate": 1e-3,
    "learning_starts": 1000,
    "policy_kwargs": {"net_arch": [64, 64]},
    "train_freq": 1,
    "gradient_steps": 1,
}
# Its td3.yml and ddpg.yml have no goal task. Both agents have SAC's settings above, their own
# defaults for the rest, and the noise that her.yml gave them on goal tasks (parking-v0, commit
# 00aaec2).
_ZOO_NOISE = 0.2


def make(agent: str, settings: str, task: str, seed: int) -> Any:
    """An untrained agent of `AGENTS` by `SETTINGS` on a task, one environment in its hands."""
    chosen = SETTINGS[settings]
    if chosen.updates is None:
        return _by_the_zoo(agent, chosen, task, seed)
    return _by_us(agent, chosen, chosen.updates, task, seed)


def _by_the_zoo(agent: str, settings: Settings, task: str, seed: int) -> Any:
    # `normalize: True` of the zoo: observations and rewards, by what was seen so far.
    env = VecNormalize(DummyVecEnv([lambda: _environment(task)]), gamma=_ZOO["gamma"])
    own = {"ent_coef": "auto"} if agent == "sac" else {"action_noise": _noise(env, _ZOO_NOISE)}
    # A copy: the library adds to the policy's settings.
    return AGENTS[agent](**_common(env, settings, seed), **copy.deepcopy(_ZOO), **own)


def _by_us(agent: str, settings: Settings, updates: int, task: str, seed: int) -> Any:
    """Our flat agent's networks, batches, rates, scales and exploration."""
    config, env = hac_suite.PRESETS["suite"], _environment(task)
    own = {} if agent == "sac" else {"action_noise": _noise(env, config.action_noise)}
    model = AGENTS[agent](
        **_common(env, settings, seed),
        buffer_size=config.replay_capacity,
        batch_size=config.batch_size,
        gamma=config.discount,
        learning_rate=config.learning_rate,
        learning_starts=1,
        tau=config.target_rate,
        policy_kwargs={
            "net_arch": list(config.hidden_sizes),
            "features_extractor_class": ScaledInputs,
            "features_extractor_kwargs": {"env": env.unwrapped},
        },
        train_freq=(1, "episode"),
        gradient_steps=updates,
        **own,
    )
    random = exploration.stream(seed, Purpose.EXPLORE)
    model._sample_action = sometimes_random(model._sample_action, config.random_action_rate, random)
    return model


def _common(env: Any, settings: Settings, seed: int) -> dict[str, Any]:
    return {
        "policy": "MultiInputPolicy",
        "env": env,
        "replay_buffer_class": HerReplayBuffer,
        "replay_buffer_kwargs": {
            "n_sampled_goal": settings.hindsight_goals,
            "goal_selection_strategy": "future",
        },
        "seed": seed,
        "device": "cpu",
    }


def _environment(task: str) -> gymnasium.Env:
    return gymnasium.make(environment_id(task))


def _noise(env: Any, sigma: float) -> NormalActionNoise:
    shape = env.action_space.shape
    return NormalActionNoise(np.zeros(shape), np.full(shape, sigma))


def sometimes_random(
    sample_action: Callable[..., tuple[np.ndarray, np.ndarray]],
    rate: float,
    random: np.random.Generator,
) -> Callable[..., tuple[np.ndarray, np.ndarray]]:
    """Has an agent act, and store, a uniform action at this rate instead of its own.

    Not an action noise of the library: that is added to what the policy says.
    """

    def call(*args: Any, **kwargs: Any) -> tuple[np.ndarray, np.ndarray]:
        action, stored = sample_action(*args, **kwargs)
        if random.random() < rate:
            # Actions lie in [-1, 1], so what is done and what is stored are the same.
            action = stored = random.uniform(-1, 1, action.shape).astype(action.dtype)
        return action, stored

    return call


class ScaledInputs(BaseFeaturesExtractor):
    """Observations over the task's scale, goals at [-1, 1] on their bounds, as our networks see."""

    centre: torch.Tensor
    scale: torch.Tensor

    def __init__(self, observation_space: gymnasium.spaces.Dict, env: GoalEnv):
        space, observed = env.goal_space, env.observation_scale
        goal = ((space.low + space.high) / 2, (space.high - space.low) / 2)
        parts = {
            "observation": (np.zeros_like(observed), observed),
            "achieved_goal": goal,
            "desired_goal": goal,
        }
        keys = list(observation_space.spaces)
        centre, scale = (np.concatenate([parts[key][i] for key in keys]) for i in (0, 1))
        super().__init__(observation_space, features_dim=len(centre))
        self._keys = keys
        self.register_buffer("centre", torch.as_tensor(centre, dtype=torch.float32))
        self.register_buffer("scale", torch.as_tensor(scale, dtype=torch.float32))

    def forward(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        """The networks' inputs [N, features]."""
        together = torch.cat([observations[key] for key in self._keys], dim=1)
        return (together - self.centre) / self.scale
