"""Results on third-party environments, and whether hierarchy helped on each."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from analysis import program
from analysis.figures.success import FLAT_LOOKS, label_periods, plot_curve, plot_success, save_png
from analysis.reading import files, grid, names, paper
from analysis.reading.results import load, with_updates
from analysis.statistics.seeds import success_per_period
from analysis.table import as_markdown
from analysis.verdicts import hierarchy

_HELP = """Shows results on third-party environments, and whether hierarchy helped on each.

  python -m analysis.worlds

prints a table of all agents' final results and the verdicts, and writes them to worlds.md. It draws
worlds.png, success against test periods. The folder worlds_td3 beside --data, if it exists, holds
TD3 agents without subgoal layers.

Flags:
{flags}

Exit status: 0; 2 a file to read is missing or damaged, or the command was wrong."""

FOLDER = grid.FOLDER.parent / "worlds"
_TD3 = "TD3+HER"
_FITTED = "_fit"  # what launch/fit.py puts behind a task's name
_COLUMNS = 3
_NO_WORLDS = "{folder}: holds no run folders; `python launch/publish.py` publishes some there"

Worlds = Mapping[str, pd.DataFrame]


def load_worlds(folder: Path) -> dict[str, pd.DataFrame]:
    """The results of every run folder in a folder, by task.

    Raises:
      ValueError: there is none, or a file is damaged.
    """
    found = {}
    for path in sorted(folder.glob(f"*/{names.RESULTS}")):
        results = with_updates(load(path.parent), path.parent)
        found[str(results["task"].iloc[0])] = results
    if not found:
        raise ValueError(_NO_WORLDS.format(folder=folder))
    return found


def load_td3(folder: Path) -> Worlds:
    """The same for TD3 agents without subgoal layers; {} without a folder for them."""
    beside = folder.parent / f"{folder.name}_td3"
    return load_worlds(beside) if beside.is_dir() else {}


def title(task: str) -> str:
    file, _, own = task.partition("-")
    # A task of one's own is called FILE-NAME.
    return paper.title(own if own == file else task.removesuffix(_FITTED))


def draw(worlds: Worlds, td3: Worlds) -> Figure:
    """A panel for each world: mean success and 95% interval of each agent per test period."""
    columns = min(_COLUMNS, len(worlds))
    rows = -(-len(worlds) // columns)
    figure = Figure(figsize=(4.4 * columns, 3.6 * rows))
    figure.set_layout_engine("constrained", w_pad=0.06, h_pad=0.06)
    axes = figure.subplots(rows, columns, sharey=True, squeeze=False).ravel()
    for ax, (task, results) in zip(axes, worlds.items(), strict=False):
        summary = success_per_period(results)
        plot_success(ax, summary, legend=False)
        if task in td3:
            plot_curve(ax, success_per_period(td3[task]), FLAT_LOOKS[0], _TD3)
        label_periods(ax, summary, most_ticks=6)
        ax.set_title(title(task), fontweight="bold")
        if not ax.get_subplotspec().is_first_col():
            ax.set_ylabel("")
        ax.legend(loc="best", fontsize="x-small", framealpha=0.85, handlelength=3)
    for ax in axes[len(worlds) :]:
        ax.axis("off")
    return figure


def _tables(worlds: Worlds, td3: Worlds) -> list[str]:
    lines = as_markdown(pd.concat(worlds.values()))
    if td3:
        lines += ["", f"{_TD3}, without subgoal layers:", "", *as_markdown(pd.concat(td3.values()))]
    return lines


def verdicts(worlds: Worlds, td3: Worlds) -> list[str]:
    """Lines in Markdown: a sentence for each world and hierarchy, and a table of what they gain."""
    judged = {
        title(task): hierarchy.judge(results, {_TD3: td3[task]} if task in td3 else {})
        for task, results in worlds.items()
        if results["subgoal_layers"].nunique() > 1
    }
    sentences = [f"- {name}, {own.sentence}" for name, found in judged.items() for own in found]
    rows = [(name, *row) for name, found in judged.items() for row in hierarchy.costs(found)]
    headings = ("environment", *hierarchy.COST_HEADINGS)
    return [*sentences, "", *program.markdown_table(headings, rows)]


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    return program.over_the_grid(_HELP, FOLDER, argv, _show)


def _show(data: Path, output: Path) -> None:
    worlds, td3 = load_worlds(data), load_td3(data)
    text = "\n".join([*_tables(worlds, td3), "", *verdicts(worlds, td3)])
    output.mkdir(parents=True, exist_ok=True)
    files.write_text(output / "worlds.md", f"{text}\n")
    figure = draw(worlds, td3)
    files.write_atomically(output / "worlds.png", lambda path: save_png(figure, path))
    print(text, "", output / "worlds.png", output / "worlds.md", sep="\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv))
