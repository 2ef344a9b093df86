"""Flags that name several things at once: tasks, agents, seeds, and the attempts of levels."""

import json
import re
from collections.abc import Sequence
from typing import Any

from absl import flags

import tasks
from analysis.program import CommandError
from analysis.reading import schema

ANY_TASK = (
    f"{', '.join(tasks.ALL)}, path/to/file.py:name, gym:ID, gym:module:ID, or a .toml file from "
    "fit.py"
)
_MOST_SEEDS = 10_000
_WORLD_FLAGS = (
    "task_args", "goal", "subgoal", "goal_threshold", "max_steps", "train_options", "test_options"
)  # fmt: skip


def define_task(values: flags.FlagValues, default: str | None, help: str) -> None:
    """Adds --task, and the flags for Gymnasium environments."""
    flags.DEFINE_string("task", default, help, values)
    flags.DEFINE_string(
        "task_args",
        None,
        "gym: keyword arguments of gymnasium.make, '{\"continuing_task\": false}'",
        values,
    )
    flags.DEFINE_string(
        "goal", None, "gym: the goal, if the environment has none: obs[0:2] or obs[0:2]=1,0", values
    )
    flags.DEFINE_string(
        "subgoal", None, "gym: the subgoal space, as in obs[0:4]; default: the goal space", values
    )
    flags.DEFINE_string(
        "goal_threshold",
        None,
        "gym: distance within which a goal is achieved, instead of compute_reward",
        values,
    )
    flags.DEFINE_integer(
        "max_steps",
        None,
        "gym: steps of an episode; default: the environment's time limit",
        1,
        flag_values=values,
    )
    for kind in ("train", "test"):
        flags.DEFINE_string(
            f"{kind}_options", None, f"gym: options of reset() in {kind}ing, as JSON", values
        )


def define_run(values: flags.FlagValues) -> None:
    """Adds --run, the folder whose policies a program shows."""
    flags.DEFINE_string(
        "run", None, "run folder; default: runs/TASK, or else the published policies", values
    )


def task_word(values: flags.FlagValues) -> str:
    """The word that finds the task which the flags of `define_task` name.

    Raises:
      CommandError: a flag is misspelt, or not for such a task.
    """
    word = values.task
    given: dict[str, Any] = {name: values[name].value for name in _WORLD_FLAGS}
    given = {name: value for name, value in given.items() if value is not None}
    if not given:
        return word
    if not word.startswith("gym:") or "?" in word:
        raise CommandError(f"flag --{next(iter(given))}: it is for --task=gym:ID, not for {word}")
    options: dict[str, Any] = {}
    for name, value in given.items():
        if name in ("task_args", "train_options", "test_options"):
            options["args" if name == "task_args" else name] = _json_object(name, value)
        elif name == "goal_threshold":
            options[name] = _amounts(name, value)
        else:
            options[name] = value
    return tasks.gym_word(word, options)


def _json_object(name: str, text: str) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except ValueError:
        found = None
    if not isinstance(found, dict):
        raise CommandError(f"flag --{name}={text}: give a JSON object, such as '{{\"a\": 1}}'")
    return found


def _amounts(name: str, text: str) -> list[float]:
    parts = text.split(",")
    if not all(re.fullmatch(r"\s*\d*\.?\d+(e-?\d+)?\s*", part) and float(part) for part in parts):
        raise CommandError(f"flag --{name}={text}: give numbers above 0, as in 0.1 or 0.1,0.5")
    return [float(part) for part in parts]


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
            f"flag --subgoal_layers={typed}: give one or more of {','.join(valid)}, as in "
            "--subgoal_layers=0,1"
        )
    return tuple(sorted({int(word) for word in words}))


def periods(words: Sequence[str], last: int) -> tuple[int, ...]:
    """The test periods that --keep_policies names, 0 to `last`.

    Raises:
      CommandError: a word is none of them.
    """
    if not all(re.fullmatch(r"\s*\d{1,6}\s*", word) and int(word) <= last for word in words):
        raise CommandError(
            f"flag --keep_policies={','.join(words)}: give test periods from 0 to {last}, as in "
            "0,1,3"
        )
    return tuple(sorted({int(word) for word in words}))


def seeds(word: str) -> tuple[int, ...]:
    """`10` is the seeds 0 to 9; with a comma or a dash it is a list of seeds and ranges.

    Raises:
      CommandError: it is neither, names a seed twice, or names too many seeds.
    """
    parts = [re.fullmatch(r"(\d{1,9})(?:-(\d{1,9}))?", part.strip()) for part in word.split(",")]
    spans = [(int(part[1]), int(part[2] or part[1])) for part in parts if part]
    if len(spans) != len(parts) or any(first > last for first, last in spans):
        raise CommandError(
            f"flag --seeds={word}: give a number of seeds (10: seeds 0 to 9), or the seeds "
            "(100-103 or 3,5)"
        )
    if re.fullmatch(r"\s*\d+\s*", word):
        spans = [(0, spans[0][0] - 1)]
    count = sum(last - first + 1 for first, last in spans)
    if not 1 <= count <= _MOST_SEEDS:
        raise CommandError(f"flag --seeds={word}: that is {count} seeds; give 1 to {_MOST_SEEDS}")
    found = [seed for first, last in spans for seed in range(first, last + 1)]
    if len(set(found)) < count:
        raise CommandError(f"flag --seeds={word}: a seed is named twice")
    return tuple(found)


def attempts(word: str | None, layers: tuple[int, ...]) -> dict[int, tuple[int, ...]]:
    """The T of --T by number of subgoal layers; without --T, each task's own.

    Raises:
      CommandError: it is not lists of counts, each of an agent that is asked for.
    """
    found: dict[int, tuple[int, ...]] = {}
    for part in word.split("/") if word is not None else []:
        counts = part.split(",")
        if not all(re.fullmatch(r"\s*[1-9]\d{0,5}\s*", count) for count in counts):
            raise CommandError(
                f"flag --T={word}: give a count for each level, the lowest first, as in "
                "--T=20,8,3; put / between agents, as in --T=20,20/8,8,7"
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
