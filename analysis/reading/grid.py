"""The paper's grid as this repository publishes it: a run folder per task, some perhaps missing."""

from pathlib import Path

import pandas as pd

from analysis.reading import paper
from analysis.reading.results import NoResults, load

FOLDER = Path(__file__).parents[1] / "data" / "grid"

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
            results = load(Path(folder) / task)
        except (FileNotFoundError, NoResults):
            continue
        if set(results["task"]) != {task}:
            found = ", ".join(sorted(results["task"].unique()))
            raise ValueError(_WRONG_TASK.format(folder=Path(folder) / task, found=found))
        grid[task] = results
    if not grid:
        raise ValueError(_NOTHING.format(folder=folder, tasks=", ".join(paper.TITLES)))
    return grid
