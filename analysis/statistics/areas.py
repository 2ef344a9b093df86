"""Area under success curves: one number for how fast and how reliably an agent learns."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from analysis.statistics.seeds import core_seconds

EPISODES, STEPS, SECONDS = "train_episodes", "train_steps", "core_seconds"
UPDATES = "updates"
"""What agents can be given equal amounts of, as columns of results.

Updates are those of all levels, as `analysis.reading.results.with_updates` counts them. Unlike
seconds they do not depend on the machine.
"""


def areas(results: pd.DataFrame, budget: float, against: str = EPISODES) -> pd.Series:
    """By seed, the area under the success curve until `budget`, as a share of the largest possible.

    Seeds that ended before are left out, since their success is unknown.

    Args:
      results: of one agent on one task.
      budget: an amount of the column `against`, more than 0.
    """
    found = {}
    for seed, spent, success in _curves(results, budget, against):
        within = spent < budget
        x = np.append(spent[within], budget)
        y = np.append(success[within], np.interp(budget, spent, success))
        found[seed] = np.trapezoid(y, x / budget)
    return pd.Series(found, dtype=float)


def area_bounds(
    results: pd.DataFrame, budget: float, against: str = EPISODES
) -> tuple[pd.Series, pd.Series]:
    """By seed, the least and the largest area if all that is known is the tests.

    `areas` draws straight lines between tests. Here success between two tests may be anything from
    the lower of them to the higher.
    """
    least, largest = {}, {}
    for seed, spent, success in _curves(results, budget, against):
        shares = np.diff(np.minimum(spent, budget)) / budget
        least[seed] = shares @ np.minimum(success[1:], success[:-1])
        largest[seed] = shares @ np.maximum(success[1:], success[:-1])
    return pd.Series(least, dtype=float), pd.Series(largest, dtype=float)


def at_budget(results: pd.DataFrame, budget: float, against: str, column: str) -> pd.Series:
    """By seed, a column when `budget` was spent, on a straight line between two tests."""
    found = {
        seed: np.interp(budget, curve[against].to_numpy(float), curve[column].to_numpy(float))
        for seed, curve in results.groupby("seed")
        if curve[against].max() >= budget
    }
    return pd.Series(found, dtype=float)


def _curves(
    results: pd.DataFrame, budget: float, against: str
) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Of each seed that reached the budget, what was spent at each test, and the success."""
    for seed, curve in results.groupby("seed"):
        spent, success = curve[against].to_numpy(float), curve["success_rate"].to_numpy(float)
        if spent.max() >= budget > 0:
            yield seed, spent, success


def common_budget(results: pd.DataFrame, against: str = EPISODES) -> float:
    """The amount of the column `against` that all seeds of a task have reached."""
    return float(results.groupby(["subgoal_layers", "seed"])[against].max().min())


def with_costs(results: pd.DataFrame) -> pd.DataFrame:
    """The results with `SECONDS` where an earlier version lacked them, and with `UPDATES`.

    Those are counted here as if every level made as many in an episode, if nobody has counted them.
    """
    if UPDATES not in results:
        levels = results["subgoal_layers"] + 1
        results = results.assign(**{UPDATES: results[EPISODES] * levels})
    return results.assign(core_seconds=core_seconds(results))
