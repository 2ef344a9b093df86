"""The command line that the tables share."""

import argparse
from collections.abc import Callable, Sequence

import pandas as pd

from analysis.load import load


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
