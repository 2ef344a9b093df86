"""A task as a Gymnasium goal environment."""

import copy
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np

from tasks.to_gymnasium import shared
from tasks.vector import SEEDS

# What a copy has of its own besides the simulation.
_CARRIED = ("_np_random", "_np_random_seed", "_steps", "spec", "action_space", "observation_space")


class GoalEnv(shared.Face, gymnasium.Env):
    """A task as a Gymnasium goal environment.

        env = gymnasium.make("tasks:HACSuite/PickPlace-v0")
        observation, info = env.reset(seed=0, options={"test": True})
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

    Observations are dictionaries of "observation", "achieved_goal" and "desired_goal" in natural
    units. Actions lie in [-1, 1], which spans the motors' range. The reward is -1, or 0 once the
    goal is achieved, which ends the episode. If the physics breaks down, the episode is truncated.
    `gymnasium.make` also truncates it after the task's steps, or after `max_episode_steps` of your
    own; an environment made without it has no such limit. Each info says "is_success", "diverged"
    and "achieved_subgoal", the point of the subgoal space.

    A third-party environment also terminates where it fails, is truncated after its steps, and
    cannot be copied or pickled.
    """

    metadata = {"render_modes": shared.RENDER_MODES}  # noqa: RUF012

    def __init__(self, name: str, *, test: bool = False, render_mode: str | None = None):
        """Loads a task.

        Args:
          name: one of `tasks.ALL`, or any other word that `tasks.find` knows.
          test: whether episodes begin from the test starts rather than the training starts.
          render_mode: None or "rgb_array".

        Raises:
          ValueError: unknown task or render mode.
        """
        self._load(name, 1, test, render_mode)
        self.action_space = shared.action_space(self._env)
        self.observation_space = shared.observation_space(self._env)
        self._steps = 0

    @property
    def max_steps(self) -> int:
        """The steps after which the task's episodes are cut off, as the id is registered."""
        return self._env.max_steps

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Starts an episode; see `gymnasium.Env.reset`.

        Args:
          seed: decides this episode, and those that follow it.
          options: {"test": True} begins this episode from a test start, {"test": False} from a
            training start, whatever the environment was made with.

        Raises:
          ValueError: an option that there is not, or one that is neither true nor false.
        """
        test = shared.checked_options(options).get("test", self._test)
        super().reset(seed=seed)
        episode_seed = self.np_random.integers(SEEDS)
        step = self._env.reset(np.array([episode_seed]), test=test)
        self._steps = 0
        return self._observation(step), self._info(step)

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict]:
        """Makes a control step with an action [A] in [-1, 1]; see `gymnasium.Env.step`.

        Raises:
          ValueError: the action is not finite, or has another shape.
        """
        step = self._env.step(self._natural(action, self.action_space.shape)[np.newaxis])
        self._steps += 1
        observation, info = self._observation(step), self._info(step)
        reward = self.compute_reward(
            observation["achieved_goal"], observation["desired_goal"], info
        )
        failed, over = self._world_ended(step, np.array([self._steps]))
        terminated = info["is_success"] or bool(failed[0])
        return observation, float(reward), terminated, info["diverged"] or bool(over[0]), info

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info) -> Any:
        """The reward for each pair of goals [..., G]: 0.0 where achieved, otherwise -1.0."""
        del info
        return self.goal_space.achieved(achieved_goal, desired_goal) - 1.0

    def render(self) -> np.ndarray | None:
        """A picture of the scene, uint8 [480, 640, 3], in render mode "rgb_array"."""
        return None if self.render_mode is None else shared.picture(self._env, 0)

    def close(self) -> None:
        """Frees the simulation."""
        self._env.close()

    def __reduce__(self) -> Any:
        """A copy, also in another process, goes on from where this environment stands.

        Raises:
          TypeError: it is a third-party environment.
        """
        made = (self._name, self._test, self.render_mode)
        carried = {name: vars(self)[name] for name in _CARRIED if name in vars(self)}
        return _stand_in, made, (self._env.snapshot(), carried)

    def __setstate__(self, state: Any) -> None:
        snapshot, carried = copy.deepcopy(state)
        self._env.restore(snapshot)
        vars(self).update(carried)

    def _observation(self, step) -> dict[str, np.ndarray]:
        return {key: getattr(step, key)[0] for key in shared.OBSERVED}

    def _info(self, step) -> dict[str, Any]:
        diverged = bool(step.diverged[0])
        achieved = self.goal_space.achieved(step.achieved_goal[0], step.desired_goal[0])
        return {
            "is_success": bool(achieved) and not diverged,
            "diverged": diverged,
            "achieved_subgoal": step.achieved_subgoal[0],
        }


def _stand_in(name: str, test: bool, render_mode: str | None) -> GoalEnv:
    """The environment that a copy becomes."""
    return GoalEnv(name, test=test, render_mode=render_mode)
