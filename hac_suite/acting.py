"""One agent in one episode that the caller steps: an observation in, an action out."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from hac_suite.algorithm.hierarchy import Hierarchy
from hac_suite.config import PAPER
from hac_suite.types import Actor, Spaces

_WRONG = "{what} must be {size} finite numbers, got {value!r}"
_NO_SUBGOAL = "an agent with subgoal layers needs achieved_subgoal: its state in the subgoal space"


class _Seen(NamedTuple):
    """What the hierarchy sees of a state, one row each."""

    observation: np.ndarray  # [1, D]
    achieved_goal: np.ndarray  # [1, G]
    achieved_subgoal: np.ndarray  # [1, H]
    desired_goal: np.ndarray  # [1, G]
    diverged: np.ndarray  # bool [1]


class Episode:
    """A hierarchy's goals and attempts in an episode; the caller decides when it ends."""

    def __init__(self, spec: Spaces, actors: Sequence[Actor], horizons: tuple[int, ...]):
        self._spec, self._layers = spec, len(horizons) - 1
        self._hierarchy = Hierarchy(spec, 1, actors, PAPER, horizons, None)
        self._time = 0

    def act(self, observation: Any, goal: Any, achieved_subgoal: Any) -> np.ndarray:
        """The action [A] for an observation [D], end goal [G] and achieved subgoal [H].

        Raises:
            ValueError: an argument is missing, or has the wrong size or values that are not finite.
        """
        seen = self._seen(observation, goal, achieved_subgoal)
        if self._time == 0:
            self._hierarchy.begin(seen, max_steps=0)
        else:
            self._hierarchy.follow(self._time - 1, seen, last=False)
        self._hierarchy.goal[-1][:] = seen.desired_goal  # it may have moved
        action = self._hierarchy.choose(seen.observation, self._time)[0]
        self._time += 1
        return action

    def _seen(self, observation: Any, goal: Any, achieved_subgoal: Any) -> _Seen:
        subgoals, goals = self._spec.subgoal_space.dim, self._spec.goal_space.dim
        if achieved_subgoal is None:
            if self._layers:
                raise ValueError(_NO_SUBGOAL)
            achieved_subgoal = np.zeros(subgoals)
        return _Seen(
            observation=_row("observation", observation, len(self._spec.observation_scale)),
            # Not known, and so never the end goal: an episode that goes on has not achieved it.
            achieved_goal=np.full((1, goals), np.nan),
            achieved_subgoal=_row("achieved_subgoal", achieved_subgoal, subgoals),
            desired_goal=_row("goal", goal, goals),
            diverged=np.zeros(1, bool),
        )


def _row(what: str, value: Any, size: int) -> np.ndarray:
    try:
        row = np.asarray(value, np.float64)
    except (TypeError, ValueError):  # such as Gymnasium's dict of observations
        row = np.empty(())
    if row.shape != (size,) or not np.isfinite(row).all():
        raise ValueError(_WRONG.format(what=what, size=size, value=value))
    return row[np.newaxis]
