"""Reads anatomy.json: one recorded episode of each of a task's agents, with all its subgoals."""

import itertools
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from analysis.reading import names
from analysis.reading.subgoals import recording_command

_VIEWS = {"xy": "from above", "xz": "from the side"}
_BAD_FILE = "{path}: not a record of episodes ({error}); record it again with `{command}`"


@dataclass(frozen=True)
class Space:
    """A goal space: what its dimensions are, and how near counts as achieved."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    threshold: tuple[float, ...]


@dataclass(frozen=True)
class Subgoal:
    """A subgoal, what its outcome was, and the steps from its proposal to that."""

    level: int  # that proposed it
    step: int
    end_step: int
    outcome: str  # "achieved", "missed" or "cut short"
    point: np.ndarray  # [H]


class GoalDimension(NamedTuple):
    """A dimension of the end goal that subgoals do not have."""

    name: str
    unit: str
    goal: tuple[float, float]  # and its threshold
    path: np.ndarray | None  # [steps + 1]; None: an earlier version did not record it


@dataclass(frozen=True)
class Episode:
    """One recorded test episode of an agent."""

    task: str
    subgoal_layers: int
    seed: int
    success: bool
    goal: np.ndarray  # [G]
    path: np.ndarray  # [steps + 1, H]
    subgoals: tuple[Subgoal, ...]
    subgoal_space: Space
    goal_space: Space
    goal_path: np.ndarray | None  # [steps + 1, dimensions that only the end goal has]

    @property
    def steps(self) -> int:
        """Actions taken."""
        return len(self.path) - 1

    def of_level(self, level: int) -> list[Subgoal]:
        """The subgoals that a level proposed, in the order of time."""
        return [subgoal for subgoal in self.subgoals if subgoal.level == level]

    def goal_in(self, dimension: int) -> tuple[float, float] | None:
        """The goal and its threshold in a dimension of the subgoal space; None if it has none."""
        name = self.subgoal_space.names[dimension]
        if name not in self.goal_space.names:
            return None
        index = self.goal_space.names.index(name)
        return float(self.goal[index]), self.goal_space.threshold[index]

    @property
    def goal_only(self) -> list[GoalDimension]:
        """What the end goal asks for beyond what subgoals can."""
        space, found = self.goal_space, list[GoalDimension]()
        for index, (name, unit) in enumerate(zip(space.names, space.units, strict=True)):
            if name not in self.subgoal_space.names:
                path = None if self.goal_path is None else self.goal_path[:, len(found)]
                goal = float(self.goal[index]), space.threshold[index]
                found.append(GoalDimension(name, unit, goal, path))
        return found


def load_episodes(folder: Path, task: str, file: str = names.ANATOMY) -> list[Episode]:
    """The recorded episodes of a task, one of each agent.

    Args:
      file: another of the same form, such as that of episodes that failed.

    Raises:
      FileNotFoundError: `folder` holds no such file.
      ValueError: it is damaged; the message says how to make it.
    """
    path = Path(folder) / file
    text = path.read_text(encoding="utf-8")
    try:
        record = json.loads(text)
        spaces = {name: _space(record[name]) for name in ("subgoal_space", "goal_space")}
        return [_episode(record["task"], spaces, item) for item in record["episodes"]]
    except (KeyError, TypeError, ValueError) as error:
        command = recording_command(task, folder)
        raise ValueError(_BAD_FILE.format(path=path, error=repr(error), command=command)) from error


def _space(item: dict[str, Any]) -> Space:
    return Space(tuple(item["names"]), tuple(item["units"]), tuple(item["threshold"]))


def _episode(task: str, spaces: dict[str, Space], item: dict[str, Any]) -> Episode:
    subgoals = tuple(
        Subgoal(s["level"], s["step"], s["end_step"], s["outcome"], np.array(s["subgoal"]))
        for s in item["subgoals"]
    )
    path = np.array(item["path"], dtype=float)
    if path.ndim != 2 or path.shape[1] != len(spaces["subgoal_space"].names):
        raise ValueError("the path is not one of points of the subgoal space")
    goal_path = np.array(item["goal_path"], dtype=float) if "goal_path" in item else None
    shared = set(spaces["goal_space"].names) & set(spaces["subgoal_space"].names)
    goal_only = len(spaces["goal_space"].names) - len(shared)
    if goal_path is not None and goal_path.shape != (len(path), goal_only):
        raise ValueError("the goal's path does not match the path")
    return Episode(
        task, item["subgoal_layers"], item["seed"], item["success"], np.array(item["goal"]),
        path, subgoals, **spaces, goal_path=goal_path,
    )  # fmt: skip


def load_units(folder: Path) -> dict[str, str]:
    """Units of the goal spaces' dimensions by name, from a record of episodes; {} without one."""
    for file in (names.FAILED_EPISODES, names.ANATOMY):
        try:
            record = json.loads((Path(folder) / file).read_text(encoding="utf-8"))
            spaces = record["goal_space"], record["subgoal_space"]
            pairs = [zip(space["names"], space["units"], strict=True) for space in spaces]
            return dict(itertools.chain(*pairs))
        except (OSError, KeyError, TypeError, ValueError):
            continue  # not recorded, or damaged: figures do without units
    return {}


def labelled(name: str, unit: str | None) -> str:
    """A dimension as an axis names it: "tip x (m)"."""
    plain = name.replace("_", " ")
    return f"{plain} ({unit})" if unit else plain


def planes(names: Sequence[str]) -> Iterator[tuple[str, tuple[int, int]]]:
    """The planes to show, named, with the dimensions that span them: ("rod", (2, 3))."""
    bodies = dict.fromkeys(name.rpartition("_")[0] for name in names)
    for body in bodies:
        points = {f"{body}_{axis}" for axis in "xyz"}
        axes = {name[-1]: i for i, name in enumerate(names) if name in points}
        for view, explained in _VIEWS.items():
            if set(view) <= set(axes):
                title = f"{body}, {explained}" if len(axes) > 2 else body
                yield title, (axes[view[0]], axes[view[1]])


def some_planes(names: Sequence[str]) -> list[tuple[str, tuple[int, int]]]:
    """As `planes`; where dimensions are no places, the first two, and none of a space of one."""
    found = list(planes(names))
    if found or len(names) < 2:
        return found
    return [(f"{names[0]} and {names[1]}".replace("_", " "), (0, 1))]
