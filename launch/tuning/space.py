"""The search space of a tuning study, as its file defines it."""

import dataclasses
import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

import hac_suite
from analysis.program import CommandError, unknown
from launch.asking import settings

FILE = Path(__file__).parent / "search.toml"
OWN = "own"  # T_0 of a task's own T
_T_0 = "T_0"
_ENTRY_KEYS = ("low", "high", "log", "choices", "together", "least_layers")
_KINDS = "{low, high}, {choices}, {together}"
_TABLES = ("core_minutes", "space", "starts")

Values = dict[str, Any]


class Range(NamedTuple):
    """Numbers from `low` to `high`, both included; whole ones where the field takes those."""

    low: float
    high: float
    log: bool


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One thing that is varied: a range, or choices by label, each of which sets some fields."""

    name: str
    range: Range | None
    choices: Mapping[str | int | float | bool, Values]
    least_layers: int

    def settings(self, value: Any) -> Values:
        """The fields that a value of this parameter sets."""
        return {self.name: value} if self.range else self.choices[value]

    def fields(self) -> set[str]:
        return {self.name} if self.range else {key for own in self.choices.values() for key in own}

    def value_of(self, given: Values) -> Any:
        """The value with which this parameter sets its fields as given.

        Raises:
          CommandError: it has no such value.
        """
        own = {name: given[name] for name in self.fields()}
        if self.range and self.range.low <= own[self.name] <= self.range.high:
            return own[self.name]
        for value, fields in self.choices.items():
            if fields == own:
                return value
        said = ", ".join(f"{name} = {value!r}" for name, value in sorted(own.items()))
        raise CommandError(f"{said} is not in the search space of {self.name}")


@dataclasses.dataclass(frozen=True)
class Space:
    """A search file: what is varied, what is tried first, and the budget of the objective."""

    parameters: tuple[Parameter, ...]
    starts: Mapping[str, Values]  # by label, the fields that each sets
    core_minutes: float  # for each seed and period
    text: Values  # the file as read: studies of different files are not mixed

    def of(self, subgoal_layers: int) -> tuple[Parameter, ...]:
        """The parameters that do something for an agent."""
        return tuple(p for p in self.parameters if p.least_layers <= subgoal_layers)

    def start(self, label: str, subgoal_layers: int) -> Values:
        """Values of an agent's parameters for the start of that label."""
        given = {**_defaults(), **self.starts[label]}
        return {p.name: p.value_of(given) for p in self.of(subgoal_layers)}


def settings_of(parameters: Sequence[Parameter], values: Values) -> tuple[Values, int | str]:
    """The fields of Config that the parameters' values set, and T_0 (`OWN` where not varied)."""
    chosen: Values = {}
    for parameter in parameters:
        chosen.update(parameter.settings(values[parameter.name]))
    attempts = chosen.pop(_T_0, OWN)
    return chosen, attempts


def horizons(
    max_steps: int,
    subgoal_layers: int,
    attempts: int | str,
    own: Mapping[int, tuple[int, ...]],
) -> tuple[int, ...]:
    """T of all levels, given T_0: those above share what is left of the episode equally.

    A task of 400 steps with T_0 = 8 leaves 50 for two levels: (8, 8, 7).

    Args:
      attempts: T_0; or `OWN`: the task's own T, `own` where it has some.
    """
    if attempts == OWN or not subgoal_layers:
        return hac_suite.horizons(max_steps, subgoal_layers, own)
    found = [min(int(attempts), max_steps)]
    left = math.ceil(max_steps / found[0])
    for levels in range(subgoal_layers, 0, -1):
        share = max(1, round(left ** (1 / levels)))
        while share**levels < left:
            share += 1
        found.append(share)
        left = math.ceil(left / share)
    return tuple(found)


def read(path: Path) -> Space:
    """Reads a search file.

    Raises:
      CommandError: it cannot be read, or says something that cannot be; names what.
    """
    try:
        text = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise CommandError(f"there is no search file {str(path)!r}; {_relative()} is one") from None
    except (OSError, ValueError) as error:
        raise CommandError(f"{path} cannot be read: {error}".splitlines()[0]) from error
    try:
        return _space(text)
    except CommandError as error:
        raise CommandError(f"{path}: {error}") from error


def _relative() -> str:
    return "/".join(FILE.parts[-3:])


