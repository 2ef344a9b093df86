"""Success against cost: environment steps, and core-minutes."""

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from analysis.figures.success import plot_success

COST_LABELS = {
    "train_steps": "environment steps in training",
    "core_minutes": "minutes of a core for each seed",
}


def draw_costs(summary: pd.DataFrame) -> Figure:
    """Two panels of one task: success over environment steps, and over core-minutes.

    Args:
      summary: as `analysis.statistics.seeds.with_cost` gives it.
    """
    figure = Figure(figsize=(10, 4.0))
    figure.set_layout_engine("constrained", w_pad=0.12, h_pad=0.08)
    for ax, (column, label) in zip(
        figure.subplots(1, 2, sharey=True), COST_LABELS.items(), strict=True
    ):
        plot_success(ax, summary, legend=column == "train_steps", against=column)
        ax.set_title("")
        ax.set_xlabel(label)
        ax.xaxis.set_major_formatter(EngFormatter(sep=""))
        ax.set_xlim(left=0)
    ax.set_ylabel("")
    return figure
