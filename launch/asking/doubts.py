"""What speaks against a request, before anything is made: tasks that cannot be trained on, T."""

import math
import shlex
from collections.abc import Iterator

import hac_suite
import tasks
from analysis.program import CommandError
from analysis.reading import paper
from launch.asking.request import Request
from tasks import registry
from tasks.authoring import check


def refuse_faults(request: Request) -> None:
    """Loads dm_control tasks of the user's own.

    Raises:
      CommandError: one does not load, or its seeds do not determine its episodes.
    """
    for entry in map(tasks.find, request.tasks):
        own = getattr(entry, "composer", entry)  # None: a Gymnasium environment, checked when made
        if own is not None and own.name not in tasks.ALL:
            refuse_fault(own, entry.name)


def refuse_fault(entry: registry.Entry, name: str) -> None:
    """The same of one dm_control task, which is called `name`."""
    if found := check.fault(entry):
        word = shlex.quote(entry.word)
        raise CommandError(
            f"{name}: {found.text}; {found.remedy} with `python launch/check_task.py {word}`"
        )


def notes(request: Request) -> Iterator[str]:
    """What there is to know of how a task is handled."""
    for task in request.tasks:
        for kind in ("note", "warning"):
            for text in getattr(tasks.find(task), f"{kind}s", ()):
                yield f"{kind}: {task}: {text}"


def short(request: Request) -> Iterator[str]:
    """Warns of T with which an episode ends early in training."""
    for task in request.tasks:
        spec = tasks.spec(task)
        steps, own = spec.max_steps, {**spec.horizons, **request.attempts}
        for layers in request.subgoal_layers:
            attempts = hac_suite.horizons(steps, layers, own)
            if (allowed := math.prod(attempts)) < 0.9 * steps:
                agent = f"{task}, {paper.agent_name(layers)}"
                yield (
                    f"warning: {agent}: T = {list(attempts)} allows only {allowed} of the {steps} "
                    "steps of a training episode"
                )
