"""The Gymnasium face: each task as a goal environment that other libraries can train on."""

import copy
import os
from collections.abc import Iterable, Mapping
from typing import Any

import gymnasium
import numpy as np

from tasks import finding
from tasks.goal_space import GoalSpace
from tasks.vector import VectorEnv

_NAMESPACE = "HACSuite"
_VERSION = "v0"
_ACRONYMS = {"ur5": "UR5"}  # words of task names that are not capitalised like others
OBSERVED = ("observation", "achieved_goal", "desired_goal")
_OPTIONS = ("test",)
SEEDS = 2**32  # episode seeds lie in [0, 2**32)
_NO_OPTION = "reset() has no option {name!r}; its options are {options}"
_NOT_A_BOOLEAN = "reset() takes test=True or test=False, got {value!r}"
_NO_GL = (
    "rendering failed ({error}). Without a display it needs MUJOCO_GL=egl (or osmesa) in the "
    "environment before Python starts{now}; `python launch/doctor.py` says what works here"
)


class GoalEnv(gymnasium.Env):
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
    """

    # The frame rate differs between tasks, so each environment states its own.
    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(self, name: str, *, test: bool = False, render_mode: str | None = None):
        """Loads a task.

        Args:
          name: one of `tasks.ALL`, or any other word that `tasks.find` knows.
          test: whether episodes begin from the test starts rather than the training starts.
          render_mode: None or "rgb_array".

        Raises:
          ValueError: unknown task or render mode.
        """
        check_render_mode(render_mode)
        self._name = name
        self._env = finding.load_vector(name, 1)
        self._test = test
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": round(1 / self._env.control_timestep)}
        self.action_space = action_space(self._env)
        self.observation_space = observation_space(self._env)

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
        """What "observation" is divided by to come out about [-1, 1]: [D]."""
        return self._env.observation_scale

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
        test = checked_options(options).get("test", self._test)
        super().reset(seed=seed)
        episode_seed = self.np_random.integers(SEEDS)
        step = self._env.reset(np.array([episode_seed]), test=test)
        return self._observation(step), self._info(step)

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict]:
        """Makes a control step with an action [A] in [-1, 1]; see `gymnasium.Env.step`.

        Raises:
          ValueError: the action is not finite.
        """
        low, high = self._env.action_low, self._env.action_high
        natural = low + 0.5 * (np.asarray(action, dtype=np.float64) + 1.0) * (high - low)
        step = self._env.step(natural[np.newaxis])
        observation, info = self._observation(step), self._info(step)
        reward = self.compute_reward(
            observation["achieved_goal"], observation["desired_goal"], info
        )
        return observation, float(reward), info["is_success"], info["diverged"], info

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info) -> Any:
        """The reward for each pair of goals [..., G]: 0.0 where achieved, otherwise -1.0."""
        del info
        return self.goal_space.achieved(achieved_goal, desired_goal) - 1.0

    def render(self) -> np.ndarray | None:
        """A picture of the scene, uint8 [480, 640, 3], in render mode "rgb_array"."""
        return None if self.render_mode is None else picture(self._env, 0)

    def close(self) -> None:
        """Frees the simulation."""
        self._env.close()

    def __reduce__(self) -> Any:
        """A copy, also in another process, goes on from where this environment stands."""
        made = (self._name, self._test, self.render_mode)
        return _stand_in, made, (self._env.snapshot(), self._np_random, self._np_random_seed)

    def __setstate__(self, state: Any) -> None:
        snapshot, self._np_random, self._np_random_seed = copy.deepcopy(state)
        self._env.restore(snapshot)

    def _observation(self, step) -> dict[str, np.ndarray]:
        return {key: getattr(step, key)[0] for key in OBSERVED}

    def _info(self, step) -> dict[str, Any]:
        diverged = bool(step.diverged[0])
        achieved = self.goal_space.achieved(step.achieved_goal[0], step.desired_goal[0])
        return {
            "is_success": bool(achieved) and not diverged,
            "diverged": diverged,
            "achieved_subgoal": step.achieved_subgoal[0],
        }


def environment_id(name: str) -> str:
    """The Gymnasium id of a task: "pick_place" is "HACSuite/PickPlace-v0"."""
    words = "".join(_ACRONYMS.get(word, word.capitalize()) for word in name.split("_"))
    return f"{_NAMESPACE}/{words}-{_VERSION}"


def register_all(names: Iterable[str]) -> None:
    """Registers the tasks of these names with Gymnasium."""
    for name in names:
        gymnasium.register(
            id=environment_id(name),
            entry_point="tasks.to_gymnasium:GoalEnv",
            vector_entry_point="tasks.to_gymnasium_vector:GoalVectorEnv",
            max_episode_steps=finding.spec(name).max_steps,
            kwargs={"name": name},
        )


def _stand_in(name: str, test: bool, render_mode: str | None) -> GoalEnv:
    """The environment that a copy becomes."""
    return GoalEnv(name, test=test, render_mode=render_mode)


def check_render_mode(render_mode: str | None) -> None:
    """Raises ValueError for a mode that there is not."""
    if render_mode not in (None, *GoalEnv.metadata["render_modes"]):
        raise ValueError(f"render_mode must be None or 'rgb_array', got {render_mode!r}")


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
        reason = " ".join(f"{type(error).__name__}: {error}".split())
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
