"""What is read from journals of trials, computed, drawn and said."""

import math

import numpy as np
import optuna
import pandas as pd
import pytest

from analysis import tuning
from analysis.figures.tuning import draw
from analysis.statistics.tuning import SHUFFLES, importlib, read

SPACE = {
    "learning_rate": optuna.distributions.FloatDistribution(1e-4, 1e-2, log=True),
    "noise": optuna.distributions.FloatDistribution(0.0, 1.0),
    "draw": optuna.distributions.CategoricalDistribution(["top", "each_level"]),
}
ASKED = {"tasks": ["pick_place"], "subgoal_layers": 2, "seeds": [100, 101], "periods": 2}


def journal(folder, name="pick_place_2layers", asked=ASKED):
    storage = optuna.storages.journal.JournalStorage(
        optuna.storages.journal.JournalFileBackend(str(folder / f"{name}.journal"))
    )
    study = optuna.create_study(study_name=name, storage=storage, direction="maximize")
    study.set_user_attr("asked", asked)
    study.set_user_attr("hours", 0.5)
    return study


def add(study, seeds, *, learning_rate=1e-3, noise=0.5, draw="top", hours=0.1, **attrs):
    """A complete trial in which the seeds' objectives are these."""
    success = [[0.0] * len(seeds), list(seeds)]
    curves = {"pick_place": {"success": success, "minutes": [0, 3.0]}}
    study.add_trial(
        optuna.create_trial(
            params={"learning_rate": learning_rate, "noise": noise, "draw": draw},
            distributions=SPACE,
            value=float(np.mean(seeds)),
            user_attrs={
                "cpu_seconds": 3600 * hours,
                "curves": curves,
                "objectives": {str(100 + index): value for index, value in enumerate(seeds)},
                **attrs,
            },
        )
    )


