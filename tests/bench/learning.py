"""How long agents of ours and of another library train until the median seed reaches 90%."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from analysis.peers import FOLDER
from analysis.reading import grid
from analysis.statistics.peers import OURS, SOLVED, load_strangers, minutes_to, our_curves
from tests.bench.repeats import rounded


def learning(say: Callable[[str], None]) -> dict[str, Any]:
    """`minutes_to_90` and its ratios, from the published curves: nothing is trained here."""
    say(f"core-minutes to {SOLVED:.0%}, from the published curves")
    strangers = load_strangers(FOLDER) if any(Path(FOLDER).glob("*.csv")) else None
    return waits(grid.load_grid(grid.FOLDER), strangers, grid.load_as_peers(grid.FOLDER))


def waits(
    ours: Mapping[str, pd.DataFrame],
    strangers: pd.DataFrame | None,
    others: Mapping[str, Mapping[str, pd.DataFrame]],
) -> dict[str, Any]:
    """`minutes_to_90` by task and agent, None for one that does not get there, and the ratios.

    A ratio is the least of another library's agents over the least of ours; there is none on a task
    that only one side reaches 90% on.
    """
    curves = [our_curves(ours, others), *([] if strangers is None else [strangers])]
    table = minutes_to(pd.concat(curves, ignore_index=True), SOLVED)
    minutes: dict[str, dict[str, float | None]] = {}
    ratios: dict[str, float] = {}
    for task, own in table.groupby("task", sort=False):
        names = (own["agent"] + " " + own["settings"]).tolist()
        values = [rounded(value) if np.isfinite(value) else None for value in own["minutes"]]
        minutes[str(task)] = dict(zip(names, values, strict=True))
        best = own.groupby(own["agent"] == OURS)["minutes"].min()
        if len(best) > 1 and np.isfinite(best).all():
            ratios[str(task)] = rounded(best[False] / best[True])
    return {"minutes_to_90": minutes, "minutes_to_90_ratio": ratios}
