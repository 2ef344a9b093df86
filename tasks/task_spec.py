"""Describes a task without compiling its physics."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tasks import goal_space as goal_space_lib


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class TaskSpec:
    """A task's sizes, units and limits; the task itself is built from the same object.

        spec = tasks.spec("pick_place")
        spec.max_steps, spec.goal_space.names, spec.observation_dim, spec.action_high

    Attributes:
      title: the aim of the task, in a sentence or two.
      control_timestep: seconds between actions.
      max_steps: control steps after which an episode is cut off.
      goal_space: the space of end goals, G dimensions.
      subgoal_space: the space of subgoals, H dimensions.
      observation: the parts of the observation in their order: by name, the scale of each number,
        which divides it to give about [-1, 1].
      offset: subtracted from the observation before the division, [D]; (): nothing.
      action_bounds: the least and the most that each motor takes, [A] each, in natural units.
      horizons: by number of subgoal layers, the attempts (T_0, ..., T_n) that suit this task
        better than equal ones.
    """

    title: str
    control_timestep: float
    max_steps: int
    goal_space: goal_space_lib.GoalSpace
    subgoal_space: goal_space_lib.GoalSpace
    observation: Mapping[str, Sequence[float] | np.ndarray]
    action_bounds: tuple[npt.ArrayLike, npt.ArrayLike]
    horizons: Mapping[int, tuple[int, ...]] = dataclasses.field(default_factory=dict)
    offset: Sequence[float] = ()

    def __post_init__(self):
        if not self.control_timestep > 0 or not self.max_steps >= 1:
            raise ValueError(
                "a task needs a control_timestep above 0 and max_steps of at least 1, "
                f"got {self.control_timestep} and {self.max_steps}"
            )
        parts = {
            name: tuple(np.asarray(scale, np.float64).ravel().tolist())
            for name, scale in self.observation.items()
        }
        object.__setattr__(self, "observation", parts)
        if not self.observation_dim or not (self.observation_scale > 0).all():
            raise ValueError(f"scales of observations must be above 0, got {parts}")
        if len(self.offset) not in (0, self.observation_dim):
            raise ValueError(
                f"offset has {len(self.offset)} numbers, observations {self.observation_dim}"
            )
        low, high = map(_read_only, self.action_bounds)
        object.__setattr__(self, "action_bounds", (low, high))
        if low.ndim != 1 or low.shape != high.shape or not low.size or not (low < high).all():
            raise ValueError(f"actions need bounds, low below high; got {low} and {high}")
        if not np.isfinite([low, high]).all():
            raise ValueError(f"the bounds of actions must be finite, got {low} and {high}")
        own = {int(layers): tuple(attempts) for layers, attempts in self.horizons.items()}
        object.__setattr__(self, "horizons", own)
        for layers, attempts in own.items():
            if len(attempts) != layers + 1 or min(attempts) < 1:
                raise ValueError(
                    f"{layers} subgoal layers need {layers + 1} counts, got {attempts}"
                )

    @property
    def action_low(self) -> np.ndarray:
        """[A] the least that each motor takes, in natural units."""
        return np.asarray(self.action_bounds[0])

    @property
    def action_high(self) -> np.ndarray:
        """[A] the most that each motor takes, in natural units."""
        return np.asarray(self.action_bounds[1])

    @property
    def observation_dim(self) -> int:
        """How many numbers an observation has, D."""
        return sum(len(scale) for scale in self.observation.values())

    @property
    def observation_scale(self) -> np.ndarray:
        """[D] scales that divide observations to give about [-1, 1]."""
        return np.array([number for scale in self.observation.values() for number in scale])

    @property
    def observation_offset(self) -> np.ndarray | None:
        """[D] subtracted from observations before that; None: nothing."""
        return np.array(self.offset, np.float64) if len(self.offset) else None

    @property
    def observation_names(self) -> tuple[str, ...]:
        """A name for each of the D numbers: the part's, with an index where it has several."""
        return tuple(
            name if len(scale) == 1 else f"{name}[{index}]"
            for name, scale in self.observation.items()
            for index in range(len(scale))
        )

    def flat(self, observation: Mapping[str, Any]) -> np.ndarray:
        """The observation [D] of a Composer time step: its parts side by side."""
        return np.concatenate([np.ravel(observation[name]) for name in self.observation])


def _read_only(values: Any) -> np.ndarray:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array
