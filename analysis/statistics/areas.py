"""Area under success curves: one number for how fast and how reliably an agent learns."""

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
    for seed, curve in results.groupby("seed"):
        spent, success = curve[against].to_numpy(float), curve["success_rate"].to_numpy(float)
        if spent.max() >= budget > 0:
            within = spent < budget
            x = np.append(spent[within], budget)
            y = np.append(success[within], np.interp(budget, spent, success))
            found[seed] = np.trapezoid(y, x / budget)
    return pd.Series(found, dtype=float)


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
