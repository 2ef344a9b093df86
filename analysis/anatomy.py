"""Subgoal anatomy: an episode of each agent, its path and every level's subgoals, as figures.

Run as `python -m analysis.anatomy`.
"""

import functools
from collections.abc import Sequence
from pathlib import Path

from analysis import program
from analysis.figures.anatomy import draw_anatomy
from analysis.figures.success import save_png
from analysis.reading import paper
from analysis.reading.episodes import load_episodes
from analysis.reading.files import write_atomically
from analysis.reading.subgoals import recording_command


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


def main(argv: Sequence[str] | None = None) -> None:
    """Command line: draws what was recorded, says what was not; exit status 2 when it cannot."""
    parser = program.over_the_grid("analysis.anatomy", __doc__)
    arguments = parser.parse_args(argv)
    for task in paper.TITLES:
        folder = arguments.data / task
        try:
            paths = write_anatomy(folder, task, (arguments.output or arguments.data) / task)
        except FileNotFoundError:
            print(
                f"{task}: no episodes recorded; make them with `{recording_command(task, folder)}`"
            )
        except (OSError, ValueError) as error:
            parser.error(str(error))
        else:
            print(*paths, sep="\n")


if __name__ == "__main__":
    main()
