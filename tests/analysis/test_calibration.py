"""Steps to goal of converged agents against the paper's counts."""

import numpy as np
import pytest

from analysis.calibration import calibrate, main
from analysis.reading.results import load


def test_only_converged_seeds_count(make_results):
    # Seed s takes 132 + s steps; only seeds 1, 2 and 3 end at 80% or more, seed 3 a period early.
    results = make_results(
        {1: [[0.9, 0.7], [0.0, 0.8], [0.0, 1.0], [0.9, None]]}, task="pick_place", steps=132
    )
    (row,) = calibrate(results).itertuples()
    assert (row.task, row.converged, row.seeds) == ("pick_place", 3, 4)
    assert row.median_steps == 134
    assert row.paper_steps == 110
    assert row.ratio == pytest.approx(134 / 110)


def test_agents_of_all_layers_count(make_results):
    (row,) = calibrate(make_results({0: [[1.0]], 2: [[1.0], [1.0], [0.5]]}, steps=50)).itertuples()
    assert (row.converged, row.seeds, row.median_steps) == (3, 4, 50)


def test_nothing_converged_and_unknown_tasks_give_no_ratio(make_run, capsys):
    paths = [make_run({1: [[0.0, 0.5]]}, task="ur5_reacher"), make_run({1: [[1.0]]}, task="stack")]
    reacher, stack = calibrate(load(paths)).itertuples()  # tasks of the paper come first
    assert np.isnan(reacher.median_steps) and np.isnan(reacher.ratio)
    assert reacher.paper_steps == 60
    assert np.isnan(stack.ratio) and stack.median_steps == 110


def test_command_line_prints_a_row_per_task(make_run, capsys, tmp_path):
    paths = [
        make_run({1: [[1.0]]}, steps=132),
        make_run({1: [[0.5]]}, task="ur5_reacher") / "results.csv",
    ]
    assert main(["", *map(str, paths)]) == 0
    header, *rows = capsys.readouterr().out.splitlines()
    assert header.split() == ["task", "converged", "seeds", "median_steps", "paper_steps", "ratio"]
    assert rows[0].split() == ["ur5_reacher", "0", "1", "-", "60", "-"]
    assert rows[1].split() == ["pick_place", "1", "1", "132", "110", "1.20"]
    assert main(["", str(tmp_path / "none")]) == 2
