"""Converts between the position of the dragged marker and the end goal that it marks.

A task says only where it puts the marker for a goal. The way back is found by trying, so it works
for every task whose marker moves with its goal.
"""

import numpy as np

from launch.pictures.stage import Stage, Watched

_TRIES = 6  # of Newton's method; the places of most markers are linear in the goal
_STEP = 1e-3  # of a dimension's range, to see where the marker goes
_MOVES = 1e-6  # metres for such a step; what moves less is fixed


class GoalHandle:
    """Where the end goal's marker can be dragged to.

    Attributes:
      axes: whether the marker can move along x, y and z at all; none for a task without one.
      why_fixed: why the goal cannot be moved; "" where it can.
    """

    def __init__(self, env: Watched, stage: Stage, goal: np.ndarray):
        """`env` has begun an episode, whose goal [G] is shown again afterwards."""
        self._env, self._stage, self._space = env, stage, env.goal_space
        self.axes = (False, False, False)
        self.why_fixed = ""
        try:
            env.move_goal(0, goal)
        except ValueError as error:
            self.why_fixed = str(error)
        if stage.goal and not self.why_fixed:
            middle = (np.asarray(self._space.low) + self._space.high) / 2
            x, y, z = (np.abs(self._slopes(middle)).max(axis=1) > _MOVES).tolist()
            self._env.move_goal(0, goal)
            self.axes = (x, y, z)

    def place(self) -> np.ndarray:
        """Where the marker is [3]."""
        return self._stage.poses().position[self._stage.goal[0]].astype(np.float64)

    def goal_at(self, place: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """The goal [G] whose marker is as near to a place [3] as goals allow; leaves that shown.

        Args:
          goal: where to begin; dimensions that no marker shows keep its values.
        """
        found = np.array(goal, np.float64)
        for _ in range(_TRIES):
            short = place - self._place_of(found)
            slopes = self._slopes(found)  # metres per range of each dimension
            change = np.linalg.lstsq(slopes / _STEP, short, rcond=1e-6)[0]
            found = np.clip(found + change * self._range, self._space.low, self._space.high)
        self._env.move_goal(0, found)
        return found

    @property
    def _range(self) -> np.ndarray:
        return np.asarray(self._space.high) - self._space.low

    def _place_of(self, goal: np.ndarray) -> np.ndarray:
        self._env.move_goal(0, goal)
        return self.place()

    def _slopes(self, goal: np.ndarray) -> np.ndarray:
        """How far [3, G] the marker goes for a step in each dimension."""
        here = self._place_of(goal)
        steps = np.diag(_STEP * self._range)
        return np.stack([self._place_of(goal + step) - here for step in steps], axis=1)
