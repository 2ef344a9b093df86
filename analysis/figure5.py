"""The paper's Figure 5: success per test period on its five tasks, from the published results."""

import functools
import sys
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from analysis import program
from analysis.figures.costs import COST_LABELS
from analysis.figures.success import (
    DEEPER_LOOKS,
    FLAT_LOOKS,
    label_periods,
    look,
    plot_curve,
    plot_success,
    save_png,
)
from analysis.reading import grid, paper, schema
from analysis.reading.files import write_atomically
from analysis.statistics.seeds import n_label, success_per_period, with_cost
from analysis.verdicts.rivals import OWN
from analysis.verdicts.speed_claims import Flats, Grid

_HELP = """Draws the paper's Figure 5 from the published results.

  python -m analysis.figure5

writes figure5.png and figure5.pdf, success against test periods as in the paper; figure5_steps.png
and figure5_minutes.png, against environment steps and core-minutes per seed; and figure5.csv, the
numbers in the figures. The folders grid_td3, grid_half_rate and grid_goals_per_segment beside
--data, if they exist, hold flat agents with other settings, and grid_fewer_updates agents with two
subgoal layers; they are drawn too.

Flags:
{flags}

Exit status: 0; 2 a file to read is missing or damaged, or the command was wrong."""

NAME = "figure5"
AGENTS = (0, 1, 2)  # subgoal layers of the paper's agents
NOTHING_YET = "no runs yet"
COLUMNS = (*schema.FIGURE_COLUMNS, "train_steps", "core_minutes", "other")
"""figure5.csv: as figure.csv, the cost of one seed, and the name of an agent of `_OTHERS`."""

_AXES = {"period": "test period (training episodes below)", **COST_LABELS}
_SUFFIXES = {"period": "", "train_steps": "_steps", "core_minutes": "_minutes"}
_ROWS, _COLUMNS = 2, 3
# Agents beside the grid's: their subgoal layers, and how they are drawn.
_OTHERS = {
    **{name: (0, style) for name, style in zip(grid.FLATS, FLAT_LOOKS, strict=True)},
    **{name: (2, style) for name, style in zip(grid.DEEPER, DEEPER_LOOKS, strict=True)},
}
_NOTE = (
    "Lines: mean over seeds of the share of\n"
    "end goals achieved in noise-free tests.\n"
    "Bands: 95% bootstrap interval of that\n"
    "mean. {axis}\n"
    "n: seeds with 0 / 1 / 2 subgoal layers."
)
_UNTRAINED = "Untrained at test period 0."


def summarise(results: Grid, others: Flats) -> pd.DataFrame:
    """What the figure shows of each task's results, and of the other agents: `COLUMNS`."""
    named = {"": results, **others}
    summaries = [
        with_cost(success_per_period(rows), rows).assign(other=name)
        for name, own in named.items()
        for rows in own.values()
    ]
    return pd.concat(summaries, ignore_index=True)[list(COLUMNS)]


def draw_figure5(summary: pd.DataFrame, against: str = "period") -> Figure:
    """Five panels in the paper's order and a legend; a panel without results says so.

    Args:
      summary: `COLUMNS`, of any of the paper's tasks.
      against: what x is: "period", "train_steps" or "core_minutes".
    """
    figure = Figure(figsize=(11, 6.6))
    figure.set_layout_engine("constrained", w_pad=0.06, h_pad=0.06)
    grid_axes = figure.subplots(_ROWS, _COLUMNS, sharey=True)
    *panels, legend = grid_axes.flat
    for ax, task in zip(panels, paper.TITLES, strict=True):
        own = summary[summary["task"] == task]
        _plot_panel(ax, task, own, against)
        if against == "period":
            label_periods(ax, own if len(own) else summary, most_ticks=6)
        ax.set_xlabel(_AXES[against])
        if ax.get_subplotspec().is_first_col():
            ax.set_ylabel("end goals achieved in tests")
    _explain(legend, set(summary["other"]), against)
    return figure


