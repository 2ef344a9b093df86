"""Flags that name several things at once: tasks, agents, seeds, and the attempts of levels."""

import re
from collections.abc import Sequence

import tasks
from analysis.program import MOST, CommandError
from analysis.reading import schema


def task(word: str) -> str:
    """The name of the task that a --task flag names: of the suite, or in a file of one's own.

    Raises:
      CommandError: there is none, or its file does not run.
    """
    try:
        return tasks.find(word).name
    except ValueError as error:
        raise CommandError(str(error)) from error


def tasks_named(word: str) -> tuple[str, ...]:
    """The names of the tasks that a --task flag names: one, or `all` of the suite's.

    Raises:
      CommandError: as `task`.
    """
    return tuple(tasks.ALL) if word == "all" else (task(word),)


def subgoal_layers(words: Sequence[str]) -> tuple[int, ...]:
    """The agents that --subgoal_layers names.

    Raises:
      CommandError: a word is no number of subgoal layers.
    """
    valid = [str(layers) for layers in range(schema.MAX_LEVELS)]
    wrong = [word for word in words if word.strip() not in valid]
    if wrong or not words:
        typed = ",".join(words)
        raise CommandError(
            f"flag --subgoal_layers={typed}: it takes some of {','.join(valid)}, as in "
            "--subgoal_layers=0,1"
        )
    return tuple(sorted({int(word) for word in words}))


def seeds(word: str) -> tuple[int, ...]:
    """`10` is the seeds 0 to 9; with a comma or a dash it is a list of seeds and ranges.

    Raises:
      CommandError: it is neither, names a seed twice, or more seeds than anyone means.
    """
    parts = [re.fullmatch(r"(\d{1,9})(?:-(\d{1,9}))?", part.strip()) for part in word.split(",")]
    spans = [(int(part[1]), int(part[2] or part[1])) for part in parts if part]
    if len(spans) != len(parts) or any(first > last for first, last in spans):
        raise CommandError(
            f"flag --seeds={word}: it takes how many (10: seeds 0 to 9), or which (100-103 or 3,5)"
        )
    if re.fullmatch(r"\s*\d+\s*", word):
        spans = [(0, spans[0][0] - 1)]
    count = sum(last - first + 1 for first, last in spans)
    if not 1 <= count <= MOST:
        raise CommandError(f"flag --seeds={word}: that is {count} seeds; it takes 1 to {MOST}")
    found = [seed for first, last in spans for seed in range(first, last + 1)]
    if len(set(found)) < count:
        raise CommandError(f"flag --seeds={word}: a seed is there twice")
    return tuple(found)


def attempts(word: str | None, layers: tuple[int, ...]) -> dict[int, tuple[int, ...]]:
    """By number of subgoal layers, the T of --T; none given: each task's own.

    Raises:
      CommandError: it is not lists of counts, each of an agent that is asked for.
    """
    found: dict[int, tuple[int, ...]] = {}
    for part in word.split("/") if word is not None else []:
        counts = part.split(",")
        if not all(re.fullmatch(r"\s*[1-9]\d{0,5}\s*", count) for count in counts):
            raise CommandError(
                f"flag --T={word}: it takes a count for each level, the lowest first, as in "
                "--T=20,8,3; with / between agents, as in --T=20,20/8,8,7"
            )
        own = len(counts) - 1
        if own not in layers or own in found:
            why = (
                "twice" if own in found else f"but not asked for: --subgoal_layers={_list(layers)}"
            )
            raise CommandError(
                f"flag --T={word}: {part} is of the agent with {own} subgoal layer(s), {why}"
            )
        found[own] = tuple(map(int, counts))
    return found


def _list(numbers: Sequence[int]) -> str:
    return ",".join(map(str, numbers))
