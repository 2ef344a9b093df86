"""Are tasks as long as the paper's? Converged agents' steps to goal against its counts.

Run as `python -m analysis.calibration analysis/data/grid/*/` (or with run folders).
"""

from collections.abc import Sequence

import pandas as pd

from analysis.program import table_of
from analysis.reading import paper
from analysis.statistics.seeds import SOLVED, last_rows

COLUMNS = ("task", "converged", "seeds", "median_steps", "paper_steps", "ratio")


def calibrate(results: pd.DataFrame) -> pd.DataFrame:
    """Steps to goal of converged agents, per task.

    An agent here is one seed with any number of subgoal layers. It has converged when its own last
    test period succeeds in at least 80% of its tests; its steps are the mean over those successes.

    Returns:
      A row per task, `COLUMNS`: how many agents of all have converged, the median of their steps
      (NaN for none), the paper's count (NaN for a task it lacks), and the ratio of the two.
    """
    rows = []
    for task, agents in last_rows(results).groupby("task"):
        converged = agents[agents["success_rate"] >= SOLVED]
        median = converged["mean_steps_to_goal"].median()
        steps = paper.STEPS_TO_GOAL.get(task, float("nan"))
        rows.append((task, len(converged), len(agents), median, steps, median / steps))
    return paper.in_order(pd.DataFrame(rows, columns=list(COLUMNS)))


def main(argv: Sequence[str] | None = None) -> None:
    """Command line: prints the table; exit status 2 when it cannot."""
    table = table_of("analysis.calibration", __doc__, argv, calibrate)
    formats = {"median_steps": "{:.0f}", "paper_steps": "{:.0f}", "ratio": "{:.2f}"}
    shown = {column: form.format for column, form in formats.items()}
    print(table.to_string(index=False, na_rep="-", formatters=shown))


if __name__ == "__main__":
    main()
