"""The registry of tasks: a decorated factory whose name is the task's name."""

import difflib
from collections.abc import Callable

from dm_control.utils import containers

_UNKNOWN_TASK = "unknown task {name!r}; did you mean {closest}? The tasks are {names}."

_FACTORIES = containers.TaggedTasks(allow_overriding_keys=False)

add = _FACTORIES.add
names = _FACTORIES.keys
tags = _FACTORIES.tags
tagged = _FACTORIES.tagged


def get(name: str) -> Callable:
    """Returns the factory of the task called `name`.

    A factory takes the keyword `test` (bool: test rather than training starts) and returns a
    `tasks.base.GoalTask`.

    Raises:
      ValueError: no task has that name. The message lists the names, the closest first.
    """
    if name in _FACTORIES:
        return _FACTORIES[name]
    ranked = closest_first(str(name), list(_FACTORIES))
    raise ValueError(_UNKNOWN_TASK.format(name=name, closest=ranked[0], names=", ".join(ranked)))


def closest_first(name: str, candidates: list[str]) -> list[str]:
    """Sorts the candidates by how much their spelling resembles `name`, the closest first."""
    return sorted(
        candidates, key=lambda c: difflib.SequenceMatcher(None, name, c).ratio(), reverse=True
    )
