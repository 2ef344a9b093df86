"""Goal spaces: the named, bounded dimensions in which goals are defined and tested."""

import dataclasses

import numpy as np


@dataclasses.dataclass(frozen=True)
class GoalSpace:
    """The space of a level's goals (section 4.1 of the paper: goals are sets of states).

    A goal is a vector of G numbers; it stands for every state whose achieved vector lies within
    `threshold` of it in every dimension.

    Attributes:
      names: what each dimension measures, for example "tip_x".
      units: the unit of each dimension, for example "m".
      low: [G] smallest value a goal may take, in natural units.
      high: [G] largest value a goal may take, in natural units.
      threshold: [G] largest distance from the goal that still counts as achieved.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    threshold: np.ndarray

    def __post_init__(self):
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "units", tuple(self.units))
        if len(set(self.names)) != self.dim:
            raise ValueError(f"a goal space needs distinct names, got {self.names}")
        if len(self.units) != self.dim:
            raise ValueError(f"{self.dim} names but {len(self.units)} units: {self.units}")
        for field in ("low", "high", "threshold"):
            value = np.array(getattr(self, field), dtype=np.float64)
            if value.shape != (self.dim,) or not np.isfinite(value).all():
                raise ValueError(f"{field} must be {self.dim} finite numbers, got {value}")
            value.setflags(write=False)
            object.__setattr__(self, field, value)
        if not (self.low < self.high).all():
            raise ValueError(f"low must be below high: low {self.low}, high {self.high}")
        if not (self.threshold > 0).all():
            raise ValueError(f"thresholds must be positive, got {self.threshold}")

    @property
    def dim(self) -> int:
        """The number of dimensions, G."""
        return len(self.names)

    def achieved(self, achieved: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """Whether the achieved vectors [..., G] satisfy the goals [..., G]: bool [...]."""
        return (np.abs(np.subtract(achieved, goal)) <= self.threshold).all(axis=-1)

    def normalise(self, value: np.ndarray) -> np.ndarray:
        """Maps [..., G] from natural units to [-1, 1] at the bounds."""
        return 2.0 * (np.asarray(value) - self.low) / (self.high - self.low) - 1.0

    def denormalise(self, value: np.ndarray) -> np.ndarray:
        """Maps [..., G] from [-1, 1] to natural units: the inverse of `normalise`."""
        return self.low + 0.5 * (np.asarray(value) + 1.0) * (self.high - self.low)
