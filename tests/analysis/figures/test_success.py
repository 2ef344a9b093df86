"""The figure shows what the results say, in the colours of Figure 5, with n stated."""

from pathlib import Path

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb

from analysis.figure import main
from analysis.figures.success import LOOKS, draw_success, write_figure
from analysis.reading import schema
from analysis.reading.results import load
from analysis.statistics.seeds import success_per_period

CURVES = {
    0: [[0.0, 0.1, 0.2], [0.0, 0.0, 0.3], [0.0, 0.2, 0.1]],
    1: [[0.0, 0.8, 0.9], [0.0, 0.6, 1.0], [0.1, 0.7, 1.0]],
    2: [[0.0, 0.5, 1.0], [0.0, 0.3, 1.0], [0.0, 0.6, 1.0]],
}


def _axes(run_folder: Path):
    return draw_success(success_per_period(load(run_folder))).axes[0]


def _legend(axes) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_csv_equals_the_summary(make_run):
    folder = make_run(CURVES)
    write_figure(folder)
    written = pd.read_csv(folder / "figure.csv", float_precision="round_trip")
    assert list(written.columns) == list(schema.FIGURE_COLUMNS)
    pd.testing.assert_frame_equal(
        written, success_per_period(load(folder)), check_exact=True, check_dtype=False
    )


def test_png_holds_the_three_colours_and_nothing_else_is_left(make_run):
    folder = make_run(CURVES)
    write_figure(folder)
    assert {path.name for path in folder.iterdir()} == {"results.csv", "figure.png", "figure.csv"}
    pixels = matplotlib.image.imread(folder / "figure.png")[..., :3]
    assert min(pixels.shape[:2]) > 600
    for look in LOOKS[:3]:
        close = np.abs(pixels - to_rgb(look.colour)).max(axis=-1) < 0.02
        assert close.sum() > 500, look


def test_lines_are_the_means_in_blue_red_and_yellow(make_run):
    folder = make_run(CURVES)
    axes = _axes(folder)
    summary = success_per_period(load(folder))
    assert len(axes.lines) == len(axes.collections) == 3
    for layers, line in enumerate(axes.lines):
        curve = summary[summary["subgoal_layers"] == layers]
        np.testing.assert_array_equal(line.get_xdata(), [0, 1, 2])
        np.testing.assert_array_equal(line.get_ydata(), curve["mean"])
        band = axes.collections[layers].get_paths()[0].vertices
        assert band[:, 1].max() == curve["high"].max()
        assert axes.collections[layers].get_facecolor()[0, :3] == pytest.approx(
            to_rgb(line.get_color())
        )
    blue, red, yellow = (np.array(to_rgb(line.get_color())) for line in axes.lines)
    assert blue.argmax() == 2
    assert red.argmax() == 0 and red[1] < 0.2
    assert yellow[0] > 0.8 and yellow[1] > 0.55 and yellow[2] < 0.2


def test_agents_differ_without_colour_too(make_run):
    lines = _axes(make_run(CURVES)).lines
    assert len({line.get_marker() for line in lines}) == 3
    assert len({line.get_linestyle() for line in lines}) == 3


def test_title_axes_and_legend_say_what_is_drawn(make_run):
    axes = _axes(make_run(CURVES))
    assert axes.get_title() == "1-Object Pick-and-Place"
    assert [label.get_text() for label in axes.get_xticklabels()] == ["0\n0", "1\n300", "2\n600"]
    assert "test period" in axes.get_xlabel() and "training episodes" in axes.get_xlabel()
    assert axes.get_ylim()[0] < 0 and axes.get_ylim()[1] > 1
    assert _legend(axes) == [
        "0 subgoal layers (n=3)",
        "1 subgoal layer (n=3)",
        "2 subgoal layers (n=3)",
    ]
    said = axes.get_legend().get_title().get_text()
    assert said.startswith("mean and 95% interval over seeds\n(fewer than 5 seeds: ")


def test_the_interval_of_enough_seeds_is_only_an_interval(make_run):
    axes = _axes(make_run({0: [[0.0, 0.2 * seed] for seed in range(5)]}))
    assert axes.get_legend().get_title().get_text() == "mean and 95% interval over seeds"


def test_unequal_seeds_and_one_seed_are_labelled(make_run):
    axes = _axes(make_run({0: [[0.0, 0.5]], 1: [[0.0, 1.0], [0.0, None], [0.0, 0.5]]}))
    assert _legend(axes) == ["0 subgoal layers (n=1, no interval)", "1 subgoal layer (n=2-3)"]
    assert len(axes.lines) == 2
    assert len(axes.collections) == 1


def test_a_missing_period_is_a_gap(make_run):
    axes = _axes(make_run({2: [[0.0, None, None, 1.0], [0.0, None, None, 0.5]]}))
    assert np.isnan(axes.lines[0].get_ydata()).any()
    assert list(axes.lines[0].get_xdata()[[0, -1]]) == [0, 3]


def test_first_period_alone_is_drawn(make_run):
    folder = make_run({1: [[0.0], [0.0]]})
    write_figure(folder)
    assert (folder / "figure.png").stat().st_size > 5000


def test_deeper_agents_and_unknown_tasks_are_drawn(make_run):
    axes = _axes(make_run({0: [[0.0, 0.1]], 3: [[0.0, 0.4]]}, task="stack_blocks"))
    assert axes.get_title() == "Stack blocks"
    assert axes.lines[0].get_color() != axes.lines[1].get_color()


def test_refreshing_replaces_the_files(make_run, make_results):
    folder = make_run({1: [[0.0, None]]})
    write_figure(folder)
    before = (folder / "figure.png").read_bytes()
    make_results({1: [[0.0, 0.5]]}).to_csv(folder / "results.csv", index=False)
    write_figure(folder)
    assert (folder / "figure.png").read_bytes() != before
    assert len(pd.read_csv(folder / "figure.csv")) == 2


def test_a_failed_write_keeps_the_old_figure(make_run, monkeypatch):
    folder = make_run(CURVES)
    write_figure(folder)
    before = (folder / "figure.png").read_bytes()

    def full(figure, path):
        path.write_bytes(b"half")
        raise OSError("disk full")

    monkeypatch.setattr("analysis.figures.success.save_png", full)
    with pytest.raises(OSError, match="disk full"):
        write_figure(folder)
    assert (folder / "figure.png").read_bytes() == before
    assert not list(folder.glob("*.tmp")) + list(folder.glob(".*"))


def test_two_tasks_in_one_folder_are_refused(make_run):
    first, second = make_run(CURVES), make_run(CURVES, task="ur5_reacher")
    rows = (second / "results.csv").read_text().split("\n", 1)[1]
    with (first / "results.csv").open("a") as file:
        file.write(rows)
    with pytest.raises(ValueError, match=r"one task.*pick_place.*ur5_reacher"):
        write_figure(first)


def test_command_line(make_run, capsys, tmp_path):
    folder = make_run(CURVES)
    assert main(["", str(folder)]) == 0
    assert capsys.readouterr().out.strip() == str(folder / "figure.png")
    assert main(["", str(tmp_path / "nothing")]) == 2
    assert "no results.csv here" in capsys.readouterr().err
