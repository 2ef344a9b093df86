"""What the levels of an agent do over training: missed subgoals and Q values, per test period."""

import re

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from analysis.figures.success import Look, label_periods
from analysis.reading import paper, schema
from analysis.statistics.seeds import n_label

QUANTITIES = {
    "missed": "subgoals missed",
    "q_mean": "mean Q value",
}

LOOKS = (
    Look("#555555", "o", "-"),  # level 0 acts
    Look("#8e24aa", "s", "--"),  # level 1 proposes the purple subgoals
    Look("#2e8b3d", "^", "-."),  # level 2 the green ones
    Look("#b35900", "D", ":"),
)

_COLUMNS = ("subgoal_layers", "level", "quantity", "period", "train_episodes", "n", "mean")


def level_means(results: pd.DataFrame) -> pd.DataFrame:
    """Means over seeds of the diagnostics, per agent, level and test period.

    Returns:
      Columns subgoal_layers, level (0 acts), quantity (a key of `QUANTITIES`), period,
      train_episodes, n, mean. "missed" is the share of the subgoals that the level proposed in
      training since the last period and that were not achieved. Only the `n` seeds that have the
      quantity count: none has proposed anything at period 0.
    """
    tables = [pd.DataFrame(columns=list(_COLUMNS))]
    for level in _levels(results):
        for quantity in QUANTITIES:
            values = _values(results, level, quantity)
            found = results.assign(value=values).dropna(subset="value")
            means = (
                found.groupby(["subgoal_layers", "period"])
                .agg(
                    train_episodes=("train_episodes", "first"),
                    n=("value", "size"),
                    mean=("value", "mean"),
                )
                .reset_index()
                .assign(level=level, quantity=quantity)
            )
            tables.append(means[list(_COLUMNS)])
    return pd.concat([table for table in tables if len(table)] or tables[:1], ignore_index=True)


def _levels(results: pd.DataFrame) -> list[int]:
    matches = (re.fullmatch(r"level(\d+)_\w+", column) for column in results.columns)
    return sorted({int(match[1]) for match in matches if match})


def _values(results: pd.DataFrame, level: int, quantity: str) -> pd.Series:
    """[rows] of the quantity, NaN where the agent or the seed does not have it."""
    if quantity != "missed":
        return _column(results, level, quantity)
    return 1 - _column(results, level, "achieved")


def _column(results: pd.DataFrame, level: int, field: str) -> pd.Series:
    name = schema.level_column(level, field)
    return results[name] if name in results else pd.Series(float("nan"), index=results.index)


def draw_diagnostics(results: pd.DataFrame) -> Figure:
    """Small plots: a column per agent, a row per quantity, a line per level."""
    means = level_means(results)
    agents = sorted(results["subgoal_layers"].unique())
    figure = Figure(figsize=(3.4 * len(agents) + 0.6, 4.8), layout="constrained")
    grid = figure.subplots(len(QUANTITIES), len(agents), sharex=True, sharey="row", squeeze=False)
    for axes, quantity in zip(grid, QUANTITIES, strict=True):
        axes[0].set_ylabel(QUANTITIES[quantity])
        for ax, layers in zip(axes, agents, strict=True):
            chosen = means[(means["subgoal_layers"] == layers) & (means["quantity"] == quantity)]
            _plot_levels(ax, chosen, "proposes no subgoals" if quantity == "missed" else "no data")
    for ax, layers in zip(grid[0], agents, strict=True):
        ax.set_title(paper.agent_name(layers), fontsize="medium", fontweight="bold")
        ax.set_ylim(-0.03, 1.03)
        ax.yaxis.set_major_formatter(PercentFormatter(1.0))
    for ax in grid[-1]:
        label_periods(ax, results, most_ticks=6)
    return figure


def _plot_levels(ax: Axes, means: pd.DataFrame, nothing: str) -> None:
    ax.grid(alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    if means.empty:
        ax.text(0.5, 0.5, nothing, transform=ax.transAxes, ha="center", color="#777777")
        return
    for level, line in means.groupby("level"):
        look = LOOKS[level % len(LOOKS)]
        ax.plot(
            line["period"],
            line["mean"],
            color=look.colour,
            marker=look.marker,
            linestyle=look.line,
            markersize=3.5,
            label=f"level {level} ({n_label(line['n'])})",
        )
    ax.legend(fontsize="small", framealpha=0.8, handlelength=3)
