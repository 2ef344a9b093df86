"""The command lines that programs of this package share."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd

from analysis.reading import grid
from analysis.reading.results import load


def table_of(
    program: str,
    description: str | None,
    argv: Sequence[str] | None,
    compute: Callable[[pd.DataFrame], pd.DataFrame],
) -> pd.DataFrame:
    """What `compute` makes of the results that the command names.

    Exits with status 2 and one message where they cannot be read or do not fit together.
    """
    parser = argparse.ArgumentParser(prog=f"python -m {program}", description=description)
    parser.add_argument("paths", nargs="+", help="run folders or results.csv files")
    arguments = parser.parse_args(argv)
    try:
        return compute(load(arguments.paths))
    except (OSError, ValueError) as error:
        parser.error(str(error))


def over_the_grid(program: str, description: str | None) -> argparse.ArgumentParser:
    """A parser for what is made of published results: --data, and --output if that is elsewhere."""
    parser = argparse.ArgumentParser(prog=f"python -m {program}", description=description)
    parser.add_argument(
        "--data", type=Path, default=grid.published(), help="holds a run folder per task"
    )
    parser.add_argument("--output", type=Path, help="a folder for the files; if not given, --data")
    return parser
