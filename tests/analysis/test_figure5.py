"""Figure 5 from a grid of results: all panels, whatever is missing, with n stated."""

import matplotlib.image
import numpy as np
import pandas as pd

from analysis.figure5 import NOTHING_YET, draw_figure5, main, summarise
from analysis.reading import grid, paper, schema
from analysis.reading.results import load
from analysis.statistics.seeds import success_per_period

CURVES = {
    0: [[0.0, 0.1, 0.2], [0.0, 0.0, 0.3]],
    1: [[0.0, 0.8, 0.9], [0.0, 0.6, 1.0], [0.1, 0.7, 1.0]],
    2: [[0.0, 0.5, 1.0], [0.0, 0.3, None]],
}


def _panels(folder):
    return draw_figure5(summarise(grid.load_grid(folder))).axes


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


def test_tasks_without_runs_say_so_and_the_console_names_them(make_run, capsys):
    folder = make_run(CURVES, task="ur5_reacher").parent
    header_only = folder / "pick_place"
    header_only.mkdir()
    (header_only / "results.csv").write_text(",".join(schema.RESULTS_COLUMNS) + "\n")
    assert main(["", "--data", str(folder)]) == 0
    printed = capsys.readouterr().out.splitlines()
    without = [task for task in paper.TITLES if task != "ur5_reacher"]
    assert printed[:4] == [f"{task}: {NOTHING_YET} in {folder}" for task in without]
    assert printed[4:] == [str(folder / f"figure5{suffix}") for suffix in (".png", ".pdf", ".csv")]
    empty = [ax for ax in _panels(folder)[:5] if not ax.lines]
    assert [ax.texts[0].get_text() for ax in empty] == [NOTHING_YET] * 4


def test_files_hold_what_was_plotted_and_repeat_byte_for_byte(make_run, tmp_path):
    folder = make_run(CURVES).parent
    outputs = [tmp_path / "new" / "a", tmp_path / "b"]
    for output in outputs:
        assert main(["", "--data", str(folder), f"--output={output}"]) == 0
    first, second = ({path.name: path.read_bytes() for path in o.iterdir()} for o in outputs)
    assert first == second and set(first) == {"figure5.png", "figure5.pdf", "figure5.csv"}
    assert first["figure5.pdf"].startswith(b"%PDF")
    assert matplotlib.image.imread(outputs[0] / "figure5.png").shape[1] > 1500
    written = pd.read_csv(outputs[0] / "figure5.csv", float_precision="round_trip")
    pd.testing.assert_frame_equal(
        written,
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
