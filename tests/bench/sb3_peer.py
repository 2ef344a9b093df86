"""stable-baselines3's DDPG with HerReplayBuffer, on our Gymnasium face: a flat agent's peer.

Its networks also see the achieved goal, one of the entries of what the face shows: a few more
inputs, the same layers. Hindsight goals are chosen when a batch is drawn, not when an episode ends.
"""

from collections.abc import Sequence

import gymnasium
import numpy as np
from stable_baselines3 import DDPG, HerReplayBuffer
from stable_baselines3.common.noise import NormalActionNoise

import hac_suite
import tasks
from tasks.to_gymnasium import environment_id
from tests.bench.work import Meter, Work, total, whole_horizon

_NEVER = 2**31  # episodes between log lines


class Sb3Agents:
    """One agent for each seed, trained one after another; no logging and no evaluation."""

    def __init__(self, task: str, config: hac_suite.Config, seeds: Sequence[int]):
        self._agents = [_Agent(task, config, seed) for seed in seeds]

    def __call__(self, episodes: int) -> Work:
        """Trains every agent for so many episodes more."""
        return total([agent.train(episodes) for agent in self._agents])


class _Agent:
    """A DDPG whose gradient steps, environment steps and seconds are counted."""

    def __init__(self, task: str, config: hac_suite.Config, seed: int):
        self._meter = meter = Meter()
        face = gymnasium.make(environment_id(task))
        bare = face.unwrapped
        whole_horizon(bare._env)  # type: ignore[attr-defined]
        bare.step = meter.timed("physics", _counted(bare.step, meter))  # type: ignore[method-assign]
        bare.reset = meter.timed("physics", bare.reset)  # type: ignore[method-assign]
        self._max_steps = tasks.load_vector(task, 1).max_steps
        self._model = model = ddpg(face, config, seed)
        model.train = meter.timed("updates", model.train)  # type: ignore[method-assign]
        self._critic_steps = 0
        model.actor.optimizer.register_step_post_hook(self._count_update)
        model.critic.optimizer.register_step_post_hook(self._count_critic_step)

    def _count_update(self, *_) -> None:
        self._meter.updates += 1

    def _count_critic_step(self, *_) -> None:
        self._critic_steps += 1

    def train(self, episodes: int) -> Work:
        """Trains for so many whole episodes."""
        self._critic_steps = 0
        steps = episodes * self._max_steps
        work = self._meter.measure(
            lambda: self._model.learn(steps, log_interval=_NEVER, reset_num_timesteps=False)
        )
        assert work.updates == self._critic_steps, "an update is a step of actor and critic"
        return work


def ddpg(env: gymnasium.Env, config: hac_suite.Config, seed: int) -> DDPG:
    """The library's agent with our flat agent's networks, batches, updates and rates."""
    actions = env.action_space.shape
    assert actions is not None
    return DDPG(
        "MultiInputPolicy",
        env,
        learning_rate=config.learning_rate,
        buffer_size=config.replay_capacity,
        learning_starts=1,
        batch_size=config.batch_size,
        tau=config.target_rate,
        gamma=config.discount,
        train_freq=(1, "episode"),
        gradient_steps=config.updates_per_episode,
        action_noise=NormalActionNoise(np.zeros(actions), np.full(actions, config.action_noise)),
        replay_buffer_class=HerReplayBuffer,
        # For each real transition of a batch, so many with goals achieved later in the episode.
        replay_buffer_kwargs={
            "n_sampled_goal": config.hindsight_goals,
            "goal_selection_strategy": "future",
        },
        policy_kwargs={"net_arch": list(config.hidden_sizes)},
        seed=seed,
        device="cpu",
        verbose=0,
    )


def _counted(step, meter: Meter):
    def call(action):
        meter.env_steps += 1
        return step(action)

    return call
