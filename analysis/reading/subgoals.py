"""Reads records of policies' subgoals, starts and values, and names the command that makes them."""

import json
import re
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from analysis.reading import names
from analysis.reading.results import read_manifest

_ROOT = Path(__file__).parents[2]
_KEY = ("task", "subgoal_layers", "seed", "episode", "level", "step", "end_step", "outcome")
_WORDS = ("task", "outcome")  # columns that hold no numbers
_MISSING_COLUMNS = "{path}: lacks the column(s) {names}; record it again with `{command}`"


def recording_command(task: str, folder: Path) -> str:
    """What records a task's subgoals and episodes into `folder`, run from the repository's root."""
    word, folder = shlex.quote(task_word(task, folder)), Path(folder)
    if folder.is_absolute() and folder.is_relative_to(_ROOT):
        folder = folder.relative_to(_ROOT)
    output = shlex.quote(str(folder))
    return f"python launch/record_subgoals.py --task={word} --output={output}"


def task_word(task: str, folder: Path) -> str:
    """What --task takes for the task of a run folder; its name, where nothing else is known.

    The name finds a task of the suite alone. The manifest has the word of one of your own: a
    Gymnasium environment's with its options, or the file that the latest launch was given.
    """
    manifest, _ = read_manifest(Path(folder))
    origin, command = manifest.get("task_file"), manifest.get("command")
    if not isinstance(origin, dict):
        return task
    word = str(origin.get("task", ""))
    if word.startswith("gym:"):
        return word
    words = "\0".join(map(str, command)) if isinstance(command, list) else ""
    given = re.findall("\0--?task[=\0]([^\0]+)", words)
    return given[-1] if given else task


def load_subgoals(folder: Path, task: str, points: Mapping[str, tuple[str, ...]]) -> pd.DataFrame:
    """The recorded subgoals of a task: a row for each, in the order of time.

    Args:
      folder: holds subgoals.csv.
      points: the columns that will be needed beside the key: names by kind, such as
        {"goal": ("rod_x",)}; the kind "" stands for columns without one.

    Raises:
      FileNotFoundError: there is no such file.
      ValueError: it is not a table, or lacks columns; the message says how to make it.
    """
    path = Path(folder) / names.SUBGOALS
    table = _read_table(path)
    wanted = [f"{kind}_{name}" if kind else name for kind in points for name in points[kind]]
    missing = [name for name in (*_KEY, *wanted) if name not in table]
    if missing:
        command = recording_command(task, folder)
        lacking = ", ".join(missing)
        raise ValueError(_MISSING_COLUMNS.format(path=path, names=lacking, command=command))
    return table


def _read_table(path: Path) -> pd.DataFrame:
    try:
        table = pd.read_csv(path, dtype=dict.fromkeys(_WORDS, str))
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: not a table ({error})") from error
    for name in table:
        column = table[name]
        if name not in _WORDS and len(table) and not pd.api.types.is_numeric_dtype(column):
            raise ValueError(f"{path}: column {name} holds values that are not numbers")
        if column.isna().any():
            raise ValueError(f"{path}: column {name} has empty cells")
    return table


def places(table: pd.DataFrame, kind: str, of: tuple[str, ...]) -> np.ndarray:
    """Points [rows, names] of a kind: "subgoal", "start" of the agent, its "end", or "goal"."""
    return table[[f"{kind}_{name}" for name in of]].to_numpy(dtype=float)


def load_recorded(folder: Path, file: str) -> pd.DataFrame:
    """starts.csv, maps.csv or subgoals.csv of a run folder.

    subgoals.csv is of trained policies: its `train_episodes` are -1.

    Raises:
      FileNotFoundError: there is no such file.
      ValueError: it is not one of these tables.
    """
    path = Path(folder) / file
    table = _read_table(path)
    if file == names.SUBGOALS:
        table = table.assign(train_episodes=-1)
    missing = {"task", "subgoal_layers", "seed", "train_episodes", "episode"} - set(table)
    if missing:
        raise ValueError(f"{path}: lacks the column(s) {', '.join(sorted(missing))}")
    return table


def load_values(folder: Path) -> list[dict[str, Any]]:
    """values.json of a run folder: for each agent its maps of Q.

    Raises:
      FileNotFoundError: there is no such file.
      ValueError: it is damaged.
    """
    path = Path(folder) / names.VALUES
    try:
        return list(json.loads(path.read_text(encoding="utf-8"))["agents"])
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: not a record of values ({error!r})") from error


def points_named(table: pd.DataFrame, kind: str) -> tuple[str, ...]:
    """The dimensions of a kind of points in a table: "subgoal", "start" or "goal"."""
    return tuple(
        str(column).removeprefix(f"{kind}_")
        for column in table
        if str(column).startswith(f"{kind}_") and column != "subgoal_layers"
    )