def add_pruned(study, period, success, **params):
    values = {"learning_rate": 1e-3, "noise": 0.5, "draw": "top", **params}
    study.add_trial(
        optuna.create_trial(
            state=optuna.trial.TrialState.PRUNED, params=values, distributions=SPACE,
            intermediate_values={1: 0.0, period: success}, user_attrs={"cpu_seconds": 360.0},
        )
    )  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A study of which nothing but the learning rate decides; and one that has just begun."""
    made = tmp_path_factory.mktemp("studies")
    study = journal(made)
    add(study, [0.4, 0.6], label="default", learning_rate=3e-4)
    add(study, [0.5, 0.7], label="candidate", draw="each_level")
    random = np.random.default_rng(1)
    for _ in range(30):
        rate, noise = 10 ** random.uniform(-4, -2), random.uniform()
        quality = 0.9 - 0.4 * abs(math.log10(rate / 1e-3))
        draw = str(random.choice(["top", "each_level"]))
        if quality > 0.7:
            add(study, [quality, quality], learning_rate=rate, noise=noise, draw=draw, hours=0.01)
        else:
            add_pruned(study, 2, quality, learning_rate=rate, noise=noise, draw=draw)
    study.enqueue_trial({"noise": 0.1})
    journal(made, "pick_place_0layers", {**ASKED, "subgoal_layers": 0, "learner": "td3"})
    return made


@pytest.fixture(scope="module")
def studies(folder):
    return read(folder)


@pytest.mark.slow
def test_a_study_is_what_its_journal_says(studies):
    flat, two = studies
    assert flat.title == "1-Object Pick-and-Place, 0 subgoal layers, td3" and not flat.trials
    assert flat.best is None and flat.importance == {}
    assert [trial.label for trial in two.started_with()] == ["default", "candidate"]
    default = two.trials[0]
    assert default.final == (0.4, 0.6) and default.minutes == 3.0
    assert default.spent == pytest.approx(0.1) and two.trials[1].spent == pytest.approx(0.2)
    assert two.best.value == max(trial.value for trial in two.complete) > 0.8
    assert two.trials[-1].state == "waiting" and math.isnan(two.trials[-1].value)


@pytest.mark.slow
def test_importance_is_of_what_matters_and_is_set_beside_chance(studies):
    importance = studies[1].importance
    assert next(iter(importance)) == "learning_rate"
    assert sum(one.share for one in importance.values()) == pytest.approx(1)
    decides, rest = importance["learning_rate"], [importance["noise"], importance["draw"]]
    assert decides.share > decides.noise and 1 / (1 + SHUFFLES) <= decides.p < 0.05
    assert all(one.share < one.noise and one.p > 0.05 for one in rest)


@pytest.mark.slow
def test_what_was_pruned_counts_for_importance(tmp_path):
    """All complete trials have one learning rate, which is why they are complete."""
    study = journal(tmp_path)
    random = np.random.default_rng(2)
    for number in range(24):
        noise, good = random.uniform(), number % 3 == 0
        if good:
            add(study, [0.9 + noise / 100] * 2, learning_rate=1e-3, noise=noise)
        else:
            add_pruned(study, 1 + number % 2, 0.1, learning_rate=5e-3, noise=noise)
    assert next(iter(read(tmp_path)[0].importance)) == "learning_rate"


def test_too_few_trials_have_no_importance(tmp_path):
    study = journal(tmp_path)
    for value in np.linspace(0, 1, 7):
        add(study, [value, value])
    assert read(tmp_path)[0].importance == {}
    assert "Importances need 8 trials" in tuning.as_text(read(tmp_path)[0])


def test_the_best_is_set_beside_the_first_seed_by_seed(tmp_path):
    study = journal(tmp_path)
    add(study, [0.4, 0.6], label="default", learning_rate=3e-4)
    add(study, [0.5, 0.9])
    text = tuning.as_text(read(tmp_path)[0])
    # Gains of 0.1 and 0.3: a mean of 0.2, a standard error of 0.1.
    assert "| 0 (default) | 0.500 ± 0.100 | 0.200 ± 0.100 | 50 ± 10 | 3.00 |" in text
    assert "| 1, the best | 0.700 ± 0.200 | - | 70 ± 20 | 3.00 |" in text
    assert "| learning_rate | 0.0003 | 0.001 | - | - | - |" in text
    assert "2 trials (2 complete); 0.20 of 0.5 core-hours; seeds 100, 101; 2 periods" in text
    assert "The best of 2 trials owes some of its lead to having been chosen" in text


def test_one_seed_has_no_spread(tmp_path):
    add(journal(tmp_path), [0.4], label="default")
    assert "| 0 (default), the best | 0.400 | - | 40 | 3.00 |" in tuning.as_text(read(tmp_path)[0])


@pytest.mark.slow
def test_the_command_writes_figure_and_numbers_and_prints_the_tables(folder, tmp_path, capsys):
    before = {path: path.read_bytes() for path in folder.glob("*.journal")}
    out = tmp_path / "out"
    assert tuning.main(["", f"--data={folder}", f"--output={out}"]) == 0
    printed = capsys.readouterr().out
    assert "no trial is complete" in printed and "| trial | objective |" in printed
    assert printed.rstrip().endswith(f"{out / 'tuning.png'}\n{out / 'tuning.csv'}")
    assert (out / "tuning.png").stat().st_size > 20_000
    table = pd.read_csv(out / "tuning.csv")
    assert len(table) == 32 and set(table["state"]) == {"complete", "pruned"}
    first = table.iloc[0]
    assert (first["label"], first["objective"], first["learning_rate"]) == ("default", 0.5, 3e-4)
    assert first["objective_error"] == pytest.approx(0.1)
    assert before == {path: path.read_bytes() for path in folder.glob("*.journal")}


def test_a_figure_has_the_trials_the_first_ones_and_what_chance_gives(studies):
    figure = draw(studies)
    empty, no_importance, trials, importance = figure.axes
    labels = trials.get_legend_handles_labels()[1]
    assert {"complete", "default", "candidate", "best so far"} <= set(labels)
    points = next(line for line in trials.lines if line.get_label() == "complete")
    assert len(points.get_xdata()) == len(studies[1].complete) - 2
    best = next(line for line in trials.lines if line.get_label() == "best so far")
    assert (np.diff(best.get_ydata()) >= 0).all()
    assert len(importance.patches) == 3 and not no_importance.patches
    assert empty.get_title().startswith("1-Object Pick-and-Place, 0 subgoal layers")


def test_a_folder_without_journals_is_refused(tmp_path, capsys):
    assert tuning.main(["", f"--data={tmp_path}"]) == 2
    assert "launch/tune.py" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["no journal\nat all\n", '{"op_code"\n', ""])
def test_a_file_that_is_no_journal_is_named(tmp_path, capsys, text):
    (tmp_path / "wrong.journal").write_text(text)
    assert tuning.main(["", f"--data={tmp_path}"]) == 2
    assert "wrong.journal is not a journal" in capsys.readouterr().err


def test_without_optuna_the_extra_is_named(folder, capsys, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert tuning.main(["", f"--data={folder}"]) == 2
    assert "'.[tune]'" in capsys.readouterr().err
