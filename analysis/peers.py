"""Strangers on our tasks beside our agents, at equal environment steps and core-minutes."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from absl import flags
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from analysis import program
from analysis.figures.success import DOTS_PER_INCH, Look, look
from analysis.reading import grid, paper
from analysis.reading.files import write_atomically
from analysis.statistics.seeds import core_seconds, mean_interval, n_label

_HELP = """Compares another library's agents with ours on the same tasks, and draws peers.png.

  python -m analysis.peers

Success is compared at equal environment steps and at equal core-minutes. The strangers' curves
come from `python -m tests.bench.peers`.

Flags:
{flags}

Exit status: 0; 2 what it is to read is not there or damaged, or the command was wrong."""

FOLDER = Path(__file__).parent / "data" / "peers"
FIGURE = "peers.png"
COLUMNS = (
    "task",
    "agent",
    "settings",
    "seed",
    "train_episodes",
    "train_steps",
    "core_minutes",
    "success_rate",
    "test_episodes",
)
"""A curve's columns: a row for each test, the untrained one first."""

OURS = "hac"
_WHOSE = ["task", "agent", "settings"]
_WORDS = ("task", "agent", "settings")
_COMMAND = "python -m tests.bench.peers"
_NOTHING = "{folder}: holds no curves of strangers; `{command}` trains some"
_BAD_CURVE = "{path}: not a stranger's curve ({error}); delete it, and `{command}` trains it anew"


class Budget(NamedTuple):
    """What agents are given equal amounts of."""

    column: str  # of a curve
    title: str
    unit: str
    amounts: tuple[float, ...]


BUDGETS = (
    Budget("train_steps", "equal environment steps", "steps", (1e4, 3e4, 1e5, 3e5, 1e6)),
    Budget("core_minutes", "equal core-minutes", "core-minutes", (0.5, 1, 2, 5, 10)),
)
_LOOKS = {"sac": ("#2e8b3d", "D"), "td3": ("#8e24aa", "v")}
_LINES = {"zoo": ":", "ours20": "-", "ours40": "--"}


def load_curve(path: Path) -> pd.DataFrame:
    """One stranger's curve.

    Raises:
      ValueError: the file holds something else; the message names it.
    """
    try:
        curve = pd.read_csv(path, dtype=dict.fromkeys(_WORDS, str))
        if tuple(curve.columns) != COLUMNS:
            raise ValueError(f"its columns are not {', '.join(COLUMNS)}")
        numbers = curve.drop(columns=list(_WORDS)).to_numpy(dtype=float)
        if not len(curve) or not np.isfinite(numbers).all():
            raise ValueError("a number is missing")
        if len(curve[[*_WHOSE, "seed"]].drop_duplicates()) > 1:
            raise ValueError("it holds more than one curve")
    except ValueError as error:
        raise ValueError(_BAD_CURVE.format(path=path, error=error, command=_COMMAND)) from error
    return curve


def load_strangers(folder: Path) -> pd.DataFrame:
    """All curves of a folder, `COLUMNS`.

    Raises:
      ValueError: there are none, or one is damaged.
    """
    curves = [load_curve(path) for path in sorted(Path(folder).glob("*.csv"))]
    if not curves:
        raise ValueError(_NOTHING.format(folder=folder, command=_COMMAND))
    return pd.concat(curves, ignore_index=True)


def as_curves(results: pd.DataFrame) -> pd.DataFrame:
    """Our results, as `COLUMNS`. Seeds trained in one process share its time equally.

    That time includes the tests, where a stranger's is the process's own without the tests: our
    agents are charged more.
    """
    return results.assign(
        agent=OURS,
        settings=[paper.agent_name(layers) for layers in results["subgoal_layers"]],
        core_minutes=core_seconds(results) / 60,
    )[list(COLUMNS)]


