"""The comparison of variants: what is computed, drawn, and said of those that are missing."""

import numpy as np
import pytest

from analysis import ablations


@pytest.fixture
def folder(tmp_path, make_results):
    """The paper's variant on two tasks, another on one of them only."""

    def put(variant, task, curves):
        run = tmp_path / variant / task
        run.mkdir(parents=True)
        make_results({1: curves}, task).to_csv(run / "results.csv", index=False)

    put("paper", "pick_place", [[0, 0.5, 0.9], [0, 0.7, 0.7], [0, 0.6, 1.0]])
    put("paper", "pendulum_climb", [[0, 1, 1], [0, 1, 1]])
    put("no_hindsight_goals", "pick_place", [[0, 0, 0.1], [0, 0, 0], [0, 0.2, 0]])
    return tmp_path


def test_variants_are_compared_with_the_paper_s(folder):
    table = ablations.compare(ablations.load_variants(folder))
    keys = ["task", "variant"]
    assert table[keys].to_numpy().tolist() == [
        ["pendulum_climb", "paper"],
        ["pick_place", "paper"],
        ["pick_place", "no_hindsight_goals"],
    ]
    climb, paper, without = table.itertuples()
    assert (climb.n, climb.area, climb.area_low, climb.final) == (2, 1, 1, 1)
    assert paper.area == pytest.approx(np.mean([0.7, 0.7, 0.8])) and np.isnan(paper.difference)
    assert paper.final == pytest.approx(2.6 / 3) and paper.episodes_to_80 == 600
    assert without.difference == pytest.approx(without.area - paper.area)
    assert without.difference_low <= without.difference <= without.difference_high < 0
    assert np.isnan(without.episodes_to_80)


def test_the_command_writes_figure_and_numbers_and_prints_the_table(folder, tmp_path, capsys):
    assert ablations.main(["", f"--data={folder}", f"--output={tmp_path / 'out'}"]) == 0
    printed = capsys.readouterr().out
    assert "| pick_place | 1 | no hindsight goals | 3 | 3% [0, " in printed
    assert (tmp_path / "out" / "ablations.png").stat().st_size > 10_000
    assert (tmp_path / "out" / "ablations.csv").read_text().count("\n") == 4


def test_a_variant_that_was_not_run_is_said_to_be_missing(folder):
    figure = ablations.draw(ablations.compare(ablations.load_variants(folder)))
    climb, pick = figure.axes
    assert [text.get_text() for text in climb.texts] == ["not run"] and not pick.texts
    assert pick.get_title().endswith("1 subgoal layer, n=3")


def test_an_empty_folder_is_refused(tmp_path, capsys):
    assert ablations.main(["", f"--data={tmp_path}"]) == 2
    assert "launch/ablate.py" in capsys.readouterr().err


def test_a_variant_that_stopped_early_is_compared_until_there(folder, make_results):
    run = folder / "no_subgoal_tests" / "pick_place"
    run.mkdir(parents=True)
    make_results({1: [[0, 0.5], [0, 0.7], [0, 0.6]]}, "pick_place").to_csv(
        run / "results.csv", index=False
    )
    table = ablations.compare(ablations.load_variants(folder))
    picked = table[table["task"] == "pick_place"].set_index("variant")
    assert picked.loc["no_subgoal_tests", "difference"] == pytest.approx(0)
    assert picked.loc["paper", "area"] == picked.loc["paper", "final"] == pytest.approx(0.6)
