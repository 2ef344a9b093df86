"""What one Gymnasium environment and many at once have in common."""

import os
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np

from tasks import finding
from tasks.errors import one_line
from tasks.goal_space import GoalSpace
from tasks.vector import VectorEnv

RENDER_MODES = ["rgb_array"]
OBSERVED = ("observation", "achieved_goal", "desired_goal")
_OPTIONS = ("test",)
_NO_OPTION = "reset() has no option {name!r}; its options are {options}"
_NOT_A_BOOLEAN = "reset() takes test=True or test=False, got {value!r}"
_NO_GL = (
    "rendering failed ({error}). Without a display it needs MUJOCO_GL=egl (or osmesa) in the "
    "environment before Python starts{now}; `python launch/doctor.py` says what works here"
)


class Face:
    """A task's spaces, and the units of its actions."""

    metadata: dict[str, Any]

    def _load(self, name: str, num_envs: int, test: bool, render_mode: str | None) -> None:
        """Loads the task; ValueError: an unknown task or render mode."""
        if render_mode not in (None, *RENDER_MODES):
            raise ValueError(f"render_mode must be None or 'rgb_array', got {render_mode!r}")
        self._name, self._test, self.render_mode = name, test, render_mode
        self._env = finding.load_vector(name, num_envs)
        # The frame rate differs between tasks, so each environment states its own.
        self.metadata = {**self.metadata, "render_fps": round(1 / self._env.control_timestep)}

    @property
    def goal_space(self) -> GoalSpace:
        """The space of end goals: names, units, bounds and the thresholds that judge a goal."""
        return self._env.goal_space

    @property
    def subgoal_space(self) -> GoalSpace:
        """The space of subgoals."""
        return self._env.subgoal_space

    @property
    def observation_scale(self) -> np.ndarray:
        """What "observation" less the offset is divided by to come out about [-1, 1]: [D]."""
        return self._env.observation_scale

    @property
    def observation_offset(self) -> np.ndarray:
        """What is subtracted from "observation" before the division: [D]; mostly zeros."""
        offset = self._env.observation_offset
        return np.zeros(self._env.observation_dim) if offset is None else offset

    def _world_ended(self, step: Any, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Whether a third-party environment failed [N], and whether its time is over [N].

        It then stands still. Our own tasks do neither.

        Args:
          steps: [N] control steps since the last reset.
        """
        if not hasattr(step, "failed"):
            return np.zeros_like(step.diverged), np.zeros_like(step.diverged)
        return step.failed, steps >= self._env.max_steps

    def _natural(self, actions: np.ndarray, shape: tuple[int, ...] | None) -> np.ndarray:
        """Actions in [-1, 1] in the motors' own units; ValueError: they have another shape."""
        actions = np.asarray(actions, dtype=np.float64)
        if actions.shape != shape:
            raise ValueError(f"an action has shape {shape}, got {actions.shape}")
        low, high = self._env.action_low, self._env.action_high
        return low + 0.5 * (actions + 1.0) * (high - low)


def action_space(env: VectorEnv) -> gymnasium.spaces.Box:
    """One environment's actions."""
    return gymnasium.spaces.Box(-1.0, 1.0, shape=env.action_low.shape, dtype=np.float32)


def observation_space(env: VectorEnv) -> gymnasium.spaces.Dict:
    """One environment's observations."""
    sizes = {
        "observation": env.observation_dim,
        "achieved_goal": env.goal_space.dim,
        "desired_goal": env.goal_space.dim,
    }
    return gymnasium.spaces.Dict(
        {key: gymnasium.spaces.Box(-np.inf, np.inf, (n,), np.float64) for key, n in sizes.items()}
    )


def picture(env: VectorEnv, i: int) -> np.ndarray:
    """A picture of environment i, uint8 [480, 640, 3].

    Raises:
      RuntimeError: there is no GL to render with; the message says what to do.
    """
    try:
        return env.render(i)
    except Exception as error:  # MuJoCo's FatalError, dm_control's and OpenGL's own
        chosen = os.environ.get("MUJOCO_GL")
        now = f" (it is {chosen!r})" if chosen else ""
        reason = one_line(error)
        raise RuntimeError(_NO_GL.format(error=reason, now=now)) from error


def checked_options(options: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """The options of a reset, checked."""
    given = options or {}
    for name in given:
        if name not in _OPTIONS:
            raise ValueError(_NO_OPTION.format(name=name, options=", ".join(_OPTIONS)))
    if not isinstance(given.get("test", False), bool | np.bool_):
        raise ValueError(_NOT_A_BOOLEAN.format(value=given["test"]))
    return given