def compare(curves: pd.DataFrame, budget: Budget) -> pd.DataFrame:
    """A row per task, agent, settings and amount.

    Returns:
      `amount`, NaN for the end of each seed's training; `spent`, the mean over seeds of what was
      used by then; `n`, the seeds that were trained for so much; `mean` success of these with its
      95% interval `low` to `high`, NaN where n is 0; `seeds`, all; `early`, whether some seed had
      not been tested since its training began, so that its success is a guess.
    """
    rows = []
    for whose, own in curves.groupby(_WHOSE, sort=False):
        seeds = [seed for _, seed in own.groupby("seed")]
        for amount in (*budget.amounts, np.nan):
            if np.isnan(amount):
                spent = [float(seed[budget.column].max()) for seed in seeds]
            else:
                spent = [amount] * len(seeds)
            values = [at(seed, budget.column, x) for seed, x in zip(seeds, spent, strict=True)]
            values = [value for value in values if not np.isnan(value)]
            interval = mean_interval(values) if values else (np.nan,) * 3
            early = any(_early(seed[budget.column], amount) for seed in seeds)
            row = (*whose, amount, np.mean(spent), len(values), *interval, len(seeds), early)
            rows.append(row)
    columns = [*_WHOSE, "amount", "spent", "n", "mean", "low", "high", "seeds", "early"]
    return pd.DataFrame(rows, columns=columns)


def at(curve: pd.DataFrame, column: str, amount: float) -> float:
    """A seed's success after so much of `column`, on the line between the tests around it.

    NaN after its last test: nobody knows what more training would have done.
    """
    curve = curve.sort_values(column)
    return float(np.interp(amount, curve[column], curve["success_rate"], right=np.nan))


def _early(tests: pd.Series, amount: float) -> bool:
    """Whether an amount lies before the first test of a trained agent."""
    trained = tests[tests > 0]
    return bool(len(trained)) and amount < trained.min()


def as_text(table: pd.DataFrame, budget: Budget) -> str:
    """The comparison as a table in Markdown; ~ before what no test of a trained agent precedes."""
    amounts = [f"{amount:,g}" if amount < 1 else f"{amount:,.0f}" for amount in budget.amounts]
    head = ["task", "agent", "settings", "n", *amounts, f"at its end, after so many {budget.unit}"]
    lines = [_line(head), _line(["---"] * len(head))]
    for whose, own in table.groupby(_WHOSE, sort=False):
        *given, end = own.itertuples()
        last = f"{_cell(end)} after {end.spent:,.{0 if end.spent >= 100 else 1}f}"
        lines.append(_line([*whose, str(end.seeds), *map(_cell, given), last]))
    return "\n".join(lines)


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _cell(row) -> str:
    if not row.n:
        return "-"
    interval = "" if np.isnan(row.low) else f" [{100 * row.low:.0f}, {100 * row.high:.0f}]"
    fewer = f" (n={row.n})" if row.n < row.seeds else ""
    return f"{'~' * row.early}{row.mean:.0%}{interval}{fewer}"


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
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), fontsize="x-small", frameon=False)
    return figure


def _plot(ax: Axes, curves: pd.DataFrame, budget: Budget, most: float) -> None:
    for whose, own in curves.groupby(_WHOSE, sort=False):
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
    ax.yaxis.set_major_formatter(PercentFormatter(1.0))
    ax.grid(alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)


def _look(agent: str, settings: str) -> Look:
    if agent == OURS:
        return look(int(settings.split()[0]))
    return Look(*_LOOKS.get(agent, ("#555555", "o")), _LINES.get(settings, "-."))


def gather(strangers: pd.DataFrame, ours: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Strangers' curves after ours on each of their tasks, in the order of Figure 5."""
    own = [as_curves(ours[task]) for task in strangers["task"].unique() if task in ours]
    return paper.in_order(pd.concat([*own, strangers], ignore_index=True))


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = flags.FlagValues()
    flags.DEFINE_string("peers", os.path.relpath(FOLDER), "holds the strangers' curves", values)
    flags.DEFINE_string("data", os.path.relpath(grid.FOLDER), "our folder per task", values)
    flags.DEFINE_string("output", None, "for the figure; if not given, --peers", values)
    this = program.Program(_HELP, values, wrong=program.UNREADABLE)
    return program.carry_out(this, argv, lambda _: _compare_all(values))


def _compare_all(values: flags.FlagValues) -> None:
    strangers, ours = load_strangers(Path(values.peers)), grid.load_grid(Path(values.data))
    curves = gather(strangers, ours)
    output = Path(values.peers if values.output is None else values.output)
    output.mkdir(parents=True, exist_ok=True)
    figure, path = draw(curves), output / FIGURE
    write_atomically(path, lambda png: figure.savefig(png, format="png", dpi=DOTS_PER_INCH))
    for budget in BUDGETS:
        print(f"Success at {budget.title}", "", as_text(compare(curves, budget), budget), sep="\n")
        print()
    for task in strangers["task"].unique():
        if task not in ours:
            print(f"{values.data}: holds no results of ours on {task}")
    print(path)


if __name__ == "__main__":
    sys.exit(main(sys.argv))
