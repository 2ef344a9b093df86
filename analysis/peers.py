"""Compares peers with our agents on our tasks, at equal environment steps and core-minutes."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from absl import flags

from analysis import program
from analysis.figures.peers import draw
from analysis.figures.success import save_png
from analysis.reading import grid
from analysis.reading.files import write_atomically
from analysis.statistics.peers import (
    BUDGETS,
    SOLVED,
    WHOSE,
    Budget,
    compare,
    gather,
    load_strangers,
    minutes_to,
)

_HELP = """Compares another library's agents with ours on the same tasks, and draws peers.png.

  python -m analysis.peers

Success is compared at equal environment steps and at equal core-minutes; a third table has the
core-minutes until the median seed reaches 90%. `python -m tests.bench.peers` trains the peers:
the other library's agents.

Flags:
{flags}

Exit status: 0; 2 a file to read is missing or damaged, or the command was wrong."""
FOLDER = Path(__file__).parent / "data" / "peers"
FIGURE = "peers.png"


def as_text(table: pd.DataFrame, budget: Budget) -> str:
    """The comparison as a table in Markdown; ~ before what no test of a trained agent precedes."""
    amounts = [f"{amount:,g}" if amount < 1 else f"{amount:,.0f}" for amount in budget.amounts]
    head = ["task", "agent", "settings", "n", *amounts, f"at its end, after so many {budget.unit}"]
    lines = [_line(head), _line(["---"] * len(head))]
    for whose, own in table.groupby(WHOSE, sort=False):
        *given, end = own.itertuples()
        last = f"{_cell(end)} after {end.spent:,.{0 if end.spent >= 100 else 1}f}"
        lines.append(_line([*whose, str(end.seeds), *map(_cell, given), last]))
    return "\n".join(lines)


def as_waits(table: pd.DataFrame) -> str:
    """How long agents take to 90% as a table in Markdown; a dash: no more than half get there."""
    head = ["task", "agent", "settings", "n", "reached", "core-minutes", "times the best of ours"]
    lines = [_line(head), _line(["---"] * len(head))]
    for row in table.itertuples():
        amounts = [f"{x:.1f}" if np.isfinite(x) else "-" for x in (row.minutes, row.ratio)]
        who = [row.task, row.agent, row.settings]
        lines.append(_line([*who, str(row.seeds), str(row.reached), *amounts]))
    return "\n".join(lines)


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _cell(row) -> str:
    if not row.n:
        return "-"
    interval = "" if np.isnan(row.low) else f" [{100 * row.low:.0f}, {100 * row.high:.0f}]"
    fewer = f" (n={row.n})" if row.n < row.seeds else ""
    return f"{'~' * row.early}{row.mean:.0%}{interval}{fewer}"


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = flags.FlagValues()
    flags.DEFINE_string("peers", os.path.relpath(FOLDER), "folder of the peers' curves", values)
    flags.DEFINE_string(
        "data", os.path.relpath(grid.FOLDER), "folder of our run folders, one per task", values
    )
    flags.DEFINE_string("output", None, "folder for the figure; default: --peers", values)
    this = program.Program(_HELP, values, wrong=program.UNREADABLE)
    return program.carry_out(this, argv, lambda _: _compare_all(values))


def _compare_all(values: flags.FlagValues) -> None:
    strangers, ours = load_strangers(Path(values.peers)), grid.load_grid(Path(values.data))
    curves = gather(strangers, ours, grid.load_as_peers(Path(values.data)))
    output = Path(values.peers if values.output is None else values.output)
    output.mkdir(parents=True, exist_ok=True)
    figure, path = draw(curves), output / FIGURE
    write_atomically(path, lambda png: save_png(figure, png))
    for budget in BUDGETS:
        print(f"Success at {budget.title}", "", as_text(compare(curves, budget), budget), sep="\n")
        print()
    waits = as_waits(minutes_to(curves, SOLVED))
    print(f"Core-minutes until the median seed reaches {SOLVED:.0%}", "", waits, "", sep="\n")
    for task in strangers["task"].unique():
        if task not in ours:
            print(f"{values.data}: holds none of our results on {task}")
    print(path)


if __name__ == "__main__":
    sys.exit(main(sys.argv))
