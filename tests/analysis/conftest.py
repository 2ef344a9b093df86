"""Made-up results for the analysis tests."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pandas as pd
import pytest

from analysis.reading import schema
from analysis.statistics import comparison, seeds

Curves = Mapping[int, Sequence[Sequence[float | None]]]
MakeResults = Callable[..., pd.DataFrame]


@pytest.fixture(autouse=True)
def fewer_resamples(request, monkeypatch) -> None:
    """Intervals and p values of a fifth of the resamples: a judgement takes seconds with all."""
    if request.path.parent.name != "statistics":
        monkeypatch.setattr(seeds, "RESAMPLES", 1999)
        monkeypatch.setattr(comparison, "_PERMUTATIONS", 1999)


@pytest.fixture
def make_results() -> MakeResults:
    """Builds results from success rates: `{subgoal_layers: [seed 0's curve, seed 1's, ...]}`.

    None in a curve leaves that period out.
    """

    def make(curves: Curves, task: str = "pick_place", steps: float = 110.0) -> pd.DataFrame:
        rows = [
            _row(task, layers, seed, period, success, steps)
            for layers, seeds in curves.items()
            for seed, curve in enumerate(seeds)
            for period, success in enumerate(curve)
            if success is not None
        ]
        return pd.DataFrame(rows, columns=list(schema.RESULTS_COLUMNS))

    return make


def _row(
    task: str, layers: int, seed: int, period: int, success: float, steps: float
) -> dict[str, object]:
    row: dict[str, object] = {
        "task": task,
        "subgoal_layers": layers,
        "seed": seed,
        "period": period,
        "train_episodes": 300 * period,
        "train_steps": 30_000 * period,
        "test_episodes": 64,
        "success_rate": success,
        "mean_steps_to_goal": steps + seed if success else None,
        "wall_seconds": 12.5 * period,
        "diverged_episodes": 0,
    }
    for level in range(layers + 1):
        row[schema.level_column(level, "q_mean")] = -5.0 - level
    for level in range(1, layers + 1):
        row[schema.level_column(level, "proposed")] = 20.0 if period else None
        row[schema.level_column(level, "achieved")] = success if period else None
    return row


@pytest.fixture
def make_run(tmp_path: Path, make_results: MakeResults) -> Callable[..., Path]:
    """Writes made-up results as a run folder and returns its path."""

    def make(curves: Curves, task: str = "pick_place", **changes: float) -> Path:
        folder = tmp_path / "runs" / task
        folder.mkdir(parents=True)
        make_results(curves, task, **changes).to_csv(folder / "results.csv", index=False)
        return folder

    return make
