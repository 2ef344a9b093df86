"""Draws the depth study: curves for each number of decisions, and gains against it."""

from collections.abc import Sequence

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.figures.success import label_periods, look, plot_success
from analysis.reading import paper
from analysis.reading.depth import GAINS, STUDY


def draw(curves: pd.DataFrame, gains: pd.DataFrame) -> Figure:
    """A row for each motion: its curves at each number of decisions, then the gains.

    Args:
      curves: `schema.FIGURE_COLUMNS` with `motion` and `decisions`.
      gains: as `as_table` makes it.
    """
    motions = [motion for motion in STUDY if motion in set(curves["motion"])]
    columns = max(len(STUDY[motion]) for motion in motions) + 1
    figure = Figure(figsize=(4.1 * columns, 3.9 * len(motions)))
    figure.set_layout_engine("constrained", w_pad=0.08, h_pad=0.08)
    grid = figure.subplots(len(motions), columns, squeeze=False)
    for motion, row in zip(motions, grid, strict=True):
        own = curves[curves["motion"] == motion]
        for ax, decisions in zip(row, STUDY[motion], strict=False):
            _plot_curves(ax, own[own["decisions"] == decisions])
            ax.set_title(f"{paper.title(motion)}, {decisions} decisions", size="medium")
        _plot_gains(row[-1], gains[gains["motion"] == motion], STUDY[motion])
        row[-1].set_title("gain in area, 95% interval over pairs of seeds", size="medium")
    return figure


def _plot_curves(ax: Axes, own: pd.DataFrame) -> None:
    if len(own):
        plot_success(ax, own, legend=False)
        label_periods(ax, own, most_ticks=6)
        ax.legend(framealpha=0.85, fontsize="small", handlelength=3.2)
    else:
        ax.text(0.5, 0.5, "no runs yet", transform=ax.transAxes, ha="center", color="#777777")
        ax.set_axis_off()


def _plot_gains(ax: Axes, gains: pd.DataFrame, steps: Sequence[int]) -> None:
    ax.axhline(0, color="#777777", linewidth=0.8)
    for shift, (new, old) in zip((-0.06, 0.06), GAINS, strict=True):
        own = gains[gains["agents"] == f"{new} over {old}"]
        x = [steps.index(decisions) + shift for decisions in own["decisions"]]
        style, points = look(new), 100 * own[["gain", "low", "high"]].to_numpy(dtype=float).T
        ax.vlines(x, points[1], points[2], color=style.colour, linewidth=2)
        ax.plot(
            x, points[0],
            color=style.colour, marker=style.marker, linestyle=style.line,
            label=f"{new} over {old} subgoal layer{'' if old == 1 else 's'}",
        )  # fmt: skip
    ax.set_xticks(range(len(steps)), [str(decisions) for decisions in steps])
    ax.set_xlim(-0.4, len(steps) - 0.6)
    ax.set_xlabel("decisions for the same motion")
    ax.set_ylabel("points of area under the success curve")
    ax.grid(axis="y", alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.25 * (high - low))  # room for the legend above the intervals
    ax.legend(loc="upper left", framealpha=0.85, fontsize="small")
