"""The depth study: gains by hand, its verdicts, what is refused, and the commands it prints."""

import json
import shlex

import numpy as np
import pandas as pd
import pytest

import hac_suite
import tasks
from analysis import depth
from analysis.reading.depth import place
from analysis.statistics.areas import areas
from analysis.verdicts.depth import compare
from launch.asking import request

_SEEDS = 10


@pytest.fixture
def put(tmp_path, make_results):
    """Writes a run folder of the study: `{subgoal_layers: last success}`, ten seeds each.

    Curves are 0, then that success twice: the area until episode 600 is 3/4 of it.
    """

    def write(task, last, config=None, curves=None):
        curves = curves or {layers: [[0, rate, rate]] * _SEEDS for layers, rate in last.items()}
        folder = tmp_path / task
        folder.mkdir()
        make_results(curves, task).to_csv(folder / "results.csv", index=False)
        if config is not None:
            (folder / "manifest.json").write_text(json.dumps({"config": config}))
        return tmp_path

    return write


def _said(folder, **how):
    return depth.write(folder, folder, **how)


def test_gains_and_verdicts_by_hand(put):
    put("depth-ur5_reacher_200", {0: 0.4, 1: 0.8, 2: 0.6})
    put("depth-ur5_reacher_400", {0: 0.4, 1: 0.4, 2: 0.48})
    folder = put("depth-ur5_reacher_800", {0: 0.8, 1: 0.4, 2: 0.8})
    said = _said(folder)
    table = pd.read_csv(folder / "depth.csv")
    assert table[["decisions", "agents"]].to_numpy().tolist() == [
        [decisions, agents] for decisions in (200, 400, 800) for agents in ("1 over 0", "2 over 1")
    ]
    gains = 0.75 * np.array([0.4, -0.2, 0.0, 0.08, -0.4, 0.4])
    np.testing.assert_allclose(table["gain"], gains, atol=1e-12)
    np.testing.assert_allclose(table["low"], gains, atol=1e-12)  # all pairs of seeds agree
    assert (table["pairs"] == 10).all() and (table["episodes"] == 600).all()
    # All ten signs alike: 2 of 1024 flips are as far out; no gain at all: p is 1.
    one_way = 2 / 1024
    np.testing.assert_allclose(table["p"], [one_way] * 2 + [1] + [one_way] * 3)
    np.testing.assert_allclose(table["p_holm"], [6 * one_way] * 2 + [1] + [6 * one_way] * 3)
    pays, costs, little = "it pays", "it costs", "a gain of 5 points or more is excluded"
    assert table["verdict"].tolist() == [pays, costs, little, pays, costs, pays]
    assert said[1] == (
        "ur5_reacher in 200 decisions: a second layer over one, a loss: -15.0 [-15.0, -15.0] "
        "points of area over 600 episodes (10 pairs of seeds, p = 0.012 after Holm): it costs."
    )
    assert said[6] == "ur5_reacher: a second layer pays from 400 decisions on, of those measured."
    assert said[7].startswith(
        "ur5_reacher: from 200 to 800 decisions, a second layer's gain changes by "
        "+45.0 [+45.0, +45.0] points"
    )
    assert (folder / "depth.md").read_text().count("\n") == 8
    assert (folder / "depth.png").stat().st_size > 10_000


def test_it_pays_from_where_on_it_always_does(put):
    put("depth-pick_place_300", {1: 0.2, 2: 0.8})
    folder = put("depth-pick_place_600", {1: 0.5, 2: 0.5})
    assert _said(folder)[2] == (
        "pick_place: a second layer is not shown to pay in 600 decisions. Not measured: 1200."
    )


def test_seeds_are_compared_with_themselves(make_results):
    """Seeds differ by far more than layers do: only pairs show that every seed gains 3 points."""
    rates = np.linspace(0.1, 0.9, _SEEDS + 2)
    curves = {1: [[r, r] for r in rates], 2: [[r + 0.03, r + 0.03] for r in rates]}
    results = make_results(curves, "depth-ur5_reacher_400")
    # The first seed of one agent and the last of the other are missing.
    lacking = {1: 0, 2: _SEEDS + 1}
    results = results[results["seed"] != results["subgoal_layers"].map(lacking)]
    results = results.assign(motion="ur5_reacher", decisions=400)
    (gain,) = compare(results, {"ur5_reacher": 300})
    assert gain.agents == "2 over 1" and gain.p == pytest.approx(2 / 1024)
    assert (gain.value, gain.low, gain.high) == pytest.approx((0.03, 0.03, 0.03))


