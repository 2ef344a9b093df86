"""Peers beside our agents: hand-computed values at a budget, a real curve, and errors."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis import peers
from analysis.statistics.peers import (
    BUDGETS,
    COLUMNS,
    OURS,
    as_curves,
    at,
    compare,
    load_curve,
    load_strangers,
    minutes_to,
)

STEPS, MINUTES = BUDGETS
# Made by `python -m tests.bench.peers --task=pendulum_climb --agent=td3,sac --settings=ours20
# --seeds=100-101 --episodes=120 --test_every=30 --minutes=1`, and with --task=ur5_reacher
# --agent=td3 --seeds=100-100 --episodes=500 --test_every=100.
REAL = Path(__file__).parent / "peers_curves"


def _curve(seed, *tests, agent="sac", settings="zoo", task="pick_place"):
    """A curve from (steps, minutes, success) of each test."""
    rows = [
        (task, agent, settings, seed, 300 * i, steps, minutes, success, 64)
        for i, (steps, minutes, success) in enumerate(tests)
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def test_success_between_two_tests_lies_on_the_line_between_them():
    curve = _curve(0, (0, 0, 0.0), (20_000, 1, 0.2), (60_000, 3, 0.8))
    found = [at(curve, "train_steps", x) for x in (0, 5_000, 20_000, 50_000, 60_000)]
    assert found == pytest.approx([0, 0.05, 0.2, 0.65, 0.8])
    assert at(curve, "core_minutes", 2.5) == pytest.approx(0.65)
    assert np.isnan(at(curve, "train_steps", 60_001))


def test_the_median_seed_waits_for_a_success_as_long_as_its_own_curve_says():
    ours = [
        _curve(seed, (0, 0, 0.0), (10, minutes, 0.8), (20, 2 * minutes, 1.0), agent=OURS)
        for seed, minutes in enumerate((1.0, 2.0, 4.0))
    ]
    two_of_four = [
        _curve(seed, (0, 0, 0.0), (10, 9.0, most)) for seed, most in enumerate((0.95, 0.9, 0.5, 0))
    ]
    at_once = _curve(7, (0, 0.5, 0.9), (10, 9.0, 0.2), settings="ours20")
    table = minutes_to(pd.concat([*ours, *two_of_four, at_once]), 0.9)
    assert table["agent"].tolist() == [OURS, "sac", "sac"]
    assert table["seeds"].tolist() == [3, 4, 1] and table["reached"].tolist() == [3, 2, 1]
    assert table["minutes"].tolist() == pytest.approx([3.0, np.inf, 0.5])
    assert table["ratio"].tolist() == pytest.approx([1.0, np.inf, 1 / 6])


def test_a_budget_is_compared_over_the_seeds_that_spent_it():
    curves = pd.concat(
        [
            _curve(3, (0, 0, 0.0), (20_000, 1, 0.4)),
            _curve(4, (0, 0, 0.0), (20_000, 1, 0.6), (40_000, 2, 1.0)),
        ]
    )
    table = compare(curves, STEPS).set_index("amount")
    ten, thirty, hundred = (table.loc[x] for x in (1e4, 3e4, 1e5))
    assert (ten["n"], ten["mean"], ten["seeds"]) == (2, pytest.approx(0.25), 2)
    assert ten["early"] and not thirty["early"]  # both are first tested after 20,000 steps
    assert ten["low"] <= 0.25 <= ten["high"]
    assert (thirty["n"], thirty["mean"]) == (1, pytest.approx(0.8)) and np.isnan(thirty["low"])
    assert hundred["n"] == 0 and np.isnan(hundred["mean"])
    end = table[table.index.isna()].iloc[0]
    assert (end["n"], end["mean"], end["spent"]) == (2, pytest.approx(0.7), 30_000)


def test_seeds_of_one_process_share_its_minutes(make_results):
    results = make_results({0: [[0.0, 0.5], [0.0, 0.7]], 2: [[0.0, 0.5], [0.0, 0.7]]})
    alone = (results["subgoal_layers"] == 2) & (results["seed"] == 1)
    results.loc[alone, "wall_seconds"] *= 4  # 50 s where the others took 12.5
    curves = as_curves(results)
    assert tuple(curves.columns) == COLUMNS and len(curves) == len(results)
    last = curves[curves["train_episodes"] == 300].set_index(["settings", "seed"])["core_minutes"]
    flat, deep = "0 subgoal layers", "2 subgoal layers"
    assert last[flat].tolist() == pytest.approx([12.5 / 60 / 2] * 2)
    assert last[deep].tolist() == pytest.approx([12.5 / 60, 50 / 60])
    assert set(curves["agent"]) == {OURS}


@pytest.fixture
def data(make_run):
    """Our published results: pick-and-place only."""
    return make_run({1: [[0.0, 0.5, 0.9], [0.0, 0.7, 1.0]]}, task="pick_place").parent


def test_the_command_prints_all_tables_and_draws(data, tmp_path, capsys):
    folder = tmp_path / "peers"
    folder.mkdir()
    for seed in (100, 101):
        curve = _curve(seed, (0, 0, 0.0), (20_000, 1, 0.5), (400_000, 12, 0.5))
        curve.to_csv(folder / f"{seed}.csv", index=False)
    assert peers.main(["", f"--peers={folder}", f"--data={data}"]) == 0
    printed = capsys.readouterr().out.splitlines()
    strangers = [line for line in printed if line.startswith("| pick_place | sac | zoo | 2 |")]
    assert strangers == [
        "| pick_place | sac | zoo | 2 | ~25% [25, 25] | 50% [50, 50] | 50% [50, 50] | 50% [50, 50] "
        "| - | 50% [50, 50] after 400,000 |",
        "| pick_place | sac | zoo | 2 | ~25% [25, 25] | 50% [50, 50] | 50% [50, 50] | 50% [50, 50] "
        "| 50% [50, 50] | 50% [50, 50] after 12.0 |",
        "| pick_place | sac | zoo | 2 | 0 | - | - |",
    ]
    ours = [line for line in printed if "| hac | 1 subgoal layer | 2 |" in line]
    assert len(ours) == 3 and " after 60,000 |" in ours[0] and " after 0.2 |" in ours[1]
    assert ours[2].endswith("| 2 | 2 | 0.2 | 1.0 |")
    assert printed.index(ours[0]) < printed.index(strangers[0])
    assert printed[-1] == str(folder / "peers.png")
    assert (folder / "peers.png").stat().st_size > 30_000


def test_agents_of_ours_that_were_trained_otherwise_are_beside_the_grid(
    make_results, tmp_path, capsys
):
    for folder, task, successes in (
        ("grid", "pick_place", {0: [[0.1, 0.9]]}),
        ("grid_40_updates", "pick_place", {0: [[0.2, 1.0]], 1: [[0.3, 0.9]]}),
        ("grid_td3", "ur5_reacher", {0: [[0.2, 1.0]]}),  # no peer is trained on it
    ):
        (tmp_path / folder / task).mkdir(parents=True)
        results = make_results(successes, task)
        results.to_csv(tmp_path / folder / task / "results.csv", index=False)
    curves = tmp_path / "peers"
    curves.mkdir()
    _curve(100, (0, 0, 0.0), (20_000, 1, 0.5)).to_csv(curves / "100.csv", index=False)
    assert peers.main(["", f"--peers={curves}", f"--data={tmp_path / 'grid'}"]) == 0
    printed = capsys.readouterr().out
    assert "ur5_reacher" not in printed
    for agent in (
        "0 subgoal layers",
        "0 subgoal layers, 40 updates",
        "1 subgoal layer, 40 updates",
    ):
        assert printed.count(f"| pick_place | hac | {agent} | 1 |") == 3


@pytest.mark.slow
def test_real_curves_of_tasks_of_which_we_have_no_results(data, tmp_path, capsys):
    assert peers.main(["", f"--peers={REAL}", f"--data={data}", f"--output={tmp_path}"]) == 0
    printed = capsys.readouterr().out
    assert "| pendulum_climb | td3 | ours20 | 2 |" in printed and "after 36,000 |" in printed
    assert "| ur5_reacher | td3 | ours20 | 1 |" in printed and "| 48% after 88,106 |" in printed
    for task in ("pendulum_climb", "ur5_reacher"):
        assert f"{data}: holds none of our results on {task}" in printed
    figure = peers.draw(load_strangers(REAL))
    above, _, climb, reacher = figure.axes
    assert (above.get_xlabel(), climb.get_xlabel()) == ("steps", "core-minutes")
    labels = [[text.get_text() for text in ax.get_legend().get_texts()] for ax in (climb, reacher)]
    assert labels == [["sac ours20, n=2", "td3 ours20, n=2"], ["td3 ours20, n=1"]]


def test_without_curves_the_command_says_what_makes_some(data, tmp_path, capsys):
    assert peers.main(["", f"--peers={tmp_path / 'none'}", f"--data={data}"]) == 2
    assert "train some with `python -m tests.bench.peers`" in capsys.readouterr().err


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: "",
        lambda text: text.replace("core_minutes", "minutes"),
        lambda text: text.splitlines()[0] + "\n",
        lambda text: text.replace(",36000,", ",,"),
        lambda text: text.replace(",36000,", ",many,"),
        lambda text: text + text.splitlines()[1].replace(",100,", ",107,") + "\n",
    ],
)
def test_a_damaged_curve_is_named(tmp_path, damage):
    path = tmp_path / "pendulum_climb-td3-ours20-100.csv"
    shutil.copy(REAL / path.name, path)
    assert len(load_curve(path)) == 5
    path.write_text(damage(path.read_text()))
    with pytest.raises(ValueError, match=r"not a peer's curve.*tests\.bench\.peers"):
        load_strangers(tmp_path)
