"""Whether a goal is achieved, where the environment and not a box is the judge."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from tasks import goal_space

Judge = Callable[[np.ndarray, np.ndarray], np.ndarray]  # achieved, goal [..., G] -> bool [...]

_NEEDS_INFO = "{word}: compute_reward(achieved_goal, desired_goal, {{}}) failed: {error}"
_DENSE = (
    "{word}: its compute_reward gives {count} different rewards, so it does not say what counts as "
    'achieved: ask for sparse rewards (often --task_args=\'{{"reward_type": "sparse"}}\'), or give '
    "--goal_threshold"
)
_NOT_BEST = (
    "{word}: its compute_reward is {at} at the goal itself and {best} elsewhere, so it does not "
    "say what counts as achieved; give --goal_threshold"
)


@dataclasses.dataclass(frozen=True)
class JudgedSpace(goal_space.GoalSpace):
    """A space of end goals in which somebody else says what achieves a goal.

    Its bounds are as everywhere. Its thresholds only describe: half the width of what is achieved,
    along each dimension.
    """

    judge: Judge = dataclasses.field(kw_only=True)

    def achieved(self, achieved: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """What the judge says; numbers that are not finite achieve nothing."""
        achieved, goal = np.broadcast_arrays(achieved, goal)
        finite = np.isfinite(achieved).all(axis=-1) & np.isfinite(goal).all(axis=-1)
        found = np.zeros(finite.shape, bool)
        if finite.any():
            found[finite] = self.judge(achieved[finite], goal[finite])
        return found


def by_reward(
    word: str,
    compute_reward: Callable[..., Any],
    shape: tuple[int, ...],
    dtype: Any,
    achieved: np.ndarray,
    goals: np.ndarray,
) -> Judge:
    """A judge that asks a Gymnasium goal environment's `compute_reward`.

    What is achieved earns the reward of being exactly at the goal. Rewards for many pairs at once
    are asked for where that gives the same, and else one by one.

    Args:
      shape, dtype: of the environment's goals, which are flat here.
      achieved, goals: [K, G] pairs that were seen, to find out which rewards there are.

    Raises:
      ValueError: the rewards do not tell achieved from not; one line says what to do.
    """

    def one(a: np.ndarray, g: np.ndarray) -> float:
        return float(
            compute_reward(a.astype(dtype).reshape(shape), g.astype(dtype).reshape(shape), {})
        )

    def one_by_one(a: np.ndarray, g: np.ndarray) -> np.ndarray:
        return np.array([one(x, y) for x, y in zip(a, g, strict=True)])

    def at_once(a: np.ndarray, g: np.ndarray) -> np.ndarray:
        many = (len(a), *shape)
        rewards = compute_reward(a.astype(dtype).reshape(many), g.astype(dtype).reshape(many), {})
        return np.asarray(rewards, np.float64)

    a, g = np.concatenate([goals, achieved]), np.concatenate([goals, goals])
    try:
        rewards = one_by_one(a, g)
    except Exception as error:  # another's function can raise anything
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise ValueError(_NEEDS_INFO.format(word=word, error=reason)) from error
    least = _least_of_success(word, rewards, len(goals))
    rewards_of = at_once if _same(at_once, a, g, rewards) else one_by_one
    return lambda a, g: (
        rewards_of(a.reshape(-1, a.shape[-1]), g.reshape(-1, g.shape[-1])).reshape(a.shape[:-1])
        >= least
    )


def _least_of_success(word: str, rewards: np.ndarray, at_goal: int) -> float:
    """Between the reward at the goal (the first `at_goal` pairs) and the one elsewhere."""
    values = np.unique(rewards)
    best = rewards[:at_goal].min()
    if len(values) > 2:
        raise ValueError(_DENSE.format(word=word, count=len(values)))
    if best < values[-1]:
        raise ValueError(_NOT_BEST.format(word=word, at=best, best=values[-1]))
    return float(values.mean())


def _same(at_once: Callable, a: np.ndarray, g: np.ndarray, rewards: np.ndarray) -> bool:
    """Whether many pairs at once get the rewards that they get one by one."""
    try:
        return bool(np.array_equal(at_once(a, g), rewards))
    except Exception:  # it was not written for arrays
        return False


def half_widths(judge: Judge, goals: np.ndarray, most: np.ndarray) -> np.ndarray:
    """How far along each dimension from a goal it still counts as achieved, by bisection: [G].

    Args:
      goals: [K, G]; the median over them is given.
      most: [G] what is not searched beyond.
    """
    widths = np.zeros((len(goals), len(most)))
    for dimension in range(len(most)):
        inside, outside = np.zeros(len(goals)), np.full(len(goals), most[dimension])
        for _ in range(30):
            middle = (inside + outside) / 2
            moved = goals.copy()
            moved[:, dimension] += middle
            holds = judge(moved, goals)
            inside, outside = np.where(holds, middle, inside), np.where(holds, outside, middle)
        widths[:, dimension] = inside
    return np.median(widths, axis=0)
