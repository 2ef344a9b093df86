"""Success rate per test period as in the paper's Figure 5, drawn from a run folder."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from analysis.reading import names, paper
from analysis.reading.files import write_atomically
from analysis.reading.results import load
from analysis.statistics.seeds import FEW_SEEDS, n_label, success_per_period

DOTS_PER_INCH = 160


class Look(NamedTuple):
    """How an agent is drawn; marker and line tell agents apart where colours do not."""

    colour: str
    marker: str
    line: str | tuple
    above: int = 2  # what lies over what
    width: float = 1.0
    band: bool = True


LOOKS = (
    Look("#1558c0", "o", "-"),  # 0 subgoal layers: the paper's blue
    Look("#c81e1e", "s", "--"),  # 1: red
    Look("#e0a000", "^", "-."),  # 2: yellow, dark enough to be seen on white
    Look("#6b3fa0", "D", ":"),  # agents deeper than the paper's
    Look("#3a7d44", "v", (0, (5, 1, 1, 1, 1, 1))),
)
FLAT_LOOKS = (
    Look("#3f8fe0", "x", ":", width=0.8, band=False),
    Look("#00838f", "", (0, (4, 2)), width=0.7, band=False),
    Look("#7fa8dd", "", "-", width=0.6, band=False),
)
"""Other agents without subgoal layers, beside those: thin, and without a band."""
DEEPER_LOOKS = (Look("#8a6d00", "", (0, (1, 1)), width=0.8, band=False),)
"""Other agents with two subgoal layers."""


def look(subgoal_layers: int) -> Look:
    """The colour of Figure 5 for the agent, with a marker and a line style of its own."""
    return LOOKS[subgoal_layers % len(LOOKS)]._replace(above=3 + subgoal_layers)


def write_figure(run_dir: Path) -> None:
    """Writes figure.png and figure.csv into a run folder, from whatever its results.csv has.

    Both are replaced whole, so the figure can be refreshed while training goes on.

    Raises:
      FileNotFoundError, ValueError: as `load`; also when the folder mixes tasks.
    """
    run_dir = Path(run_dir)
    summary = success_per_period(load(run_dir))
    figure = draw_success(summary)
    write_atomically(run_dir / names.FIGURE_NUMBERS, lambda path: summary.to_csv(path, index=False))
    write_atomically(run_dir / names.FIGURE, lambda path: save_png(figure, path))


def draw_success(summary: pd.DataFrame) -> Figure:
    """A figure of one panel, outside pyplot: it needs no display and leaves no state behind."""
    figure = Figure(figsize=(6.8, 4.6))
    figure.set_layout_engine("constrained", w_pad=0.12, h_pad=0.08)
    plot_success(figure.add_subplot(), summary)
    return figure


def draw_seeds(results: pd.DataFrame) -> Figure:
    """A panel for each agent of one task: every seed as a thin line under the mean.

    Args:
      results: of one task, as `analysis.reading.results.load` gives them.
    """
    summary = success_per_period(results)
    agents = sorted(summary["subgoal_layers"].unique())
    figure = Figure(figsize=(3.4 * len(agents) + 0.6, 3.2))
    figure.set_layout_engine("constrained", w_pad=0.08, h_pad=0.08)
    axes = figure.subplots(1, len(agents), sharey=True, squeeze=False)[0]
    for ax, layers in zip(axes, agents, strict=True):
        style = look(int(layers))
        own = results[results["subgoal_layers"] == layers]
        for _, seed in own.groupby("seed"):
            ax.plot(
                seed["period"], seed["success_rate"], color=style.colour, alpha=0.45, linewidth=0.8
            )
        plot_success(ax, summary[summary["subgoal_layers"] == layers], legend=False)
        label_periods(ax, own, most_ticks=6)
        ax.set_title(_named(int(layers), summary[summary["subgoal_layers"] == layers]), size=10)
        ax.set_ylabel("")
    axes[0].set_ylabel("end goals achieved in tests")
    return figure


def save_png(figure: Figure, path: Path) -> None:
    """Writes a figure made by `draw_...`, whatever the file's suffix."""
    figure.savefig(path, format="png", dpi=DOTS_PER_INCH)


