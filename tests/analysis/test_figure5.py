"""Figure 5 from a grid of results: all panels, whatever is missing, with n stated."""

import matplotlib.image
import numpy as np
import pandas as pd
import pytest

from analysis.figure5 import COLUMNS, NOTHING_YET, draw_figure5, main, summarise
from analysis.reading import grid, paper, schema
from analysis.reading.results import load
from analysis.statistics.seeds import success_per_period

FILES = ["figure5.png", "figure5_steps.png", "figure5_minutes.png", "figure5.pdf", "figure5.csv"]
CURVES = {
    0: [[0.0, 0.1, 0.2], [0.0, 0.0, 0.3]],
    1: [[0.0, 0.8, 0.9], [0.0, 0.6, 1.0], [0.1, 0.7, 1.0]],
    2: [[0.0, 0.5, 1.0], [0.0, 0.3, None]],
}


def _panels(folder):
    return draw_figure5(summarise(grid.load_grid(folder), grid.load_flats(folder))).axes


def test_panels_come_in_the_papers_order_with_its_titles(make_run):
    for task in reversed(paper.TITLES):
        folder = make_run(CURVES, task=task).parent
    *panels, legend = _panels(folder)
    assert [ax.get_title() for ax in panels] == list(paper.TITLES.values())
    assert all(len(ax.lines) == 3 and ax.get_legend() is None for ax in panels)
    names = [text.get_text() for text in legend.get_legend().get_texts()]
    assert names == ["0 subgoal layers (DDPG+HER)", "1 subgoal layer", "2 subgoal layers"]


def test_a_panel_shows_its_own_tasks_means_and_n(make_run):
    make_run({1: [[0.0, 1.0]]}, task="pendulum_climb")
    folder = make_run(CURVES, task="pick_place")
    climb, *_, pick, _ = _panels(folder.parent)
    assert [text.get_text() for text in climb.texts] == ["n = - / 1 / -"]
    assert [text.get_text() for text in pick.texts] == ["n = 2 / 3 / 1-2"]
    means = success_per_period(load(folder)).query("subgoal_layers == 1")["mean"]
    np.testing.assert_array_equal(pick.lines[1].get_ydata(), means)
    np.testing.assert_array_equal(climb.lines[0].get_ydata(), [0.0, 1.0])


@pytest.mark.slow
def test_tasks_without_runs_say_so_and_the_console_names_them(make_run, capsys):
    folder = make_run(CURVES, task="ur5_reacher").parent
    header_only = folder / "pick_place"
    header_only.mkdir()
    (header_only / "results.csv").write_text(",".join(schema.RESULTS_COLUMNS) + "\n")
    assert main(["", "--data", str(folder)]) == 0
    printed = capsys.readouterr().out.splitlines()
    without = [task for task in paper.TITLES if task != "ur5_reacher"]
    assert printed[:4] == [f"{task}: {NOTHING_YET} in {folder}" for task in without]
    assert printed[4:] == [str(folder / name) for name in FILES]
    empty = [ax for ax in _panels(folder)[:5] if not ax.lines]
    assert [ax.texts[0].get_text() for ax in empty] == [NOTHING_YET] * 4


@pytest.mark.slow
def test_files_hold_what_was_plotted_and_repeat_byte_for_byte(make_run, tmp_path):
    folder = make_run(CURVES).parent
    outputs = [tmp_path / "new" / "a", tmp_path / "b"]
    for output in outputs:
        assert main(["", "--data", str(folder), f"--output={output}"]) == 0
    first, second = ({path.name: path.read_bytes() for path in o.iterdir()} for o in outputs)
    assert first == second and set(first) == set(FILES)
    assert first["figure5.pdf"].startswith(b"%PDF")
    assert matplotlib.image.imread(outputs[0] / "figure5.png").shape[1] > 1500
    written = pd.read_csv(outputs[0] / "figure5.csv", float_precision="round_trip")
    assert list(written.columns) == list(COLUMNS) and written["other"].isna().all()
    pd.testing.assert_frame_equal(
        written[list(schema.FIGURE_COLUMNS)],
        success_per_period(load(folder / "pick_place")),
        check_exact=True,
        check_dtype=False,
    )


def test_what_cannot_be_drawn_is_answered_in_one_line(make_run, tmp_path, capsys):
    folder = make_run({1: [[0.0]]}, task="ur5_reacher")
    assert main(["", "--data", str(tmp_path / "none")]) == 2
    assert "results of none of the paper's" in capsys.readouterr().err
    folder.rename(folder.with_name("pick_place"))
    assert main(["", "--data", str(folder.parent)]) == 2
    assert "holds results of ur5_reacher" in capsys.readouterr().err


def test_other_flat_agents_are_drawn_beside_the_grids(make_run, tmp_path):
    make_run(CURVES, task="ur5_reacher").parent.rename(tmp_path / "grid")
    make_run({0: [[0.0, 0.6, 0.7]], 1: CURVES[1]}, task="ur5_reacher").parent.rename(
        tmp_path / "grid_td3"
    )
    summary = summarise(grid.load_grid(tmp_path / "grid"), grid.load_flats(tmp_path / "grid"))
    td3 = summary[summary["other"] == "TD3+HER"]
    assert td3["mean"].tolist() == [0.0, 0.6, 0.7] and set(td3["subgoal_layers"]) == {0}
    reacher, legend = (draw_figure5(summary).axes[index] for index in (2, 5))
    assert [line.get_ydata()[-1] for line in reacher.lines[:4]] == [0.25, 29 / 30, 1.0, 0.7]
    assert reacher.texts[0].get_text() == "n = 2 / 3 / 1-2"
    named = [text.get_text() for text in legend.get_legend().get_texts()]
    assert named[3:] == ["0, TD3+HER"]


def test_other_agents_with_two_layers_are_drawn_beside_the_grids(make_run, tmp_path):
    make_run(CURVES, task="ur5_reacher").parent.rename(tmp_path / "grid")
    make_run({2: [[0.0, 0.3, 0.4]]}, task="ur5_reacher").parent.rename(
        tmp_path / "grid_fewer_updates"
    )
    (name,) = grid.DEEPER
    summary = summarise(grid.load_grid(tmp_path / "grid"), grid.load_deeper(tmp_path / "grid"))
    reacher, legend = (draw_figure5(summary).axes[index] for index in (2, 5))
    assert 0.4 in [line.get_ydata()[-1] for line in reacher.lines]
    named = [text.get_text() for text in legend.get_legend().get_texts()]
    assert named[3:] == [f"2, {name}"]


def test_x_can_be_what_was_spent(make_run):
    folder = make_run(CURVES, task="pendulum_climb").parent
    summary = summarise(grid.load_grid(folder), {})
    steps = draw_figure5(summary, "train_steps").axes[0]
    np.testing.assert_array_equal(steps.lines[0].get_xdata(), [0, 30_000, 60_000])
    assert "steps" in steps.get_xlabel()
    minutes = draw_figure5(summary, "core_minutes").axes[0]
    # Two seeds share the 12.5 s that each period took.
    np.testing.assert_allclose(minutes.lines[0].get_xdata(), np.arange(3) * 12.5 / 2 / 60)
