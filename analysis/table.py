"""A table of every agent's final results: `python -m analysis.table RUN_FOLDER ...`."""

import sys
from collections.abc import Sequence

import pandas as pd

from analysis import program
from analysis.reading.paper import STEPS_TO_GOAL, in_order
from analysis.reading.results import load
from analysis.statistics.seeds import SOLVED, core_minutes, final_success

_HELP = """Prints a Markdown table of every agent's final results.

  python -m analysis.table analysis/data/grid/*/

Flags:
{flags}

Exit status: 0; 2 a file to read is missing or damaged, or the command was wrong."""

HEADINGS = (
    "task",
    "layers",
    "n",
    "episodes",
    "success",
    "95% interval",
    f"episodes to {SOLVED:.0%}",
    "steps",
    "paper",
    "core-minutes",
)


def tabulate(results: pd.DataFrame) -> pd.DataFrame:
    """A row per task and agent, as text under `HEADINGS`; a dash where there is no value.

    Success is the mean over seeds at the last test period; steps are the median over seeds of the
    mean steps to goal, beside the paper's count. Core-minutes are what training and testing all
    seeds took: seeds that were trained side by side, in one process, count once.
    """
    minutes = core_minutes(results)
    rows = [
        (
            agent.task,
            str(agent.subgoal_layers),
            str(agent.n),
            str(agent.train_episodes),
            f"{agent.mean:.1%}",
            "-" if pd.isna(agent.low) else f"{agent.low:.1%} to {agent.high:.1%}",
            _whole(agent.episodes_to_80),
            _whole(agent.median_steps),
            _whole(STEPS_TO_GOAL.get(agent.task)),
            f"{minutes[agent.task, agent.subgoal_layers]:.1f}",
        )
        for agent in in_order(final_success(results)).itertuples()
    ]
    return pd.DataFrame(rows, columns=list(HEADINGS))


def as_markdown(results: pd.DataFrame) -> list[str]:
    """The lines of the table."""
    return program.markdown_table(HEADINGS, tabulate(results).itertuples(index=False))


def _whole(value: float | None) -> str:
    return "-" if value is None or pd.isna(value) else f"{value:.0f}"


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    return program.over_results(_HELP, argv, _show)


def _show(paths: Sequence[str]) -> None:
    print(*as_markdown(load(paths)), sep="\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv))
