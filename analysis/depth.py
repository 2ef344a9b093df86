"""The depth study: does a second subgoal layer pay when a motion takes more decisions?"""

import os
import sys
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from absl import flags

from analysis import program
from analysis.figures.depth import draw
from analysis.figures.success import save_png
from analysis.reading import grid, schema
from analysis.reading.depth import STUDY, load_study
from analysis.reading.files import write_atomically
from analysis.statistics.seeds import success_per_period
from analysis.verdicts.depth import as_table, budgets, compare, sentences, trend

_HELP = """Compares 0, 1 and 2 subgoal layers when the same motion is split into more decisions.

  python -m analysis.depth --data=runs/depth

writes depth.png, the numbers it shows (depth.csv, depth_curves.csv) and the verdicts (depth.md).
The tasks are those of tasks/families/depth.py. --data holds TASK/results.csv. With the fewest
decisions they are the suite's tasks: results that --data lacks are taken from --suite.

Flags:
{flags}

Exit status: 0; 2 a file to read is missing or damaged, or the command was wrong."""
FOLDER = Path(__file__).parent / "data" / "depth"
NAME = "depth"
SEEDS, PERIODS, RUNS = 10, 5, "runs/depth"
_NO_PAIRS = (
    "{folder}: no two agents have a seed with the same number of episodes yet; --episodes=N "
    "compares over the first N episodes"
)


def curves_of(results: pd.DataFrame, budget: dict[str, int]) -> pd.DataFrame:
    """Success per test period until the budget: `schema.FIGURE_COLUMNS`, motion and decisions."""
    within = results[results["train_episodes"] <= results["motion"].map(budget)]
    curves = success_per_period(within)[list(schema.FIGURE_COLUMNS)]
    places = results[["task", "motion", "decisions"]].drop_duplicates()
    return curves.merge(places, on="task")


def commands() -> list[str]:
    """The commands that train the study's runs, one per task, and the one that compares them."""
    trainings = [
        f"python launch/run.py --task=tasks/families/depth.py:{motion}_{decisions} --seeds={SEEDS} "
        f"--periods={PERIODS} --out={RUNS} --novideo"
        for motion, steps in STUDY.items()
        for decisions in steps[1:]
    ]
    return [*trainings, f"python -m analysis.depth --data={RUNS}"]


def write(
    folder: Path, output: Path, episodes: int | None = None, suite: Path | None = None
) -> list[str]:
    """Writes depth.png, the numbers it shows and the verdicts; returns what is to be printed.

    Raises:
      ValueError: as `load_study` and `budgets`; or there is no pair of seeds to compare.
    """
    results = load_study(folder, suite)
    budget = budgets(results, episodes, folder)
    gains = compare(results, budget)
    if not gains:
        raise ValueError(_NO_PAIRS.format(folder=folder))
    curves, table = curves_of(results, budget), as_table(gains, budget)
    trends = [trend(results, motion, own) for motion, own in budget.items()]
    said = [*sentences(gains, budget), *filter(None, trends)]
    figure = draw(curves, table)
    output.mkdir(parents=True, exist_ok=True)
    png, csv, of_curves = (output / f"{NAME}{end}" for end in (".png", ".csv", "_curves.csv"))
    verdicts = output / f"{NAME}.md"
    text = "".join(f"- {sentence}\n" for sentence in said)
    write_atomically(png, lambda path: save_png(figure, path))
    write_atomically(csv, lambda path: table.to_csv(path, index=False))
    write_atomically(of_curves, lambda path: curves.to_csv(path, index=False))
    write_atomically(verdicts, lambda path: path.write_text(text, encoding="utf-8"))
    return [*said, *map(str, (png, csv, of_curves, verdicts))]


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = flags.FlagValues()
    flags.DEFINE_string("data", os.path.relpath(FOLDER), "holds the results", values)
    flags.DEFINE_string("output", None, "folder for the files; default: --data", values)
    program.define_count(
        values, "episodes", None, "compare over this many first episodes; default: all", least=1
    )
    grid_folder = os.path.relpath(grid.FOLDER)
    flags.DEFINE_string("suite", grid_folder, "holds the suite's own results; empty: none", values)
    flags.DEFINE_boolean("commands", False, "only print the commands that train the runs", values)
    this = program.Program(_HELP, values, wrong=program.UNREADABLE)
    return program.carry_out(this, argv, lambda _: _answer_command(values))


def _answer_command(values: flags.FlagValues) -> None:
    if values.commands:
        print(*commands(), sep="\n")
        return
    output = values.data if values.output is None else values.output
    suite = Path(values.suite) if values.suite else None
    print(*write(Path(values.data), Path(output), values.episodes, suite), sep="\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv))