def test_the_area_is_under_the_curve_until_the_budget(make_results):
    curves = {1: [[0.2, 0.4, 1.0], [0, 0.5]]}
    results = make_results(curves, "depth-ur5_reacher_400")
    assert areas(results, 300).to_dict() == pytest.approx({0: 0.3, 1: 0.25})
    assert areas(results, 600).to_dict() == pytest.approx({0: 0.5})  # the other is not done
    assert areas(results, 0).empty


@pytest.mark.slow
def test_seeds_that_are_not_done_wait_and_episodes_says_until_when_all_are(put, capsys):
    whole, begun = [0, 0.5, 0.5], [0, 0.5]
    curves = {1: [whole] * 3 + [begun] * 2, 2: [whole] * 2 + [begun] * 3}
    folder = put("depth-ur5_reacher_400", None, curves=curves)
    assert "(2 pairs of seeds" in _said(folder)[0]
    said = _said(folder, episodes=300)[0]
    assert "(5 pairs of seeds" in said and "over 300 episodes" in said
    assert depth.main(["", f"--data={folder}", "--episodes=450"]) == 2
    assert "but after 300, 600" in capsys.readouterr().err


@pytest.mark.slow
def test_three_pairs_decide_nothing(put):
    curves = {1: [[0, 0.1]] * 3, 2: [[0, 0.9]] * 3}
    folder = put("depth-ur5_reacher_400", None, curves=curves)
    assert _said(folder)[0].endswith(": undecided.")


def test_other_runs_beside_them_are_left_alone(put):
    put("pick_place", {1: 0.9, 2: 0.1})
    put("depth-ur5_reacher_250", {1: 0.9, 2: 0.1})
    folder = put("depth-pick_place_600", {1: 0.5, 2: 0.9})
    _said(folder)
    assert pd.read_csv(folder / "depth_curves.csv")["task"].unique().tolist() == [
        "depth-pick_place_600"
    ]


def test_the_suites_own_results_are_those_of_the_fewest_decisions(put, make_results, tmp_path):
    suite = tmp_path / "suite"
    for task, last in (("pick_place", 0.6), ("ur5_reacher", 0.9)):
        (suite / task).mkdir(parents=True)
        curves = {layers: [[0, last, last, last]] * _SEEDS for layers in (0, 1)}
        make_results(curves, task).to_csv(suite / task / "results.csv", index=False)
    folder = put("depth-pick_place_600", {0: 0.4, 1: 0.8})
    _said(folder, suite=suite)
    table = pd.read_csv(folder / "depth.csv")
    assert table[["decisions", "episodes"]].to_numpy().tolist() == [[300, 600], [600, 600]]
    np.testing.assert_allclose(table["gain"], [0, 0.3], atol=1e-12)
    _said(folder)
    assert pd.read_csv(folder / "depth.csv")["decisions"].tolist() == [600]


def test_runs_of_two_configurations_are_refused(put, capsys):
    put("depth-pick_place_300", {1: 0.5, 2: 0.9}, {"discount": 0.98, "batch_size": 256})
    folder = put("depth-pick_place_600", {1: 0.5, 2: 0.9}, {"discount": 0.99, "batch_size": 256})
    assert depth.main(["", f"--data={folder}"]) == 2
    assert "(discount)" in capsys.readouterr().err
    assert not (folder / "depth.png").exists()


def test_without_runs_it_says_what_makes_them(tmp_path, put, capsys):
    assert depth.main(["", f"--data={tmp_path}"]) == 2
    assert "analysis.depth --commands" in capsys.readouterr().err
    put("depth-pick_place_600", {1: 0.5})
    assert depth.main(["", f"--data={tmp_path}", "--suite="]) == 2
    assert "no two agents have a seed" in capsys.readouterr().err


def test_the_commands_train_every_task_of_the_study(capsys, monkeypatch):
    monkeypatch.chdir(depth.FOLDER.parents[2])  # where they are typed
    assert depth.main(["", "--commands"]) == 0
    *trainings, comparison = capsys.readouterr().out.splitlines()
    assert comparison.startswith("python -m analysis.depth --data=runs/depth")
    found = []
    for line in trainings:
        words = shlex.split(line)[1:]
        (task,) = [word.removeprefix("--task=") for word in words if word.startswith("--task=")]
        entry = tasks.find(task)
        assert place(entry.name) == (
            entry.word.rpartition(":")[2].rpartition("_")[0],
            entry.spec.max_steps,
        )
        found.append(entry.spec.max_steps)
        asked = request.parse(words)
        assert asked.tasks == (entry.name,)
        # Those of the suite's own results, which need no training.
        assert asked.seeds == tuple(range(10)) and asked.subgoal_layers == (0, 1, 2)
        assert not asked.video and str(asked.out) == "runs/depth"
    assert found == [400, 800, 600, 1200]
    assert asked.config == hac_suite.PRESETS["suite"]
