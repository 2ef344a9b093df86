"""Redraws a run folder's success figure: `python -m analysis.figure RUN_FOLDER`."""

import sys
from collections.abc import Sequence
from pathlib import Path

from analysis import program
from analysis.figures.success import write_figure
from analysis.reading import names

_HELP = """Redraws a run folder's success figure: figure.png and figure.csv.

  python -m analysis.figure runs/pick_place

Flags:
{flags}

Exit status: 0; 2 a file to read is missing or damaged, or the command was wrong."""


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    return program.over_a_folder(_HELP, argv, _draw)


def _draw(folder: Path) -> None:
    write_figure(folder)
    print(folder / names.FIGURE)


if __name__ == "__main__":
    sys.exit(main(sys.argv))
