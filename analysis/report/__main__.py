"""Writes a run folder's report.html again: `python -m analysis.report RUN_FOLDER`."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from analysis.report.run_report import write_report


def main(argv: Sequence[str] | None = None) -> None:
    """Command line: writes the report and prints its path; exit status 2 when it cannot."""
    parser = argparse.ArgumentParser(prog="python -m analysis.report", description=__doc__)
    parser.add_argument("run_dir", type=Path, help="a run folder, e.g. runs/pick_place")
    arguments = parser.parse_args(argv)
    try:
        path = write_report(arguments.run_dir)
    except (OSError, ValueError) as error:
        parser.error(str(error))
    print(path)


if __name__ == "__main__":
    main()
