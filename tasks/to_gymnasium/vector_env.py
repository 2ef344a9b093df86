"""A task as many Gymnasium environments at once: what `gymnasium.make_vec` makes of our ids."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector.utils import batch_space

from tasks.to_gymnasium import shared
from tasks.vector import SEEDS

_NO_LIMIT = 2**62


class GoalVectorEnv(shared.Face, gymnasium.vector.VectorEnv):
    """N environments of a task, stepped together by the suite's fast path.

        envs = gymnasium.make_vec("tasks:HACSuite/PickPlace-v0", num_envs=64)
        observations, infos = envs.reset(seed=0, options={"test": True})

    Episodes, rewards and infos are those of `SyncVectorEnv` over as many `GoalEnv`, bit for bit,
    and several times as fast. An environment whose episode has ended begins another with the next
    step, whose action it does not use (`AutoresetMode.NEXT_STEP`).
    """

    metadata = {  # noqa: RUF012
        "render_modes": shared.RENDER_MODES,
        "autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        name: str,
        num_envs: int = 1,
        *,
        test: bool = False,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
    ):
        """Loads a task `num_envs` times over.

        Args:
          name: one of `tasks.ALL`, or any other word that `tasks.find` knows.
          test: whether episodes begin from the test starts rather than the training starts.
          max_episode_steps: steps after which episodes are truncated; None: only those that
            diverge are, and those of a third-party environment after its own limit.
          render_mode: None or "rgb_array".

        Raises:
          ValueError: unknown task or render mode.
        """
        self._load(name, num_envs, test, render_mode)
        self.num_envs = num_envs
        self._limit = _NO_LIMIT if max_episode_steps is None else max_episode_steps
        self.single_action_space = shared.action_space(self._env)
        self.single_observation_space = shared.observation_space(self._env)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._random = [seeding.np_random(None)[0] for _ in range(num_envs)]
        self._steps = np.zeros(num_envs, np.int64)
        self._ended = np.zeros(num_envs, bool)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Starts an episode in each environment; see `gymnasium.vector.VectorEnv.reset`.

        Args:
          seed: the i-th environment's is seed + i, or the i-th of a list.
          options: "test" as for `GoalEnv`; "reset_mask", bool [N], leaves the others as they are.

        Raises:
          ValueError: a wrong option, or not as many seeds as environments.
        """
        given = dict(options or {})
        mask = np.asarray(given.pop("reset_mask", np.ones(self.num_envs, bool)))
        if mask.shape != (self.num_envs,) or mask.dtype != bool:
            raise ValueError(f"reset_mask must be {self.num_envs} booleans, got {mask!r}")
        test = shared.checked_options(given).get("test", self._test)
        for i, own in enumerate(self._seeds(seed)):
            if own is not None and mask[i]:
                self._random[i] = seeding.np_random(own)[0]
        step = self._begin(mask, test)
        return self._observations(step), self._infos(step)

    def _seeds(self, seed: int | Sequence[int | None] | None) -> Sequence[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            return [int(seed) + i for i in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"seed has {len(seed)} numbers for {self.num_envs} environments")
        return seed

    def _begin(self, mask: np.ndarray, test: bool) -> Any:
        """Starts the episodes that each environment's own generator draws."""
        seeds = np.zeros(self.num_envs, np.int64)
        for i in np.flatnonzero(mask):
            seeds[i] = self._random[i].integers(SEEDS)
        self._steps[mask], self._ended[mask] = 0, False
        return self._env.reset(seeds, mask=mask, test=test)

    def step(
        self, actions: np.ndarray
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Makes a control step with actions [N, A] in [-1, 1]; see the class for what restarts.

        Raises:
          ValueError: an action is not finite, or they have another shape.
        """
        fresh, playing = self._ended.copy(), ~self._ended
        natural = self._natural(actions, self.action_space.shape)
        step = self._env.step(np.where(fresh[:, None], 0.0, natural), playing)
        if fresh.any():
            step = self._begin(fresh, self._test)
        self._steps[playing] += 1
        infos = self._infos(step)
        reached = self.goal_space.achieved(step.achieved_goal, step.desired_goal)
        rewards = np.where(fresh, 0.0, reached - 1.0)
        failed, over = self._world_ended(step, self._steps)
        terminated = playing & (infos["is_success"] | failed)
        truncated = playing & (step.diverged | over | (self._steps >= self._limit))
        self._ended = terminated | truncated
        return self._observations(step), rewards, terminated, truncated, infos

    def render(self) -> tuple[np.ndarray, ...] | None:
        """A picture of each environment, uint8 [480, 640, 3], in render mode "rgb_array"."""
        if self.render_mode is None:
            return None
        return tuple(shared.picture(self._env, i) for i in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Frees the simulation."""
        self._env.close()

    def _observations(self, step: Any) -> dict[str, np.ndarray]:
        return {key: getattr(step, key) for key in shared.OBSERVED}

    def _infos(self, step: Any) -> dict[str, Any]:
        achieved = self.goal_space.achieved(step.achieved_goal, step.desired_goal)
        infos = {
            "is_success": achieved & ~step.diverged,
            "diverged": step.diverged,
            "achieved_subgoal": step.achieved_subgoal,
        }
        every = {f"_{name}": np.ones(self.num_envs, bool) for name in infos}
        return {**infos, **every}
