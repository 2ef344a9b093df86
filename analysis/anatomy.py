"""Subgoal anatomy: an episode of each agent, its path and every level's subgoals, as figures."""

import functools
import sys
from collections.abc import Sequence
from pathlib import Path

from analysis import program
from analysis.figures.anatomy import draw_anatomy
from analysis.figures.success import save_png
from analysis.reading import grid, paper
from analysis.reading.episodes import load_episodes
from analysis.reading.files import write_atomically
from analysis.reading.subgoals import recording_command

_HELP = """Draws an episode of each published agent: its path and every level's subgoals.

  python -m analysis.anatomy --output=figures

Flags:
{flags}

Exit status: 0; 2 a file to read is missing or damaged, or the command was wrong."""


def write_anatomy(folder: Path, task: str, output: Path) -> list[Path]:
    """Writes anatomy_<k>layers.png for each agent of a task; returns their paths.

    Raises:
      FileNotFoundError, ValueError: as `load_episodes`.
    """
    paths = []
    for episode in load_episodes(folder, task):
        output.mkdir(parents=True, exist_ok=True)
        paths.append(output / f"anatomy_{episode.subgoal_layers}layers.png")
        write_atomically(paths[-1], functools.partial(save_png, draw_anatomy(episode)))
    return paths


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    return program.over_the_grid(_HELP, grid.FOLDER, argv, _draw)


def _draw(data: Path, output: Path) -> None:
    """Draws the recorded tasks, and names those without records."""
    for task in paper.TITLES:
        try:
            paths = write_anatomy(data / task, task, output / task)
        except FileNotFoundError:
            command = recording_command(task, data / task)
            print(f"{task}: no episodes are recorded; record some with `{command}`")
        else:
            print(*paths, sep="\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv))
