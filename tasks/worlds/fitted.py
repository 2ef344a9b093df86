"""A task with spaces that were estimated or given in a file."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import mujoco
import numpy as np

from tasks import registry
from tasks.task_spec import TaskSpec
from tasks.worlds import cautions, estimates
from tasks.worlds.settings import Settings, spec_of

if TYPE_CHECKING:
    from tasks.worlds.world import World

_NO_GOALS = (
    "{word}: no point that random episodes reach lies within goal.low and goal.high, and end goals "
    "are such points; widen them"
)
_NO_SNAPSHOT = (
    "{title}: the state of a third-party environment cannot be copied or pickled; make another "
    "environment and reset it with the same seed"
)
_NO_COMPOSER = "{word} is not a dm_control task, so it has no composer.Environment; use load_vector"


class FittedEnv:
    """N environments with the scales, bounds and thresholds of a spec; else what it is given."""

    def __init__(
        self,
        env: Any,
        spec: TaskSpec,
        copies: Callable[[int], "FittedEnv"],
        notes: tuple[str, ...] = (),
    ):
        self._env, self.spec, self.notes = env, spec, notes
        self.copies = copies  # as many of the same: what `hac_suite.train` takes
        self.num_envs, self.max_steps = env.num_envs, spec.max_steps
        self.horizons, self.control_timestep = spec.horizons, spec.control_timestep
        self.goal_space, self.subgoal_space = spec.goal_space, spec.subgoal_space
        self.observation_dim = spec.observation_dim
        self.observation_scale = spec.observation_scale
        self.observation_offset = spec.observation_offset
        self.action_low, self.action_high = spec.action_low, spec.action_high
        env.max_steps = spec.max_steps

    def reset(
        self, seeds: np.ndarray | None = None, *, mask: np.ndarray | None = None, test: bool = False
    ) -> Any:
        """See `hac_suite.VectorEnv`."""
        return self._env.reset(seeds, mask=mask, test=test)

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> Any:
        """See `hac_suite.VectorEnv`."""
        return self._env.step(actions, mask)

    def show_subgoals(self, i: int, subgoals: Sequence[np.ndarray | None]) -> None:
        """Shows environment i's subgoals in pictures, where its scene has markers."""
        self._env.show_subgoals(i, subgoals)

    def simulation(self, i: int) -> tuple[mujoco.MjModel, mujoco.MjData] | None:
        """MuJoCo's model and state of environment i, to be read only; None: it is not MuJoCo's."""
        return self._env.simulation(i)

    def move_goal(self, i: int, goal: np.ndarray) -> Any:
        """Gives environment i's episode another end goal [G].

        Raises:
          ValueError: its goal cannot be moved.
        """
        return self._env.move_goal(i, goal)

    def render(self, i: int, **size: Any) -> np.ndarray:
        """A picture of environment i, uint8 [height, width, 3]."""
        return self._env.render(i, **size)

    def snapshot(self) -> Any:
        """Where all environments stand, as `tasks.vector.VectorEnv.snapshot` says it.

        Raises:
          TypeError: they are third-party environments.
        """
        if not hasattr(self._env, "snapshot"):
            raise TypeError(_NO_SNAPSHOT.format(title=self.spec.title))
        return self._env.snapshot()

    def restore(self, snapshot: Any) -> None:
        """Makes all environments stand where those did of which the snapshot is."""
        self._env.restore(snapshot)

    def close(self) -> None:
        """Frees the environments. Repeatable."""
        self._env.close()


@dataclasses.dataclass(frozen=True)
class FittedEntry(registry.Entry):
    """A task with a fitted spec, for vectorised stepping only.

    Attributes:
      make: makes as many environments, with a seed, without the spec's spaces.
      settings: what the spec was made of.
      notes: notes for the user on how it is handled.
      warnings: what will keep it from learning, as far as was seen.
      origin: what a run folder's manifest compares, so that results of different environments do
        not mix.
      composer: the dm_control task of other spaces, if it is one.
      own_bytes: memory that each environment takes, if it is known.
    """

    make: Callable[[int, int], Any]
    settings: Settings
    origin: Any
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    composer: registry.Entry | None = None
    own_bytes: int = 0

    @property
    def copy_bytes(self) -> int:
        return self.own_bytes

    def load(self, seed: int | None = None, *, test: bool = False) -> Any:
        """The task as a Composer environment, for a dm_control task.

        Raises:
          ValueError: it is none.
        """
        if self.composer is None:
            raise ValueError(_NO_COMPOSER.format(word=self.word.partition("?")[0]))
        return self.composer.load(seed, test=test)

    def load_vector(self, num_envs: int, seed: int = 0) -> Any:
        """As many environments stepped together."""
        return FittedEnv(self.make(num_envs, seed), self.spec, self.load_vector, self.notes)


