"""Scales, bounds and thresholds that a task lacks, as numbers that users can edit."""

import dataclasses
import re
import shlex
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tasks.goal_space import GoalSpace
from tasks.task_spec import TaskSpec
from tasks.worlds.judging import Judge, JudgedSpace

Numbers = tuple[float, ...]

_LISTS = (
    "observation.offset",
    "observation.scale",
    "goal.low",
    "goal.high",
    "goal.threshold",
    "subgoal.low",
    "subgoal.high",
    "subgoal.threshold",
)
_MISSING = "{where}: {name} is missing; `python launch/fit.py --task=...` writes such a file"
_NOT_NUMBERS = "{where}: {name} takes a list of finite numbers, such as [0.5, 1.0], not {value!r}"
_NOT_COUNT = "{where}: max_steps takes a count, not {value!r}"
_NOT_HORIZONS = (
    "{where}: horizons.{name} takes {count} counts, the lowest level's first, not {value!r}"
)
_NO_TABLE = (
    "{where}: horizons is a table of subgoal layers, as in [horizons] with a line 1 = [17, 18] "
    "below it, not {value!r}"
)
_SURPLUS = "{where}: there is no setting {name!r}; there are {names}"


@dataclasses.dataclass(frozen=True)
class Settings:
    """What `tasks.TaskSpec` needs and an environment does not provide.

    Attributes:
      max_steps: control steps after which an episode is cut off.
      observation_offset, observation_scale: [D] what is subtracted from observations, and what
        they are then divided by, to come out about [-1, 1].
      goal_low, goal_high: [G] where end goals are.
      goal_threshold: [G] how far from one still counts; where the environment itself judges, it
        only describes that.
      subgoal_low, subgoal_high, subgoal_threshold: [H] where subgoals may be; how near is achieved.
      horizons: by number of subgoal layers, T = (T_0, ..., T_n).
    """

    max_steps: int
    observation_offset: Numbers
    observation_scale: Numbers
    goal_low: Numbers
    goal_high: Numbers
    goal_threshold: Numbers
    subgoal_low: Numbers
    subgoal_high: Numbers
    subgoal_threshold: Numbers
    horizons: Mapping[int, tuple[int, ...]]

    def as_json(self) -> dict[str, Any]:
        """In JSON's types; `read` takes it back."""
        nested: dict[str, Any] = {"max_steps": self.max_steps}
        for name in _LISTS:
            part, _, field = name.partition(".")
            nested.setdefault(part, {})[field] = list(getattr(self, name.replace(".", "_")))
        nested["horizons"] = {str(layers): list(own) for layers, own in self.horizons.items()}
        return nested


def read(found: Mapping[str, Any], where: str) -> Settings:
    """The settings in a mapping as `as_json` and a TOML file have them.

    Raises:
      ValueError: one is missing, misspelt or no number; the message says where and which.
    """
    _refuse_surplus(found, where)
    flat: dict[str, Any] = {"max_steps": found.get("max_steps"), "horizons": {}}
    if type(flat["max_steps"]) is not int or flat["max_steps"] < 1:
        raise ValueError(_NOT_COUNT.format(where=where, value=flat["max_steps"]))
    for name in _LISTS:
        part, _, field = name.partition(".")
        own = found.get(part)
        if not isinstance(own, Mapping) or field not in own:
            raise ValueError(_MISSING.format(where=where, name=name))
        flat[name.replace(".", "_")] = _numbers(own[field], where, name)
    horizons = found.get("horizons", {})
    if not isinstance(horizons, Mapping):
        raise ValueError(_NO_TABLE.format(where=where, value=horizons))
    for layers, counts in horizons.items():
        flat["horizons"][int(layers)] = _counts(layers, counts, where)
    return Settings(**flat)


def _numbers(value: Any, where: str, name: str) -> Numbers:
    if not isinstance(value, list) or not all(type(n) in (int, float) for n in value):
        raise ValueError(_NOT_NUMBERS.format(where=where, name=name, value=value))
    if not value or not np.isfinite(value).all():
        raise ValueError(_NOT_NUMBERS.format(where=where, name=name, value=value))
    return tuple(map(float, value))


def _counts(layers: str, value: Any, where: str) -> tuple[int, ...]:
    wanted = int(layers) + 1 if str(layers).isdigit() else 1
    whole = isinstance(value, list) and all(type(n) is int and n > 0 for n in value)
    if not whole or not str(layers).isdigit() or len(value) != wanted:
        raise ValueError(_NOT_HORIZONS.format(where=where, name=layers, count=wanted, value=value))
    return tuple(value)


def _refuse_surplus(found: Mapping[str, Any], where: str) -> None:
    parts = {name.partition(".")[0] for name in _LISTS}
    known = {"task", "max_steps", "horizons", *parts}
    names = [name for name in found if name not in known]
    for part in sorted(parts):
        own = found.get(part)
        if isinstance(own, Mapping):
            names += [f"{part}.{field}" for field in own if f"{part}.{field}" not in _LISTS]
    if names:
        listed = ", ".join(["task", "max_steps", *_LISTS, "horizons"])
        raise ValueError(_SURPLUS.format(where=where, name=names[0], names=listed))