def plot_success(
    ax: Axes, summary: pd.DataFrame, *, legend: bool = True, against: str = "period"
) -> None:
    """Draws one panel of Figure 5 (section 4.2): mean success and 95% band over seeds per agent.

    Args:
      ax: axes to draw on; y is the success rate from 0 to 1, in percent.
      summary: of one task, as `analysis.statistics.seeds.success_per_period` gives it.
      legend: whether the panel explains its agents itself.
      against: the column that x is; the axis is labelled where that is the test period.

    Raises:
      ValueError: `summary` holds no task or more than one.
    """
    tasks = list(summary["task"].unique())
    if len(tasks) != 1:
        raise ValueError(f"a panel shows one task; these results hold {tasks}")
    for layers, curve in summary.groupby("subgoal_layers"):
        plot_curve(ax, curve, look(int(layers)), _named(int(layers), curve), against=against)
    if against == "period":
        label_periods(ax, summary)
    ax.set_title(paper.title(tasks[0]), fontweight="bold")
    ax.set_ylabel("end goals achieved in tests")
    ax.set_ylim(-0.03, 1.03)
    ax.yaxis.set_major_formatter(PercentFormatter(1.0))
    ax.grid(alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    if legend:
        ax.legend(title=_meaning(summary), framealpha=0.85, handlelength=3.2)


def _meaning(summary: pd.DataFrame) -> str:
    """What lines and bands are."""
    few = summary["n"].max() < FEW_SEEDS
    of_few = f"\n(fewer than {FEW_SEEDS} seeds: little more\nthan their range)" if few else ""
    return f"mean and 95% interval over seeds{of_few}"


def _named(layers: int, curve: pd.DataFrame) -> str:
    seeds = n_label(curve["n"]) + ("" if curve["n"].max() > 1 else ", no interval")
    return f"{paper.agent_name(layers)} ({seeds})"


def plot_curve(
    ax: Axes, curve: pd.DataFrame, style: Look, label: str, *, against: str = "period"
) -> None:
    """Draws one agent's mean success against a column of its curve, with the band where it has one.

    Args:
      curve: of one agent of one task, as `plot_success` takes it.
    """
    # A period that is missing in between becomes NaN: a gap, not a line drawn across it.
    curve = curve.set_index("period")
    after_gap = np.diff(curve.index, append=curve.index[-1] + 1) > 1
    curve = curve.reindex(curve.index.union(curve.index[after_gap] + 1))
    x = curve.index if against == "period" else curve[against]
    ax.plot(
        x,
        curve["mean"],
        color=style.colour,
        marker=style.marker,
        linestyle=style.line,
        markersize=4.5 * style.width,
        linewidth=1.8 * style.width,
        label=label,
        zorder=style.above,
    )
    if style.band and curve["low"].notna().any():
        ax.fill_between(x, curve["low"], curve["high"], color=style.colour, alpha=0.18, linewidth=0)


def label_periods(ax: Axes, table: pd.DataFrame, most_ticks: int = 12) -> None:
    """Ticks at the test periods, with the training episodes below where agents agree on them."""
    episodes = table.groupby("period")["train_episodes"].agg(["min", "max"])
    agree = (episodes["min"] == episodes["max"]).all()
    shown = episodes.iloc[:: -(-len(episodes) // most_ticks)]
    labels = [f"{row.Index}\n{row.min}" if agree else f"{row.Index}" for row in shown.itertuples()]
    ax.set_xticks(shown.index, labels)
    ax.set_xlim(-0.3, max(episodes.index.max(), 1) + 0.3)
    ax.set_xlabel("test period\n(training episodes)" if agree else "test period")
