"""Tables of what was replayed: a row for each episode or subgoal."""

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import hac_suite
from analysis.program import CommandError
from analysis.reading.files import write_atomically
from launch.pictures.subgoal_log import Replayed, replay

DIGITS = 3  # of positions in records: millimetres


def replayed(path: Path, episodes: int) -> Replayed:
    """Test episodes of the policy in a file.

    Raises:
      CommandError: it cannot be loaded or run.
    """
    try:
        return replay(hac_suite.Policy.load(path), episodes)
    except (KeyError, TypeError, ValueError) as error:
        raise CommandError(f"policy {path}: {error}") from error


def write(path: Path, head: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Writes a table whole, or not at all."""

    def filled(temporary: Path) -> None:
        with temporary.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(head)
            writer.writerows(rows)

    write_atomically(path, filled)


def points(names: Sequence[str], *kinds: str) -> list[str]:
    """The columns of kinds of points in a space with these dimensions: `start_tip_x`, ..."""
    return [f"{kind}_{name}" for kind in kinds for name in names]


def rounded(values: Iterable[float]) -> list[str]:
    """Coordinates as a table has them."""
    return [f"{value:.{DIGITS}f}" for value in values]
