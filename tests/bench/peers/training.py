"""A peer's curve: trained on our Gymnasium environments, tested on the same episodes as ours."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

import tasks
from hac_suite.algorithm import exploration
from hac_suite.algorithm.exploration import Purpose
from hac_suite.config import PAPER
from tests.bench.peers import agents

Act = Callable[[dict[str, np.ndarray]], np.ndarray]


def train(
    agent: str,
    settings: str,
    task: str,
    seed: int,
    *,
    episodes: int,
    minutes: float,
    test_every: int = PAPER.episodes_per_period,
) -> list[dict[str, Any]]:
    """Trains one agent; the rows of its curve, the untrained one first.

    Their columns are `analysis.statistics.peers.COLUMNS`.

    Args:
      episodes: training ends after so many,
      minutes: or once it has taken so many core-minutes, whichever comes first.
      test_every: training episodes between tests; there is one at the end as well.
    """
    model = agents.make(agent, settings, task, seed)
    curve = Curve(Tests(task, seed), episodes, minutes, test_every)
    steps = episodes * model.get_env().get_attr("max_steps")[0]
    # One step more than there can be: the last test comes when another episode is to begin.
    model.learn(steps + 1, callback=curve, log_interval=None)
    model.get_env().close()
    whose = {"task": task, "agent": agent, "settings": settings, "seed": seed}
    return [{**whose, **row} for row in curve.rows]


class Curve(BaseCallback):
    """Tests a training where its updates are done, and ends it.

    Attributes:
      rows: a test each. Core-minutes are the process's time, on all its cores, without the tests.
    """

    def __init__(self, tests: "Tests", episodes: int, minutes: float, test_every: int):
        super().__init__()
        self._tests, self._test_every = tests, test_every
        self._episodes, self._minutes = episodes, minutes
        self._played = 0
        self._over = False
        self._testing = 0.0  # seconds
        self.rows: list[dict[str, Any]] = []

    def _on_training_start(self) -> None:
        self._started = time.process_time()
        self._test(0.0)

    def _on_rollout_start(self) -> None:
        minutes = (time.process_time() - self._started - self._testing) / 60
        self._over = self._played >= self._episodes or minutes >= self._minutes
        if self._over or self._played >= self.rows[-1]["train_episodes"] + self._test_every:
            self._test(minutes)

    def _on_step(self) -> bool:
        self._played += int(self.locals["dones"].sum())
        return not self._over

    def _test(self, minutes: float) -> None:
        start = time.process_time()
        success = self._tests.success(self._act)
        self._testing += time.process_time() - start
        self.rows.append(
            {
                "train_episodes": self._played,
                "train_steps": self.num_timesteps,
                "core_minutes": round(minutes, 4),
                "success_rate": float(success.mean()),
                "test_episodes": len(success),
            }
        )

    def _act(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        scaler = self.model.get_vec_normalize_env()
        seen = observation if scaler is None else scaler.normalize_obs(observation)
        return self.model.predict(seen, deterministic=True)[0]


class Tests:
    """The test episodes of a seed, those of our agents: the same starts, goals and judge.

    Not played on the Gymnasium face, whose episodes follow from a seed in another way than ours.
    """

    __test__ = False  # no class of tests for pytest

    def __init__(self, task: str, seed: int, episodes: int = PAPER.test_episodes):
        self._env = tasks.load_vector(task, episodes)
        self.seeds = exploration.episode_seeds(seed, Purpose.TEST_EPISODE, 0, episodes)

    def success(self, act: Act) -> np.ndarray:
        """Whether each episode achieved its goal: bool [N].

        Args:
          act: actions [N, A] in [-1, 1] for observations as the Gymnasium face has them.
        """
        env = self._env
        step = env.reset(self.seeds, test=True)
        success, active = np.zeros(env.num_envs, bool), ~step.diverged
        for _ in range(env.max_steps):
            if not active.any():
                break
            keys = ("observation", "achieved_goal", "desired_goal")
            action = act({key: getattr(step, key) for key in keys}).astype(np.float64)
            half_range = (env.action_high - env.action_low) / 2
            step = env.step(env.action_low + (action + 1) * half_range, active)
            achieved = env.goal_space.achieved(step.achieved_goal, step.desired_goal)
            success |= active & achieved & ~step.diverged
            active &= ~(success | step.diverged)
        return success
