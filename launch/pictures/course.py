"""A recorded test episode of a policy: bodies, subgoals, and the path."""

import math
from typing import Any, NamedTuple

import numpy as np

import hac_suite
import tasks
from hac_suite.types import VectorEnv
from launch.asking import settings
from launch.pictures.stage import Poses, Stage, Unseen, simulation_of
from launch.pictures.subgoal_log import LoggedSubgoal, SubgoalLog
from tasks.worlds.fitted import FittedEntry
from tasks.worlds.making import NoFrames

_MOST_PHOTOS = 160  # of an episode
_PHOTO = (640, 480)  # width, height


class Course(NamedTuple):
    """One test episode of a policy, as it is seen."""

    policy: hac_suite.Policy
    title: str  # what is to be done, in a sentence
    seed: int  # of the episode
    success: bool
    control_timestep: float  # seconds
    stage: Stage
    poses: list[Poses]  # before the first action and after each one
    subgoals: list[LoggedSubgoal]
    states: list[np.ndarray]  # `Stage.state` at each of the poses
    trail: np.ndarray  # [steps + 1, B, 3] metres: where markers of the achieved subgoal would be
    photos: dict[int, np.ndarray]  # by step: frames of an environment that renders its own

    @property
    def steps(self) -> int:
        return len(self.trail) - 1


def record(policy: hac_suite.Policy, seed: int, *, filmed: bool = False) -> Course:
    """Plays a test episode and keeps what is to be seen of it.

    Args:
      filmed: whether to keep the frames of others' environments that render their own, which
        takes GL. They are always kept where MuJoCo does not simulate the environment.

    Raises:
      CommandError, KeyError, TypeError, ValueError: the policy's description is incomplete or of
        another task.
    """
    config = settings.to_config(policy.metadata["config"])
    task = policy.metadata["task"]
    env: Any = tasks.load_vector(task, 1)
    log = SubgoalLog(env, policy.horizons)
    env.reset(np.array([seed]), test=True)  # the stage is set as this episode has it
    eye = _eye(env, filmed and _is_of_others(task))

    def on_step(view: hac_suite.StepView) -> None:
        log.on_step(view)
        eye.on_step(view)

    stats = hac_suite.run_episodes(env, policy, np.array([seed]), config=config, on_step=on_step)
    spec = env.spec
    env.close()
    return Course(
        policy, spec.title, seed, bool(stats.success[0]), spec.control_timestep,
        eye.stage, eye.poses, log.subgoals, eye.states, np.stack(eye.trail), eye.photos,
    )  # fmt: skip


def _is_of_others(task: str) -> bool:
    entry = tasks.find(task)
    return isinstance(entry, FittedEntry) and entry.composer is None


def _eye(env: Any, own_frames: bool) -> "_Watching | _Photographing":
    """What keeps what is seen of an environment; `own_frames`: the frames it renders, if any."""
    if simulation_of(env) is None:
        return _Photographing(env)
    # The first frame comes before the stage: some put the goal's marker in place only then.
    own_frames = own_frames and _renders(env)
    return _Watching(Stage(env), _Photographing(env) if own_frames else None)


def _renders(env: Any) -> bool:
    try:
        env.render(0)
    except NoFrames:
        return False
    return True


class _Watching:
    """Keeps where bodies and markers are, and perhaps photos as well."""

    def __init__(self, stage: Stage, photographing: "_Photographing | None"):
        self.stage, self._photographing = stage, photographing
        self.poses: list[Poses] = []
        self.states: list[np.ndarray] = []
        self.trail: list[np.ndarray] = []
        self.photos = photographing.photos if photographing else dict[int, np.ndarray]()

    def on_step(self, view: hac_suite.StepView) -> None:
        if self._photographing:
            self._photographing.on_step(view)
        self.trail.append(self._achieved(view))
        self.stage.show([subgoal[0] for subgoal in view.subgoals])
        self.poses.append(self.stage.poses())
        self.states.append(self.stage.state())

    def _achieved(self, view: hac_suite.StepView) -> np.ndarray:
        """Where the markers of the lowest level stand if they show what is achieved: [B, 3]."""
        if not self.stage.subgoals:
            return np.zeros((0, 3), np.float32)
        self.stage.show([view.env_step.achieved_subgoal[0]])
        return self.stage.poses().position[self.stage.subgoals[0]]


class _Photographing:
    """Keeps what an environment shows of itself."""

    def __init__(self, env: VectorEnv):
        self._env: Any = env
        self._every = math.ceil(env.max_steps / _MOST_PHOTOS)
        self.stage: Stage = Unseen()
        self.poses: list[Poses] = []
        self.states: list[np.ndarray] = []
        self.trail: list[np.ndarray] = []
        self.photos: dict[int, np.ndarray] = {}

    def on_step(self, view: hac_suite.StepView) -> None:
        self.trail.append(np.zeros((0, 3)))
        if view.step % self._every == 0 or not view.active[0]:
            width, height = _PHOTO
            self.photos[view.step] = self._env.render(0, width=width, height=height)
