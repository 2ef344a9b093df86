"""The paper's Figure 5: success per test period on its five tasks, from the published results."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from analysis import program
from analysis.figures.success import DOTS_PER_INCH, label_periods, look, plot_success
from analysis.reading import grid, paper, schema
from analysis.reading.files import write_atomically
from analysis.statistics.seeds import n_label, success_per_period

_HELP = """Draws the paper's Figure 5 from the published results.

  python -m analysis.figure5

writes figure5.png, figure5.pdf and figure5.csv, the numbers that are drawn.

Flags:
{flags}

Exit status: 0; 2 what it is to read is not there or damaged, or the command was wrong."""

NAME = "figure5"
AGENTS = (0, 1, 2)  # subgoal layers of the paper's agents
NOTHING_YET = "no runs yet"

_ROWS, _COLUMNS = 2, 3
_NOTE = (
    "Lines: mean over seeds of the share of\n"
    "end goals achieved in noise-free tests.\n"
    "Bands: 95% bootstrap interval of that\n"
    "mean. Untrained at test period 0.\n"
    "n: seeds with 0 / 1 / 2 subgoal layers."
)


def summarise(results: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """What the figure shows of each task's results: `schema.FIGURE_COLUMNS`, tasks in order."""
    summaries = [success_per_period(own) for own in results.values()]
    return pd.concat(summaries, ignore_index=True)[list(schema.FIGURE_COLUMNS)]


def draw_figure5(summary: pd.DataFrame) -> Figure:
    """Five panels in the paper's order and a legend; a panel without results says so.

    Args:
      summary: `schema.FIGURE_COLUMNS`, of any of the paper's tasks.
    """
    figure = Figure(figsize=(11, 6.6))
    figure.set_layout_engine("constrained", w_pad=0.06, h_pad=0.06)
    grid_axes = figure.subplots(_ROWS, _COLUMNS, sharey=True)
    *panels, legend = grid_axes.flat
    for ax, task in zip(panels, paper.TITLES, strict=True):
        own = summary[summary["task"] == task]
        _plot_panel(ax, task, own, summary)
        if ax.get_subplotspec().is_first_col():
            ax.set_ylabel("end goals achieved in tests")
    _explain(legend)
    return figure


def _plot_panel(ax: Axes, task: str, own: pd.DataFrame, everything: pd.DataFrame) -> None:
    if len(own):
        plot_success(ax, own, legend=False)
    else:
        ax.text(0.5, 0.5, NOTHING_YET, transform=ax.transAxes, ha="center", color="#777777")
        ax.spines[["top", "right"]].set_visible(False)
    label_periods(ax, own if len(own) else everything, most_ticks=6)
    ax.set_title(paper.title(task), fontweight="bold", pad=19)
    ax.annotate(
        _seeds(own),
        xy=(0.5, 1),
        xycoords="axes fraction",
        xytext=(0, 6),
        textcoords="offset points",
        ha="center",
        color="#555555",
        size="small",
    )
    ax.set_xlabel("test period (training episodes below)")
    ax.set_ylabel("")


def _seeds(own: pd.DataFrame) -> str:
    """How many seeds each agent has in a panel: "n = 10 / 10 / 3", "-" for none."""
    counts = [own.loc[own["subgoal_layers"] == layers, "n"] for layers in AGENTS]
    labels = [n_label(n).removeprefix("n=") if len(n) else "-" for n in counts]
    return f"n = {' / '.join(labels)}" if len(own) else ""


def _explain(ax: Axes) -> None:
    ax.axis("off")
    handles = []
    for layers in AGENTS:
        style = look(layers)
        (line,) = ax.plot([], [], color=style.colour, marker=style.marker, linestyle=style.line)
        handles.append((line, Patch(facecolor=style.colour, alpha=0.18, linewidth=0)))
    names = [paper.agent_name(layers) for layers in AGENTS]
    names[0] += " (DDPG+HER)"
    ax.legend(handles, names, loc="upper left", frameon=False, handlelength=4)
    ax.text(0.05, 0.5, _NOTE, transform=ax.transAxes, va="top", color="#555555")


def write_figure5(folder: Path, output: Path) -> list[Path]:
    """Writes figure5.png, .pdf and .csv, the plotted numbers, into `output`; returns their paths.

    The same results give the same files, byte for byte.

    Raises:
      ValueError: as `grid.load_grid`.
    """
    summary = summarise(grid.load_grid(folder))
    figure = draw_figure5(summary)
    output.mkdir(parents=True, exist_ok=True)
    png, pdf, csv = (output / f"{NAME}{suffix}" for suffix in (".png", ".pdf", ".csv"))
    write_atomically(png, lambda path: figure.savefig(path, format="png", dpi=DOTS_PER_INCH))
    undated = {"CreationDate": None}
    write_atomically(pdf, lambda path: figure.savefig(path, format="pdf", metadata=undated))
    write_atomically(csv, lambda path: summary.to_csv(path, index=False))
    return [png, pdf, csv]


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
