"""Decides whether a goal is achieved by the environment's own rule instead of a box."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from tasks import goal_space
from tasks.errors import one_line

Judge = Callable[[np.ndarray, np.ndarray], np.ndarray]  # achieved, goal [..., G] -> bool [...]

_NEEDS_INFO = (
    "{word}: compute_reward(achieved_goal, desired_goal, {{}}) failed: {error}. It must return a "
    "number for any two goals and an empty info, because hindsight compares goals that were never "
    "played; or give --goal_threshold"
)
_ALWAYS = (
    "{word}: its compute_reward is {only} for all of {count} pairs of goals, so it does not show "
    "when a goal is achieved; give --goal_threshold"
)
_DENSE = (
    "{word}: its compute_reward gives {count} different rewards, so it does not show when a goal "
    'is achieved: use sparse rewards (often --task_args=\'{{"reward_type": "sparse"}}\'), or give '
    "--goal_threshold"
)
_NOT_BEST = (
    "{word}: its compute_reward is {at} at the goal itself and {best} elsewhere, so it does not "
    "show when a goal is achieved; give --goal_threshold"
)


@dataclasses.dataclass(frozen=True)
class JudgedSpace(goal_space.GoalSpace):
    """A space of end goals with a separate judge of when they are achieved.

    Its bounds are as in other spaces. Its thresholds only describe the judge: half the width of the
    region that achieves a goal, along each dimension.
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


def by_box(threshold: np.ndarray) -> Judge:
    """A judge by the distance [G] in each dimension."""
    return lambda achieved, goal: (np.abs(achieved - goal) <= threshold).all(axis=-1)


def by_reward(
    word: str,
    compute_reward: Callable[..., Any],
    shape: tuple[int, ...],
    dtype: Any,
    achieved: np.ndarray,
    goals: np.ndarray,
) -> Judge:
    """A judge that asks a Gymnasium goal environment's `compute_reward`.

    A goal is achieved if the reward equals that of being exactly at the goal. Rewards are computed
    in batches if that gives the same, and else one by one.

    Args:
      shape, dtype: of the environment's goals, which are flat here.
      achieved, goals: [K, G] pairs that were seen, to find out which rewards there are.

    Raises:
      ValueError: the rewards do not show when a goal is achieved; one line says what to do.
    """

    rewards = _Rewards(compute_reward, shape, dtype)
    # Those of other episodes as well: one's own may all begin at the goal.
    a = np.concatenate([goals, achieved, np.roll(achieved, len(achieved) // 2, axis=0)])
    g = np.concatenate([goals, goals, goals])
    try:
        found = rewards.one_by_one(a, g)
    except Exception as error:  # another's function can raise anything
        reason = one_line(error)
        raise ValueError(_NEEDS_INFO.format(word=word, error=reason)) from error
    least = _least_of_success(word, found, len(goals))
    ask = rewards.at_once if _same(rewards.at_once, a, g, found) else rewards.one_by_one
    return lambda a, g: (
        ask(a.reshape(-1, a.shape[-1]), g.reshape(-1, g.shape[-1])).reshape(a.shape[:-1]) >= least
    )


class _Rewards:
    """What an environment's `compute_reward` says of achieved goals and goals: [K, G] each, [K]."""

    def __init__(self, compute_reward: Callable[..., Any], shape: tuple[int, ...], dtype: Any):
        self._compute_reward, self._shape, self._dtype = compute_reward, shape, dtype

    def one_by_one(self, achieved: np.ndarray, goals: np.ndarray) -> np.ndarray:
        pairs = zip(self._own(achieved), self._own(goals), strict=True)
        rewards = [self._compute_reward(a, g, {}) for a, g in pairs]
        return np.array([np.asarray(reward, np.float64).item() for reward in rewards])

    def at_once(self, achieved: np.ndarray, goals: np.ndarray) -> np.ndarray:
        rewards = self._compute_reward(self._own(achieved), self._own(goals), {})
        return np.asarray(rewards, np.float64).reshape(len(achieved))

    def _own(self, goals: np.ndarray) -> np.ndarray:
        """As the environment has them; of whole numbers the nearest."""
        whole = np.rint(goals) if np.issubdtype(self._dtype, np.integer) else goals
        return whole.astype(self._dtype).reshape(len(goals), *self._shape)


def _least_of_success(word: str, rewards: np.ndarray, at_goal: int) -> float:
    """Between the reward at the goal (the first `at_goal` pairs) and the one elsewhere."""
    values = np.unique(rewards)
    best = rewards[:at_goal].min()
    if len(values) == 1:
        raise ValueError(_ALWAYS.format(word=word, only=best, count=len(rewards)))
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
    """How far along each dimension, either way, a goal still counts as achieved: [G].

    By bisection.

    Args:
      goals: [K, G]; the median over them is given.
      most: [G] what is not searched beyond.
    """
    widths = np.zeros((len(goals), len(most)))
    for dimension in range(len(most)):
        inside, outside = np.zeros(len(goals)), np.full(len(goals), most[dimension])
        for _ in range(30):
            middle = (inside + outside) / 2
            step = np.eye(len(most))[dimension] * middle[:, None]
            holds = judge(goals + step, goals) & judge(goals - step, goals)
            inside, outside = np.where(holds, middle, inside), np.where(holds, outside, middle)
        widths[:, dimension] = inside
    return np.median(widths, axis=0)
