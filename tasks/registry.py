"""The registry of tasks: a decorated factory whose name is the task's name."""

import contextlib
import dataclasses
from collections.abc import Callable, Iterator

from dm_control import composer

from tasks import base
from tasks.task_spec import TaskSpec
from tasks.vector import VectorEnv

_TAKEN = "a task named {name!r} is already registered"


@dataclasses.dataclass(frozen=True)
class Entry:
    """A registered task: its description, and how to load it.

    Attributes:
      name: its unique name in folders, tables and files.
      word: the word by which `tasks.find` finds it from any folder.
      spec: its spaces, steps and scales.
      factory: takes the keyword `test` (whether episodes begin from the test starts rather than
        the training starts) and returns the task.
    """

    name: str
    word: str
    spec: TaskSpec
    factory: Callable[..., base.GoalTask]

    @property
    def copy_bytes(self) -> int:
        """Memory that one more environment takes: too little to count, for they share a model."""
        return 0

    def load(self, seed: int | None = None, *, test: bool = False) -> composer.Environment:
        """The task as a Composer environment; see `tasks.load`."""
        return composer.Environment(
            self.factory(test=test),
            random_state=seed,
            strip_singleton_obs_buffer_dim=True,
            recompile_mjcf_every_episode=False,
        )

    def load_vector(self, num_envs: int, seed: int = 0) -> VectorEnv:
        """The task as `num_envs` environments stepped together; see `tasks.load_vector`."""
        return VectorEnv(self.load(seed=0), self.name, num_envs, seed)


_OWN: dict[str, Entry] = {}  # the suite's tasks
_receiving = _OWN  # where `add` puts a task


def add(spec: TaskSpec) -> Callable:
    """Registers the decorated factory as a task of its name and of this spec.

        @registry.add(_SPEC)
        def pick_place(test: bool = False) -> PickPlace:
            return PickPlace(test)

    Raises:
      ValueError: the name is taken.
    """
    where = _receiving

    def register(factory: Callable[..., base.GoalTask]) -> Callable[..., base.GoalTask]:
        name = factory.__name__
        if name in where:
            raise ValueError(_TAKEN.format(name=name))
        where[name] = Entry(name, name, spec, factory)
        return factory

    return register


def names() -> list[str]:
    """The names of the suite's tasks, in the order they were registered in."""
    return list(_OWN)


def get(name: str) -> Entry | None:
    """The suite's task of this name, if there is one."""
    return _OWN.get(name)


@contextlib.contextmanager
def collecting() -> Iterator[dict[str, Entry]]:
    """Meanwhile `add` fills the dictionary given here, and the suite's tasks stay as they are."""
    global _receiving
    before, _receiving = _receiving, {}
    try:
        yield _receiving
    finally:
        _receiving = before
