"""Pictures that explain a run: which tests fail, maps of subgoals and of Q, a failure gallery."""

import functools
import sys
from collections.abc import Sequence
from pathlib import Path

from analysis import program
from analysis.figures.success import save_png
from analysis.reading import names
from analysis.reading.files import write_atomically
from analysis.reading.results import load
from analysis.reading.subgoals import load_recorded
from analysis.report.explanations import explanations, recording_command

_HELP = """Draws pictures that explain the agents of a run folder, from the records in it.

  python launch/record_episodes.py --task=ur5_reacher
  python -m analysis.explain runs/ur5_reacher

The first command makes the records; the report has the same pictures. starts.png shows which tests
fail; failures_<k>layers.png, some failed episodes; subgoal_maps.png, where levels put their
subgoals; values.png, Q over the goals of each level.

Flags:
{flags}

Exit status: 0; 2 the folder holds no records or no results, or the command was wrong."""


def write_explanations(folder: Path) -> list[Path]:
    """Writes the pictures into the run folder; returns their paths.

    Raises:
      FileNotFoundError, ValueError: there are no results, or no records.
    """
    task = _task(folder)
    paths = []
    for shown in explanations(folder, task):
        paths.append(folder / f"{shown.name}.png")
        write_atomically(paths[-1], functools.partial(save_png, shown.figure))
    if not paths:
        command = recording_command(task, folder)
        raise ValueError(f"{folder}: no episodes are recorded; record some with `{command}`")
    return paths


def _task(folder: Path) -> str:
    """Whose the records are; those of published policies can lie in a folder without results."""
    try:
        return load(folder)["task"].iloc[0]
    except FileNotFoundError:
        if not (folder / names.STARTS).is_file():
            raise
        return next(iter(load_recorded(folder, names.STARTS)["task"]), "")


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    return program.over_a_folder(
        _HELP, argv, lambda folder: print(*write_explanations(folder), sep="\n")
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv))
