"""Writes a run folder's report.html again: `python -m analysis.report RUN_FOLDER`."""

import sys
from collections.abc import Sequence
from pathlib import Path

from analysis import program
from analysis.report.run_report import write_report

_HELP = """Rewrites a run folder's report.html.

  python -m analysis.report runs/pick_place

Flags:
{flags}

Exit status: 0; 2 a file to read is missing or damaged, or the command was wrong."""


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    return program.over_a_folder(_HELP, argv, _write)


def _write(folder: Path) -> None:
    print(write_report(folder))


if __name__ == "__main__":
    sys.exit(main(sys.argv))
