"""Draws peers beside our agents: success over environment steps, and over core-minutes."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, PercentFormatter

from analysis.figures.success import FLAT_LOOKS, Look, look
from analysis.reading import paper
from analysis.statistics.peers import BUDGETS, OURS, WHOSE, Budget, compare
from analysis.statistics.seeds import n_label

_LOOKS = {"ddpg": ("#8d6e63", "o"), "sac": ("#2e8b3d", "D"), "td3": ("#8e24aa", "v")}
_LINES = {"zoo": ":", "ours20": "-", "ours40": "--"}
_OUR_TD3 = FLAT_LOOKS[0].colour
_MANY_UPDATES = (0, (1, 1))  # of our agents: dots


def draw(curves: pd.DataFrame) -> Figure:
    """A column per task: success over environment steps above, over core-minutes below."""
    names = list(curves["task"].unique())
    figure = Figure(figsize=(2.8 + 4.0 * len(names), 7.4))
    figure.set_layout_engine("constrained", w_pad=0.1, h_pad=0.1)
    axes = figure.subplots(len(BUDGETS), len(names), squeeze=False, sharey=True)
    for budget, row in zip(BUDGETS, axes, strict=True):
        for task, ax in zip(names, row, strict=True):
            own = curves[curves["task"] == task]
            strangers = own[own["agent"] != OURS]
            _plot(ax, own, budget, most=float(strangers[budget.column].max()))
            ax.set_title(paper.title(task), size="medium")
            ax.set_xlabel(budget.unit)
    for ax in axes[-1]:
        ax.legend(
            loc="upper center", bbox_to_anchor=(0.5, -0.2), fontsize="x-small", frameon=False,
            handlelength=4,
        )  # fmt: skip
    return figure


def _plot(ax: Axes, curves: pd.DataFrame, budget: Budget, most: float) -> None:
    for whose, own in curves.groupby(WHOSE, sort=False):
        seeds = [seed for _, seed in own.groupby("seed")]
        # As far as all seeds were trained, and not far beyond the strangers.
        end = min(min(float(seed[budget.column].max()) for seed in seeds), 1.5 * most)
        amounts = tuple(np.linspace(0, end, 41))
        table = compare(own, budget._replace(amounts=amounts)).iloc[:-1]
        drawn = _look(*whose[1:])
        ax.plot(
            table["amount"], table["mean"], color=drawn.colour, linestyle=drawn.line,
            marker=drawn.marker, markevery=10, markersize=4, linewidth=1.5,
            label=f"{' '.join(whose[1:])}, {n_label([len(seeds)])}",
        )  # fmt: skip
        ax.fill_between(
            table["amount"], table["low"], table["high"], color=drawn.colour, alpha=0.12, lw=0
        )
    ax.set_ylim(-0.03, 1.03)
    ax.xaxis.set_major_locator(MaxNLocator(5))
    ax.xaxis.set_major_formatter(FuncFormatter(_short))
    ax.yaxis.set_major_formatter(PercentFormatter(1.0))
    ax.grid(alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)


def _short(amount: float, _: int) -> str:
    return f"{amount / 1000:g}k" if amount >= 1000 else f"{amount:g}"


def _look(agent: str, settings: str) -> Look:
    if agent == OURS:
        name, _, otherwise = settings.partition(", ")
        own = look(int(name.split()[0]))
        if "TD3" in otherwise:
            own = own._replace(colour=_OUR_TD3, marker="x")
        return own._replace(line=_MANY_UPDATES) if "updates" in otherwise else own
    return Look(*_LOOKS.get(agent, ("#555555", "o")), _LINES.get(settings, "-."))