def _space(text: Values) -> Space:
    for name in text:
        if name not in _TABLES:
            raise CommandError(unknown("name", name, _TABLES))
    minutes, entries, starts = text.get("core_minutes"), text.get("space"), text.get("starts", {})
    if not _is_number(minutes) or minutes <= 0:
        raise CommandError(f"core_minutes = {minutes!r}: give a number above zero")
    if not isinstance(entries, dict) or not entries:
        raise CommandError("[space] names no hyperparameter to vary")
    if not isinstance(starts, dict) or not all(isinstance(s, dict) for s in starts.values()):
        raise CommandError("[starts] must hold tables, as in [starts.default]")
    parameters = tuple(_parameter(name, entry) for name, entry in entries.items())
    _check_once(parameters)
    space = Space(parameters, starts, float(minutes), text)
    for label in starts:
        _check_start(space, label)
    return space


def _parameter(name: str, entry: Any) -> Parameter:
    if not isinstance(entry, dict):
        raise CommandError(f"{name} = {entry!r}: it takes {_KINDS}")
    for key in entry:
        if key not in _ENTRY_KEYS:
            raise CommandError(f"{name}: {unknown('key', key, _ENTRY_KEYS)}")
    least = entry.get("least_layers", 0)
    if type(least) is not int or least < 0:
        raise CommandError(f"{name}: least_layers = {least!r}: it takes a whole number")
    kinds = [kind for kind in ("low", "choices", "together") if kind in entry]
    if len(kinds) != 1:
        raise CommandError(f"{name}: it takes one of {_KINDS}")
    if kinds == ["low"]:
        return Parameter(name, _range(name, entry), {}, least)
    return Parameter(name, None, _choices(name, kinds[0], entry[kinds[0]]), least)


def _range(name: str, entry: Values) -> Range:
    low, high, log = entry["low"], entry.get("high"), entry.get("log", False)
    if not (_is_number(low) and _is_number(high) and low < high):
        raise CommandError(f"{name}: low = {low!r} and high = {high!r} are no range")
    if type(log) is not bool or (log and low <= 0):
        raise CommandError(
            f"{name}: log = {log!r}: it takes true or false; true needs low above zero"
        )
    if name == _T_0:
        raise CommandError(f"{_T_0} takes choices")
    for end in (low, high):
        _check({name: end})
    return Range(low, high, log)


def _choices(name: str, kind: str, listed: Any) -> dict[Any, Values]:
    wanted = dict if kind == "together" else (str, int, float)
    if not isinstance(listed, list) or not listed or not all(isinstance(c, wanted) for c in listed):
        raise CommandError(f"{name}: {kind} = {listed!r}: give a list of values to choose from")
    if kind == "choices":
        found = {choice: {name: choice} for choice in listed}
    else:
        found = {" ".join(map(str, choice.values())): dict(choice) for choice in listed}
    if len(found) < len(listed):
        raise CommandError(f"{name}: {kind}: one of them is listed twice")
    if len({frozenset(choice) for choice in found.values()}) > 1:
        raise CommandError(f"{name}: together: each entry must set the same fields")
    for choice in found.values():
        _check(choice)
    return found


def _check(chosen: Values) -> None:
    """Raises CommandError for a field that there is not, or a value that it does not take."""
    fields = {**chosen}
    if _T_0 in fields:
        attempts = fields.pop(_T_0)
        if attempts != OWN and (type(attempts) is not int or attempts < 1):
            raise CommandError(f"{_T_0} = {attempts!r}: it takes a count, or {OWN!r}")
    settings.to_config({**settings.as_json(hac_suite.Config()), **fields})


def _check_once(parameters: Sequence[Parameter]) -> None:
    seen: set[str] = set()
    for parameter in parameters:
        for name in parameter.fields() & seen:
            raise CommandError(f"{name} is varied twice")
        seen |= parameter.fields()


def _check_start(space: Space, label: str) -> None:
    """A start sets nothing that is not varied, and nothing outside what is."""
    varied = {name for parameter in space.parameters for name in parameter.fields()}
    try:
        for name in space.starts[label]:
            if name not in varied:
                raise CommandError(unknown("setting", name, sorted(varied)))
        space.start(label, max(p.least_layers for p in space.parameters))
    except CommandError as error:
        raise CommandError(f"[starts.{label}]: {error}") from error


def _defaults() -> Values:
    return {**settings.as_json(hac_suite.Config()), _T_0: OWN}


def _is_number(value: Any) -> TypeGuard[int | float]:
    return type(value) in (int, float) and math.isfinite(value)
