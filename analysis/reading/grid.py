"""The published grid of the paper's tasks: a run folder per task; some may be missing."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from analysis.reading import paper
from analysis.reading.results import NoResults, load, with_updates

FOLDER = Path(__file__).parents[1] / "data" / "grid"

FLATS = {
    "TD3+HER": "grid_td3",
    "DDPG+HER, half the rate": "grid_half_rate",
    "DDPG+HER, 3 goals a segment": "grid_goals_per_segment",
}
"""Agents without subgoal layers that were trained otherwise than the grid's, and their folders
beside it."""
DEEPER = {"half the rate, fewer updates": "grid_fewer_updates"}
"""The same of agents with two subgoal layers."""
AS_PEERS = {
    "TD3+HER": "grid_td3",
    "40 updates": "grid_40_updates",
    "TD3+HER, 40 updates": "grid_td3_40_updates",
}
"""Our agents that another library's are compared with, besides the grid's. 40 updates: after each
episode, with 4 hindsight goals, as the other library's agents called ours40 have."""

_NOTHING = "{folder}: holds results of none of the paper's tasks ({tasks})"
_WRONG_TASK = "{folder}: holds results of {found}; a folder is named after its task"


def load_grid(folder: Path) -> dict[str, pd.DataFrame]:
    """Results of the paper's tasks, in the order of its Figure 5; tasks without any are left out.

    Args:
      folder: holds `<task>/results.csv`.

    Raises:
      ValueError: none of the tasks has results, or as `analysis.reading.results.load`.
    """
    grid = {}
    for task in paper.TITLES:
        try:
            path = Path(folder) / task
            results = with_updates(load(path), path)
        except (FileNotFoundError, NoResults):
            continue
        if set(results["task"]) != {task}:
            found = ", ".join(sorted(results["task"].unique()))
            raise ValueError(_WRONG_TASK.format(folder=Path(folder) / task, found=found))
        grid[task] = results
    if not grid:
        raise ValueError(_NOTHING.format(folder=folder, tasks=", ".join(paper.TITLES)))
    return grid


def load_flats(folder: Path) -> dict[str, dict[str, pd.DataFrame]]:
    """Results of the agents of `FLATS` by name and task; those that are not there are left out.

    Args:
      folder: the grid's; theirs are beside it.

    Raises:
      ValueError: as `load_grid`.
    """
    return _beside(folder, FLATS, 0)


def load_deeper(folder: Path) -> dict[str, dict[str, pd.DataFrame]]:
    """The same of the agents of `DEEPER`."""
    return _beside(folder, DEEPER, 2)


def load_as_peers(folder: Path) -> dict[str, dict[str, pd.DataFrame]]:
    """The same of the agents of `AS_PEERS`, with any number of subgoal layers."""
    return _found(folder, AS_PEERS)


def _beside(folder: Path, folders: Mapping[str, str], layers: int) -> dict:
    return {
        name: {task: rows[rows["subgoal_layers"] == layers] for task, rows in own.items()}
        for name, own in _found(folder, folders).items()
    }


def _found(folder: Path, folders: Mapping[str, str]) -> dict[str, dict[str, pd.DataFrame]]:
    beside = Path(folder).resolve().parent
    return {
        name: load_grid(beside / own) for name, own in folders.items() if (beside / own).is_dir()
    }
