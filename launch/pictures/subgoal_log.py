"""Replays test episodes of a policy, and records every subgoal with its outcome."""

from typing import NamedTuple

import numpy as np

import hac_suite
import tasks
from hac_suite.algorithm import exploration
from launch.asking import settings

WORDS = {
    hac_suite.Outcome.ACHIEVED: "achieved",
    hac_suite.Outcome.MISSED: "missed",
    hac_suite.Outcome.CUT_SHORT: "cut short",
}


class LoggedSubgoal(NamedTuple):
    """One subgoal of one episode. Positions are points of the subgoal space, in natural units."""

    episode: int  # index within the replay
    level: int  # that proposed it; 1 is the lowest that proposes
    step: int  # actions taken before it was proposed
    end_step: int
    outcome: str
    subgoal: np.ndarray  # [H]
    start: np.ndarray  # [H] where the agent was when it was proposed
    end: np.ndarray  # [H] where it was when the subgoal was given up or achieved
    observation: np.ndarray  # [D] when it was proposed


class Replayed(NamedTuple):
    """N test episodes of a policy, those of its test periods."""

    policy: hac_suite.Policy
    stats: hac_suite.EpisodeStats
    subgoals: list[LoggedSubgoal]
    path: np.ndarray  # [steps + 1, N, H]; an episode that is over stays where it ended
    goal: np.ndarray  # [N, G]
    achieved_goal: np.ndarray  # [steps + 1, N, G]; as `path`


class SubgoalLog:
    """Takes the `on_step` calls of `hac_suite.run_episodes`; `Replayed` says what it collects."""

    def __init__(self, env: hac_suite.VectorEnv, horizons: tuple[int, ...]):
        self.subgoals: list[LoggedSubgoal] = []
        self.path: list[np.ndarray] = []
        self.achieved_goal: list[np.ndarray] = []
        self.goal = np.zeros((env.num_envs, env.goal_space.dim))
        levels = len(horizons) - 1
        self._step = np.zeros((levels, env.num_envs), np.int64)
        self._start = np.zeros((levels, env.num_envs, env.subgoal_space.dim))
        self._observation = np.zeros((levels, env.num_envs, len(env.observation_scale)))
        self._running = np.zeros(env.num_envs, bool)

    def on_step(self, view: hac_suite.StepView) -> None:
        """Notes the subgoals that ended with this step, and where their successors begin."""
        state = view.env_step
        self.path.append(state.achieved_subgoal.copy())
        self.achieved_goal.append(state.achieved_goal.copy())
        self.goal = state.desired_goal.copy()
        begins = np.tile(view.active, (len(self._step), 1)) if view.step == 0 else self._end(view)
        for level, new in enumerate(begins):
            self._step[level][new] = view.step
            self._start[level][new] = state.achieved_subgoal[new]
            self._observation[level][new] = state.observation[new]
        self._running = view.active.copy()

    def _end(self, view: hac_suite.StepView) -> np.ndarray:
        """Keeps what ended; returns it as bool [levels, N]."""
        outcomes = np.reshape(view.outcomes, self._step.shape)
        ended = (outcomes != hac_suite.Outcome.OPEN) & self._running
        for level in reversed(range(len(ended))):
            for i in np.flatnonzero(ended[level]).tolist():
                self._keep(level, i, WORDS[outcomes[level, i]], view)
        return ended

    def _keep(self, level: int, i: int, outcome: str, view: hac_suite.StepView) -> None:
        self.subgoals.append(
            LoggedSubgoal(
                episode=i,
                level=level + 1,
                step=int(self._step[level, i]),
                end_step=view.step,
                outcome=outcome,
                subgoal=view.subgoals[level][i].copy(),
                start=self._start[level, i].copy(),
                end=view.env_step.achieved_subgoal[i].copy(),
                observation=self._observation[level, i].copy(),
            )
        )


def replay(policy: hac_suite.Policy, episodes: int) -> Replayed:
    """Plays the first test episodes of the policy's own seed again.

    Raises:
      CommandError, KeyError, TypeError, ValueError: the policy's description is incomplete or of
        another task.
    """
    config = settings.to_config(policy.metadata["config"])
    seeds = exploration.episode_seeds(
        policy.metadata["seed"], exploration.Purpose.TEST_EPISODE, 0, episodes
    )
    env = tasks.load_vector(policy.metadata["task"], episodes)
    log = SubgoalLog(env, policy.horizons)
    stats = hac_suite.run_episodes(env, policy, seeds, config=config, on_step=log.on_step)
    env.close()
    path, achieved_goal = np.stack(log.path), np.stack(log.achieved_goal)
    return Replayed(policy, stats, log.subgoals, path, log.goal, achieved_goal)
