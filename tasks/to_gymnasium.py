"""The Gymnasium face: each task as a goal environment that other libraries can train on."""

from collections.abc import Iterable, Mapping
from typing import Any

import gymnasium
import numpy as np

from tasks import loading

_NAMESPACE = "HACSuite"
_VERSION = "v0"
_ACRONYMS = {"ur5": "UR5"}  # words of task names that are not capitalised like others
_OBSERVED = ("observation", "achieved_goal", "desired_goal")
_SEEDS = 2**32  # episode seeds lie in [0, 2**32)


class GoalEnv(gymnasium.Env):
    """A task as a Gymnasium goal environment.

    Observations are dictionaries of "observation", "achieved_goal" and "desired_goal" in natural
    units. Actions lie in [-1, 1], which spans the motors' range. The reward is -1, or 0 once the
    goal is achieved, which ends the episode; after the task's `max_steps`, or if the physics
    breaks down, the episode is truncated. Each step's info says "is_success" and "diverged".
    """

    # The frame rate differs between tasks, so each environment states its own.
    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(self, name: str, *, test: bool = False, render_mode: str | None = None):
        """Loads a task.

        Args:
          name: one of `tasks.ALL`.
          test: whether episodes begin from the test starts rather than the training starts.
          render_mode: None or "rgb_array".

        Raises:
          ValueError: unknown task or render mode.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode must be None or 'rgb_array', got {render_mode!r}")
        self._env = loading.load_vector(name, 1)
        self._test = test
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": round(1 / self._env.control_timestep)}
        self.action_space = gymnasium.spaces.Box(
            -1.0, 1.0, shape=self._env.action_low.shape, dtype=np.float32
        )
        sizes = {
            "observation": self._env.observation_dim,
            "achieved_goal": self._env.goal_space.dim,
            "desired_goal": self._env.goal_space.dim,
        }
        self.observation_space = gymnasium.spaces.Dict(
            {
                key: gymnasium.spaces.Box(-np.inf, np.inf, (n,), np.float64)
                for key, n in sizes.items()
            }
        )
        self._steps = 0

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Starts an episode; see `gymnasium.Env.reset`. There are no options."""
        super().reset(seed=seed)
        self._steps = 0
        episode_seed = self.np_random.integers(_SEEDS)
        step = self._env.reset(np.array([episode_seed]), test=self._test)
        return self._observation(step), self._info(step)

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict]:
        """Makes a control step with an action [A] in [-1, 1]; see `gymnasium.Env.step`.

        Raises:
          ValueError: the action is not finite.
        """
        low, high = self._env.action_low, self._env.action_high
        natural = low + 0.5 * (np.asarray(action, dtype=np.float64) + 1.0) * (high - low)
        step = self._env.step(natural[np.newaxis])
        self._steps += 1
        observation, info = self._observation(step), self._info(step)
        terminated = info["is_success"]
        truncated = not terminated and (self._steps >= self._env.max_steps or info["diverged"])
        reward = self.compute_reward(
            observation["achieved_goal"], observation["desired_goal"], info
        )
        return observation, float(reward), terminated, truncated, info

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info) -> Any:
        """The reward for each pair of goals [..., G]: 0.0 where achieved, otherwise -1.0."""
        del info
        return self._env.goal_space.achieved(achieved_goal, desired_goal) - 1.0

    def render(self) -> np.ndarray | None:
        """A picture of the scene, uint8 [480, 640, 3], in render mode "rgb_array"."""
        return None if self.render_mode is None else self._env.render(0)

    def close(self) -> None:
        """Frees the simulation."""
        self._env.close()

    def _observation(self, step) -> dict[str, np.ndarray]:
        return {key: getattr(step, key)[0] for key in _OBSERVED}

    def _info(self, step) -> dict[str, Any]:
        diverged = bool(step.diverged[0])
        achieved = self._env.goal_space.achieved(step.achieved_goal[0], step.desired_goal[0])
        return {"is_success": bool(achieved) and not diverged, "diverged": diverged}


def environment_id(name: str) -> str:
    """The Gymnasium id of a task: "pick_place" is "HACSuite/PickPlace-v0"."""
    words = "".join(_ACRONYMS.get(word, word.capitalize()) for word in name.split("_"))
    return f"{_NAMESPACE}/{words}-{_VERSION}"


def register_all(names: Iterable[str]) -> None:
    """Registers the tasks of these names with Gymnasium."""
    for name in names:
        gymnasium.register(
            id=environment_id(name), entry_point="tasks.to_gymnasium:GoalEnv", kwargs={"name": name}
        )
