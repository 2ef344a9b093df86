"""Curves of peers and of our agents, and success at equal environment steps and core-minutes."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from analysis.reading import paper
from analysis.statistics.seeds import core_seconds, mean_interval

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
SOLVED = 0.9
"""Success whose waiting time is compared."""
WHOSE = ["task", "agent", "settings"]
_WORDS = ("task", "agent", "settings")
COMMAND = "python -m tests.bench.peers"
_NOTHING = "{folder}: holds no curves of peers; train some with `{command}`"
_BAD_CURVE = "{path}: not a peer's curve ({error}); delete it, and train it again with `{command}`"


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


def load_curve(path: Path) -> pd.DataFrame:
    """One peer's curve.

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
        if len(curve[[*WHOSE, "seed"]].drop_duplicates()) > 1:
            raise ValueError("it holds more than one curve")
    except ValueError as error:
        raise ValueError(_BAD_CURVE.format(path=path, error=error, command=COMMAND)) from error
    return curve


def load_strangers(folder: Path) -> pd.DataFrame:
    """All curves of a folder, `COLUMNS`.

    Raises:
      ValueError: there are none, or one is damaged.
    """
    curves = [load_curve(path) for path in sorted(Path(folder).glob("*.csv"))]
    if not curves:
        raise ValueError(_NOTHING.format(folder=folder, command=COMMAND))
    return pd.concat(curves, ignore_index=True)


def as_curves(results: pd.DataFrame, otherwise: str = "") -> pd.DataFrame:
    """Our results, as `COLUMNS`. Seeds trained in one process share its time equally.

    `otherwise` says what they were trained with, if not as the grid.

    That time includes the tests, while a peer's is the time of its process without tests: our
    agents are charged more.
    """
    return results.assign(
        agent=OURS,
        settings=[
            paper.agent_name(layers) + (f", {otherwise}" if otherwise else "")
            for layers in results["subgoal_layers"]
        ],
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
    for whose, own in curves.groupby(WHOSE, sort=False):
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
    columns = [*WHOSE, "amount", "spent", "n", "mean", "low", "high", "seeds", "early"]
    return pd.DataFrame(rows, columns=columns)


def at(curve: pd.DataFrame, column: str, amount: float) -> float:
    """A seed's success at an amount of `column`, interpolated between the tests around it.

    NaN after its last test, where success is unknown.
    """
    curve = curve.sort_values(column)
    return float(np.interp(amount, curve[column], curve["success_rate"], right=np.nan))


def minutes_to(curves: pd.DataFrame, success: float) -> pd.DataFrame:
    """How long the median seed trains until it reaches a success, a row per task, agent, settings.

    Returns:
      `seeds`; `reached`, how many got there; `minutes`, the median over all seeds of core-minutes,
      infinite where no more than half got there; `ratio` to the least of ours on the task.
    """
    rows = []
    for whose, own in curves.groupby(WHOSE, sort=False):
        times = [_first(seed, success) for _, seed in own.groupby("seed")]
        rows.append((*whose, len(times), int(np.isfinite(times).sum()), float(np.median(times))))
    table = pd.DataFrame(rows, columns=[*WHOSE, "seeds", "reached", "minutes"])
    ours = table[table["agent"] == OURS].groupby("task")["minutes"].min()
    return table.assign(ratio=table["minutes"] / table["task"].map(ours).where(np.isfinite))


def _first(curve: pd.DataFrame, success: float) -> float:
    """Core-minutes until a seed first has a success, on the line between its tests; or infinity."""
    curve = curve.sort_values("core_minutes")
    minutes, rates = curve["core_minutes"].to_numpy(), curve["success_rate"].to_numpy()
    if rates.max() < success:
        return np.inf
    after = int(np.argmax(rates >= success))
    around = slice(max(after - 1, 0), after + 1)
    return float(np.interp(success, rates[around], minutes[around]))


def _early(tests: pd.Series, amount: float) -> bool:
    """Whether an amount lies before the first test of a trained agent."""
    trained = tests[tests > 0]
    return bool(len(trained)) and amount < trained.min()


def our_curves(
    ours: Mapping[str, pd.DataFrame], others: Mapping[str, Mapping[str, pd.DataFrame]]
) -> pd.DataFrame:
    """The grid's results by task, and those of our other agents by what they were trained with."""
    results = {"": ours, **others}
    return pd.concat(
        [as_curves(own, how) for how, by_task in results.items() for own in by_task.values()],
        ignore_index=True,
    )


def gather(
    strangers: pd.DataFrame,
    ours: Mapping[str, pd.DataFrame],
    others: Mapping[str, Mapping[str, pd.DataFrame]],
) -> pd.DataFrame:
    """`our_curves` on the tasks of the peers, then the peers', in the order of Figure 5."""
    own = our_curves(ours, others)
    own = own[own["task"].isin(strangers["task"])]
    return paper.in_order(pd.concat([own, strangers], ignore_index=True))
