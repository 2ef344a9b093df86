"""What the engine needs of the world: goal spaces and environments stepped in lock step."""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

# An actor of one level: natural observations [N, D] and goals [N, G] to outputs in [-1, 1] [N, A].
Actor = Callable[[np.ndarray, np.ndarray], np.ndarray]


class GoalSpace(Protocol):
    """Named, bounded dimensions with a threshold each (Table 1)."""

    @property
    def dim(self) -> int: ...

    @property
    def low(self) -> np.ndarray: ...

    @property
    def high(self) -> np.ndarray: ...

    def achieved(self, achieved: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """[..., G], [..., G] -> bool [...]: every dimension within its threshold."""
        ...

    def normalise(self, value: np.ndarray) -> np.ndarray:
        """Natural units to [-1, 1] (beyond, where the value is out of bounds)."""
        ...

    def denormalise(self, value: np.ndarray) -> np.ndarray: ...


class EnvStep(Protocol):
    """What N environments show after a reset or a step; fresh arrays, natural units.

    It may also have `failed`, bool [N]: the environment ended the episode with this step, and not
    at its goal. See `failed`.
    """

    @property
    def observation(self) -> np.ndarray: ...  # [N, D]

    @property
    def achieved_goal(self) -> np.ndarray: ...  # [N, G]

    @property
    def achieved_subgoal(self) -> np.ndarray: ...  # [N, H]

    @property
    def desired_goal(self) -> np.ndarray: ...  # [N, G]

    @property
    def diverged(self) -> np.ndarray: ...  # bool [N]


def failed(step: EnvStep) -> np.ndarray:
    """Where the environment ended the episode in failure, a robot that fell: bool [N].

    Such a step is learnt from, unlike one that diverged: no goal is achieved by it, and no return
    is worse. Environments whose steps do not say `failed` never fail.
    """
    said = getattr(step, "failed", None)
    return np.zeros(len(step.diverged), bool) if said is None else said


class Spaces(Protocol):
    """What an agent needs to know of a task: a `VectorEnv` says it, and a task's spec.

    It may also have `observation_offset` [D], which is subtracted from observations before they
    are divided by their scale; without it nothing is.
    """

    @property
    def observation_scale(self) -> np.ndarray: ...  # [D]

    @property
    def action_low(self) -> np.ndarray: ...  # [A]

    @property
    def action_high(self) -> np.ndarray: ...  # [A]

    @property
    def goal_space(self) -> GoalSpace: ...

    @property
    def subgoal_space(self) -> GoalSpace: ...


class VectorEnv(Spaces, Protocol):
    """N environments of one task in lock step. It never ends an episode: the hierarchy does."""

    num_envs: int
    max_steps: int

    def reset(
        self,
        seeds: np.ndarray | None = None,
        *,
        mask: np.ndarray | None = None,
        test: bool = False,
    ) -> EnvStep:
        """Starts an episode in each masked environment.

        Args:
            seeds: [N] integers in [0, 2**32); `seeds[i]` alone decides the i-th episode. None
                leaves them to the environment.
            mask: [N] bool, the environments to reset; None resets all. The others keep their
                values.
            test: whether to begin from the test starts.
        """
        ...

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> EnvStep:
        """One control step in each masked environment; the others keep their values.

        Args:
            actions: [N, A] in natural units, such as torques, between `action_low` and
                `action_high`.
            mask: [N] bool; None steps all.

        Returns:
            What all environments show. One that diverged became unstable: its step counts for
            nothing, and it stays as it is until its reset.
        """
        ...


class LevelSpec(NamedTuple):
    """The sizes and units of one level of the hierarchy (Section 3.1)."""

    observation_scale: np.ndarray  # [D]
    goal_space: GoalSpace  # what it is asked for: the end goal at the top, subgoals below
    action_dim: int
    attempts: int  # T_i
    observation_offset: np.ndarray | None = None  # [D]; None: nothing is subtracted

    @property
    def observation_dim(self) -> int:
        return len(self.observation_scale)

    def scaled(self, observation: np.ndarray) -> np.ndarray:
        """Observations [..., D] in natural units as networks see them, about [-1, 1]."""
        if self.observation_offset is not None:
            observation = observation - self.observation_offset
        return observation / self.observation_scale


def level_specs(spaces: Spaces, horizons: tuple[int, ...]) -> tuple[LevelSpec, ...]:
    """Levels with T_i = horizons[i]; level 0 acts, the last pursues the end goal."""
    top = len(horizons) - 1
    offset = getattr(spaces, "observation_offset", None)
    return tuple(
        LevelSpec(
            observation_scale=np.asarray(spaces.observation_scale, np.float64),
            goal_space=spaces.goal_space if level == top else spaces.subgoal_space,
            action_dim=len(spaces.action_low) if level == 0 else spaces.subgoal_space.dim,
            attempts=attempts,
            observation_offset=offset if offset is None else np.asarray(offset, np.float64),
        )
        for level, attempts in enumerate(horizons)
    )