class Unfitted(NamedTuple):
    """A task for which spaces are to be estimated."""

    word: str  # that finds it
    name: str
    about: estimates.About
    env_of: Callable[[int], Any]  # so many environments, without the spaces that are sought
    fit: Callable[[Settings], FittedEntry]
    notes: tuple[str, ...] = ()
    own: TaskSpec | None = None  # the spaces that somebody made for it, if there are some


def unfitted_task(entry: registry.Entry) -> Unfitted:
    """A dm_control task as if its spaces were not known; only what achieves its goals is."""
    return Unfitted(
        word=entry.word,
        name=entry.name,
        about=about_task(entry),
        env_of=entry.load_vector,
        fit=lambda found: of_task(entry, found, name=entry.name, word=entry.word),
        own=entry.spec,
    )


def _no_factory(**_: Any) -> Any:
    raise ValueError("a task with fitted spaces has no factory of its own")


def of_world(
    world: "World",
    settings: Settings | None = None,
    *,
    name: str = "",
    word: str = "",
    origin: Any = None,
) -> FittedEntry:
    """A Gymnasium environment as a task; without settings a few random episodes are played."""
    about, played = world.about(), None
    warned = () if settings is None else tuple(cautions.of_settings(settings))
    if settings is None or not about.draws_goals:
        played = estimates.random_episodes(world.adapter, about)
    if settings is None:
        assert played is not None
        settings = estimates.settings(about, played)
        warned = tuple(cautions.warnings(about, played, played, settings, None))
    env = world.adapter(1)
    shown = env.reset(np.zeros(1, np.int64)).observation.shape[1]
    goals = shown - len(about.goal_names) if world.pool.reader.adds_goal else shown
    parts = [("observation", goals), ("achieved_goal", shown - goals)]
    spec = spec_of(
        settings,
        title=about.title,
        control_timestep=about.control_timestep,
        action_bounds=(about.action_low, about.action_high),
        goal_names=(about.goal_names, about.subgoal_names),
        goal_units=(("",) * len(about.goal_names), ("",) * len(about.subgoal_names)),
        observation_names=[(part, size) for part, size in parts if size],
        judge=None if about.threshold is not None else about.judge,
    )
    if about.threshold is not None:
        world.judge = spec.goal_space.achieved
    if not about.draws_goals:
        assert played is not None
        points = estimates.reached(played, spec.goal_space.low, spec.goal_space.high)
        if not len(points):
            raise ValueError(_NO_GOALS.format(word=world.word))
        world.goal_points = points
    return FittedEntry(
        name or world.word, word or world.word, spec, _no_factory,
        make=world.adapter, settings=settings, origin=origin, notes=tuple(world.pool.notes),
        warnings=warned,
        own_bytes=world.pool.copy_bytes,
    )  # fmt: skip


def of_task(entry: registry.Entry, settings: Settings, *, name: str, word: str) -> FittedEntry:
    """A dm_control task with other spaces than its own; end goals are judged as it judges them."""
    own = entry.spec
    spec = spec_of(
        settings,
        title=own.title,
        control_timestep=own.control_timestep,
        action_bounds=(own.action_low, own.action_high),
        goal_names=(own.goal_space.names, own.subgoal_space.names),
        goal_units=(own.goal_space.units, own.subgoal_space.units),
        observation_names=[(part, len(scale)) for part, scale in own.observation.items()],
        judge=own.goal_space.achieved,
    )
    return FittedEntry(
        name, word, spec, entry.factory,
        make=entry.load_vector, settings=settings, origin=None, composer=entry,
        warnings=tuple(cautions.of_settings(settings)),
    )  # fmt: skip


def about_task(entry: registry.Entry) -> estimates.About:
    """What is known of a dm_control task without playing it."""
    spec = entry.spec
    return estimates.About(
        title=spec.title,
        max_steps=spec.max_steps,
        control_timestep=spec.control_timestep,
        action_low=spec.action_low,
        action_high=spec.action_high,
        goal_names=spec.goal_space.names,
        subgoal_names=spec.subgoal_space.names,
        judge=spec.goal_space.achieved,
    )
