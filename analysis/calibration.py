"""Compares converged agents' steps to the goal with the paper's counts."""

import sys
from collections.abc import Sequence

import pandas as pd

from analysis import program
from analysis.reading import paper
from analysis.reading.results import load
from analysis.statistics.seeds import SOLVED, last_rows

_HELP = """Prints the steps to the goal of converged agents next to the paper's, for each task.

  python -m analysis.calibration analysis/data/grid/*/

Flags:
{flags}

Exit status: 0; 2 a file to read is missing or damaged, or the command was wrong."""

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


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    return program.over_results(_HELP, argv, _show)


def _show(paths: Sequence[str]) -> None:
    formats = {"median_steps": "{:.0f}", "paper_steps": "{:.0f}", "ratio": "{:.2f}"}
    shown = {column: form.format for column, form in formats.items()}
    print(calibrate(load(paths)).to_string(index=False, na_rep="-", formatters=shown))


if __name__ == "__main__":
    sys.exit(main(sys.argv))