def _plot_panel(ax: Axes, task: str, own: pd.DataFrame, against: str) -> None:
    shown = own[own["other"] == ""]
    if len(shown):
        plot_success(ax, shown, legend=False, against=against)
        for name, (_, style) in _OTHERS.items():
            if len(curve := own[own["other"] == name]):
                plot_curve(ax, curve, style, name, against=against)
    else:
        ax.text(0.5, 0.5, NOTHING_YET, transform=ax.transAxes, ha="center", color="#777777")
        ax.spines[["top", "right"]].set_visible(False)
    ax.set_title(paper.title(task), fontweight="bold", pad=19)
    ax.annotate(
        _seeds(shown),
        xy=(0.5, 1),
        xycoords="axes fraction",
        xytext=(0, 6),
        textcoords="offset points",
        ha="center",
        color="#555555",
        size="small",
    )
    ax.set_ylabel("")


def _seeds(own: pd.DataFrame) -> str:
    """How many seeds each agent has in a panel: "n = 10 / 10 / 3", "-" for none."""
    counts = [own.loc[own["subgoal_layers"] == layers, "n"] for layers in AGENTS]
    labels = [n_label(n).removeprefix("n=") if len(n) else "-" for n in counts]
    return f"n = {' / '.join(labels)}" if len(own) else ""


def _explain(ax: Axes, others: Collection[str], against: str) -> None:
    ax.axis("off")
    handles: list[Any] = []
    for layers in AGENTS:
        style = look(layers)
        (line,) = ax.plot([], [], color=style.colour, marker=style.marker, linestyle=style.line)
        handles.append((line, Patch(facecolor=style.colour, alpha=0.18, linewidth=0)))
    names = [paper.agent_name(layers) for layers in AGENTS]
    names[0] += f" ({OWN})"
    for name, (layers, style) in _OTHERS.items():
        if name in others:
            (line,) = ax.plot(
                [], [], color=style.colour, marker=style.marker, linestyle=style.line,
                linewidth=1.8 * style.width,
            )  # fmt: skip
            handles.append(line)
            names.append(f"{layers}, {name}")
    ax.legend(handles, names, loc="upper left", frameon=False, handlelength=4, fontsize="small")
    note = _NOTE.format(axis=_UNTRAINED if against == "period" else "Dots: test periods.")
    ax.text(0.05, 0.0, note, transform=ax.transAxes, va="bottom", color="#555555", size="small")


def write_figure5(folder: Path, output: Path) -> list[Path]:
    """Writes the figures and figure5.csv, the plotted numbers, into `output`; returns their paths.

    The same results give the same files, byte for byte.

    Raises:
      ValueError: as `grid.load_grid`.
    """
    others = {**grid.load_flats(folder), **grid.load_deeper(folder)}
    summary = summarise(grid.load_grid(folder), others)
    output.mkdir(parents=True, exist_ok=True)
    pdf, csv = (output / f"{NAME}{suffix}" for suffix in (".pdf", ".csv"))
    figures = {
        output / f"{NAME}{suffix}.png": draw_figure5(summary, against)
        for against, suffix in _SUFFIXES.items()
    }
    for path, figure in figures.items():
        write_atomically(path, functools.partial(save_png, figure))
    undated = {"CreationDate": None}
    first = next(iter(figures.values()))
    write_atomically(pdf, lambda path: first.savefig(path, format="pdf", metadata=undated))
    write_atomically(csv, lambda path: summary.to_csv(path, index=False))
    return [*figures, pdf, csv]


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    return program.over_the_grid(_HELP, grid.FOLDER, argv, _draw)


def _draw(data: Path, output: Path) -> None:
    """Writes the files, and names the panels without runs."""
    paths = write_figure5(data, output)
    drawn = set(pd.read_csv(paths[-1])["task"])
    for task in paper.TITLES:
        if task not in drawn:
            print(f"{task}: {NOTHING_YET} in {data}")
    print(*paths, sep="\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv))
