"""Published rows come out again, bit for bit: two seeds are trained for a period once more.

On the processor that they were trained on: matrix libraries round otherwise on another.
"""

import functools
import json

import pandas as pd
import pytest
import torch

import hac_suite
import tasks
from analysis.reading import grid, schema
from launch.asking import settings
from launch.folder.manifest import machine


@pytest.fixture(autouse=True)
def as_a_worker_has_it():
    """Denormal numbers count as zero in a worker, which the last bits of a result depend on."""
    torch.set_flush_denormal(True)
    yield
    torch.set_flush_denormal(False)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "layers", "seed"), [("pendulum_climb", 0, 3), ("ur5_reacher", 1, 7)]
)
def test_a_published_seed_is_trained_again(task, layers, seed):
    folder = grid.FOLDER / task
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    if manifest["machine"]["cpu"] != machine()["cpu"]:
        pytest.skip(f"published by {manifest['machine']['cpu']}, which rounds otherwise")
    published = pd.read_csv(folder / "results.csv").set_index(["subgoal_layers", "seed", "period"])
    periods = hac_suite.train(
        functools.partial(tasks.load_vector, task),
        settings.to_config(hac_suite.completed(manifest["config"])),
        [seed],
        subgoal_layers=layers,
        horizons=tuple(manifest["horizons"][str(layers)]),
        periods=1,
    )
    for result in periods:
        (row,) = result.rows
        expected = published.loc[layers, seed, result.period]
        for column, value in row.items():
            if column in expected and column not in schema.CLOCKS:
                then = expected[column]
                assert value == then or (pd.isna(value) and pd.isna(then)), column
        assert len(set(row) & set(expected.index)) > 15
