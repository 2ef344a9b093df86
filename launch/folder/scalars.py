"""--tensorboard: writes the numbers of results.csv as curves for TensorBoard."""

import math
import shutil
from collections.abc import Iterable, Mapping
from typing import Any

from torch.utils.tensorboard import SummaryWriter

from analysis.reading import names
from analysis.reading.schema import LEVEL_FIELDS, MAX_LEVELS, level_column
from launch.folder import results
from launch.folder.layout import RunFolder

_TAGS = {name: name for name in ("success_rate", "mean_steps_to_goal", "diverged_episodes")} | {
    level_column(level, field): f"level{level}/{field}"
    for level in range(MAX_LEVELS)
    for field in LEVEL_FIELDS
}


class Scalars:
    """A folder of events for each run (an agent and a seed), a point for each test period."""

    def __init__(self, folder: RunFolder) -> None:
        """Begins with what is in results.csv: what was written before is replaced by that."""
        self._path = folder.path / names.TENSORBOARD
        self._writers: dict[str, SummaryWriter] = {}
        shutil.rmtree(self._path, ignore_errors=True)
        self.add(results.read(folder.results)[0])

    def add(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Adds rows of results.csv, at their training episodes; empty cells have no point."""
        added = set()
        for row in rows:
            name = f"{row['task']}_{row['subgoal_layers']}layers_seed{row['seed']}"
            if name not in self._writers:
                self._writers[name] = SummaryWriter(str(self._path / name), max_queue=1000)
            added.add(name)
            for column, tag in _TAGS.items():
                value = _number(row.get(column))
                if value is not None:
                    self._writers[name].add_scalar(tag, value, int(row["train_episodes"]))
        for name in added:
            self._writers[name].flush()

    def close(self) -> None:
        for writer in self._writers.values():
            writer.close()


def _number(cell: Any) -> float | None:
    """The number in a cell; None for an empty one, or one that somebody made unreadable."""
    try:
        value = float(cell)
    except (TypeError, ValueError):
        return None
    return None if math.isnan(value) else value