def spec_of(
    settings: Settings,
    *,
    title: str,
    control_timestep: float,
    action_bounds: tuple[np.ndarray, np.ndarray],
    goal_names: tuple[Sequence[str], Sequence[str]],
    goal_units: tuple[Sequence[str], Sequence[str]],
    observation_names: Sequence[tuple[str, int]],
    judge: Judge | None,
) -> TaskSpec:
    """A task's spec with these settings.

    Args:
      goal_names, goal_units: of the goal space's dimensions, and of the subgoal space's.
      observation_names: the parts of the observation, and how many numbers each has.
      judge: what achieves an end goal; None: the threshold.

    Raises:
      ValueError: the settings are for another number of observations or goals.
    """
    scale, sizes = list(settings.observation_scale), [size for _, size in observation_names]
    if sum(sizes) != len(scale):
        raise ValueError(
            f"observation.scale has {len(scale)} numbers, and observations have {sum(sizes)}"
        )
    parts, start = {}, 0
    for name, size in observation_names:
        parts[name], start = scale[start : start + size], start + size
    return TaskSpec(
        title=title,
        control_timestep=control_timestep,
        max_steps=settings.max_steps,
        goal_space=_space(settings, "goal", goal_names[0], goal_units[0], judge),
        subgoal_space=_space(settings, "subgoal", goal_names[1], goal_units[1], None),
        observation=parts,
        offset=settings.observation_offset,
        action_bounds=action_bounds,
        horizons=settings.horizons,
    )


def _space(
    settings: Settings, which: str, names: Sequence[str], units: Sequence[str], judge: Judge | None
) -> GoalSpace:
    """The goal space or the subgoal space.

    Raises:
      ValueError: its numbers cannot be; the message says which space's.
    """
    ends = (np.array(getattr(settings, f"{which}_{n}")) for n in ("low", "high", "threshold"))
    try:
        if judge is None:
            return GoalSpace(tuple(names), tuple(units), *ends)
        return JudgedSpace(tuple(names), tuple(units), *ends, judge=judge)
    except ValueError as error:
        raise ValueError(f"{which}: {error}") from error


# -- As a file


_TOML = """\
# Spaces for {task}
# Estimated by launch/fit.py; edit what you know better, then train:
#   python launch/run.py --task={quoted}
task = {word}
max_steps = {max_steps}  # control steps after which an episode is cut off

# (observation - offset) / scale is about [-1, 1]. In the environment's own order.
[observation]
offset = {observation_offset}
scale = {observation_scale}

# The range of end goals; of what episodes reach, in dimensions in which all goals are alike.
# {threshold_note}
[goal]  # {goal_names}
low = {goal_low}
high = {goal_high}
threshold = {goal_threshold}

# The range of subgoals. A subgoal is achieved within the threshold in every dimension.
[subgoal]  # {subgoal_names}
low = {subgoal_low}
high = {subgoal_high}
threshold = {subgoal_threshold}

# T by number of subgoal layers: the most attempts of each level, the lowest level first.
[horizons]
{horizons}
"""
_JUDGED = "The environment decides whether they are achieved; the threshold only describes that."
_BY_THRESHOLD = "An end goal is achieved within the threshold in every dimension."


def as_toml(
    settings: Settings, task: str, file: str, names: tuple[Sequence[str], ...], *, judged: bool
) -> str:
    """The settings as a commented file for a task, whose word is `task`.

    Args:
      judged: whether the task itself decides when an end goal is achieved.
    """
    lists = {
        name.replace(".", "_"): _toml_list(getattr(settings, name.replace(".", "_")))
        for name in _LISTS
    }
    return _TOML.format(
        task=task.partition("?")[0],
        word=_toml_string(task),
        quoted=shlex.quote(file),
        max_steps=settings.max_steps,
        threshold_note=_JUDGED if judged else _BY_THRESHOLD,
        goal_names=", ".join(names[0]),
        subgoal_names=", ".join(names[1]),
        horizons="\n".join(f"{n} = {list(own)}" for n, own in sorted(settings.horizons.items())),
        **lists,
    )


def _toml_string(text: str) -> str:
    if "'" not in text:
        return f"'{text}'"
    return '"' + re.sub(r'(["\\])', r"\\\1", text) + '"'


def _toml_list(numbers: Numbers) -> str:
    text = ", ".join(repr(float(number)) for number in numbers)
    if len(text) < 90:
        return f"[{text}]"
    rows = [numbers[i : i + 8] for i in range(0, len(numbers), 8)]
    lines = (f"  {', '.join(repr(float(number)) for number in row)},\n" for row in rows)
    return "[\n" + "".join(lines) + "]"


def from_toml(text: str, where: str) -> tuple[str, Settings]:
    """The task's word and the settings of what `as_toml` wrote, and somebody may have edited.

    Raises:
      ValueError: it is no TOML, or something is missing or wrong; the message names it.
    """
    try:
        found = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{where}: it is not TOML: {error}") from error
    if not isinstance(found.get("task"), str):
        raise ValueError(_MISSING.format(where=where, name="task"))
    return found["task"], read(found, where)
