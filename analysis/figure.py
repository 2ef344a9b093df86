"""Draws a run folder's success figure again: `python -m analysis.figure RUN_FOLDER`."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from analysis.figures.success import write_figure


def main(argv: Sequence[str] | None = None) -> None:
    """Command line: redraws a run folder's figure; exit status 2 when it cannot."""
    parser = argparse.ArgumentParser(prog="python -m analysis.figure", description=__doc__)
    parser.add_argument("run_dir", type=Path, help="a run folder, e.g. runs/pick_place")
    arguments = parser.parse_args(argv)
    try:
        write_figure(arguments.run_dir)
    except (OSError, ValueError) as error:
        parser.error(str(error))
    print(arguments.run_dir / "figure.png")


if __name__ == "__main__":
    main()
