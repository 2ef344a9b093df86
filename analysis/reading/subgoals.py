"""Reads subgoals.csv, the recorded high-level subgoals of a task, and names what records it."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from analysis.reading import names

_ROOT = Path(__file__).parents[2]
_KEY = ("task", "subgoal_layers", "seed", "episode", "level", "step", "end_step", "outcome")
_MISSING_COLUMNS = "{path}: lacks the column(s) {names}; record it anew with `{command}`"


def recording_command(task: str, folder: Path) -> str:
    """What records a task's subgoals and episodes into `folder`, run from the repository's root."""
    folder = Path(folder)
    if folder.is_absolute() and folder.is_relative_to(_ROOT):
        folder = folder.relative_to(_ROOT)
    return f"python launch/record_subgoals.py --task={task} --output={folder}"


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
    try:
        table = pd.read_csv(path)
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: not a table ({error})") from error
    wanted = [f"{kind}_{name}" if kind else name for kind in points for name in points[kind]]
    missing = [name for name in (*_KEY, *wanted) if name not in table]
    if missing:
        command = recording_command(task, folder)
        lacking = ", ".join(missing)
        raise ValueError(_MISSING_COLUMNS.format(path=path, names=lacking, command=command))
    return table


def places(table: pd.DataFrame, kind: str, of: tuple[str, ...]) -> np.ndarray:
    """Points [rows, names] of a kind: "subgoal", "start" of the agent, its "end", or "goal"."""
    return table[[f"{kind}_{name}" for name in of]].to_numpy(dtype=float)
