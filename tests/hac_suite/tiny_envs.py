"""A tiny environment in numpy: the vectorised contract of the tasks with nothing to simulate."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from tasks.goal_space import GoalSpace

PUSH = 0.2  # how much of an action becomes velocity
FRICTION = 0.5  # how much velocity is left after a step


class Step(NamedTuple):
    """What the agent sees of every environment; the fields of `tasks.vector.VectorStep`."""

    observation: np.ndarray  # [N, 4]: position, velocity
    achieved_goal: np.ndarray  # [N, 1]: x
    achieved_subgoal: np.ndarray  # [N, 2]: position
    desired_goal: np.ndarray  # [N, 1]
    diverged: np.ndarray  # [N] bool
    failed: np.ndarray | None = None  # [N] bool


class PointEnv:
    """Points pushed about a plane. The end goal is an x, a subgoal is a whole position.

    The thresholds are about two steps wide, so that an agent that moves at random achieves goals
    often, misses them often, and often ends where its goal already held.
    """

    name = "point"
    observation_dim = 4

    def __init__(
        self,
        num_envs: int,
        seed: int = 0,
        *,
        max_steps: int = 12,
        goal_threshold: float = 0.1,
        subgoal_threshold: float = 0.3,
        diverge_at: Mapping[int, int] | None = None,
        fail_beyond: float = np.inf,
        drift: float = 0.0,
    ):
        """Args that few tests use:

        diverge_at: maps an environment to the step (from 0) of each episode that blows up.
        fail_beyond: an episode fails with |y - 0.5| above this, but for states at the goal.
        drift: how far the end goal moves with each step.
        """
        self._fail_beyond, self._drift = fail_beyond, drift
        self.num_envs = num_envs
        self.max_steps = max_steps
        # Not centred on 0 and not of unit width, so that a forgotten scaling shows.
        self.action_low, self.action_high = np.array([-1.0, 0.0]), np.array([1.0, 3.0])
        self.observation_scale = np.ones(4)
        self.goal_space = GoalSpace(
            names=("x",),
            units=("m",),
            low=np.array([-1.5]),
            high=np.array([1.5]),
            threshold=np.array([goal_threshold]),
        )
        self.subgoal_space = GoalSpace(
            names=("x", "y"),
            units=("m", "m"),
            low=np.array([-1.0, -0.5]),
            high=np.array([1.0, 1.5]),
            threshold=np.array([subgoal_threshold, 2 * subgoal_threshold]),
        )
        self._diverge_at = np.full(num_envs, max_steps)  # A step no episode reaches.
        for env, step in (diverge_at or {}).items():
            self._diverge_at[env] = step
        self._seeds = np.random.default_rng(seed)
        self._steps = np.zeros(num_envs, int)
        self._position = np.zeros((num_envs, 2))
        self._velocity = np.zeros((num_envs, 2))
        self._goal = np.zeros((num_envs, 1))
        self._diverged = np.zeros(num_envs, bool)

    def reset(
        self,
        seeds: np.ndarray | None = None,
        *,
        mask: np.ndarray | None = None,
        test: bool = False,
    ) -> Step:
        """Starts an episode in every environment of the mask; a seed fully decides it.

        Training starts lie anywhere in |x| < 0.5, test starts at the far left.
        """
        if seeds is None:
            seeds = self._seeds.integers(2**32, size=self.num_envs)
        for env in np.flatnonzero(np.ones(self.num_envs, bool) if mask is None else mask):
            rng = np.random.default_rng(int(seeds[env]))
            self._position[env] = [-1.0, 0.5] if test else rng.uniform([-0.5, 0.0], [0.5, 1.0])
            self._velocity[env] = 0.0
            self._goal[env] = rng.uniform(-0.5, 0.5)
            self._steps[env] = 0
            self._diverged[env] = False
        return self._view()

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> Step:
        """One step of every environment of the mask that has not diverged."""
        moving = ~self._diverged if mask is None else mask & ~self._diverged
        if not np.isfinite(actions[moving]).all():
            raise ValueError("an action is not finite")
        self._diverged |= moving & (self._steps == self._diverge_at)
        self._steps[moving] += 1
        moving &= ~self._diverged
        middle = 0.5 * (self.action_low + self.action_high)
        push = PUSH * (np.clip(actions, self.action_low, self.action_high) - middle)
        self._velocity[moving] = FRICTION * self._velocity[moving] + push[moving]
        self._position[moving] += self._velocity[moving]
        self._goal[moving] += self._drift
        return self._view()

    def _view(self) -> Step:
        return Step(
            observation=np.concatenate([self._position, self._velocity], axis=1),
            achieved_goal=self._position[:, :1].copy(),
            achieved_subgoal=self._position.copy(),
            desired_goal=self._goal.copy(),
            diverged=self._diverged.copy(),
            failed=self._failed(),
        )

    def _failed(self) -> np.ndarray:
        at_goal = self.goal_space.achieved(self._position[:, :1], self._goal)
        return (np.abs(self._position[:, 1] - 0.5) > self._fail_beyond) & ~at_goal
