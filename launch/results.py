"""results.csv as the launcher keeps it: whole lines only, and only of seeds that are finished."""

import csv
import io
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from analysis.files import write_atomically
from analysis.schema import RESULTS_COLUMNS
from launch.errors import CommandError

Row = dict[str, str]


def read(path: Path) -> tuple[list[Row], int]:
    """Rows of the file, and how many lines were dropped because a kill cut them short.

    Raises:
      CommandError: the file is not a results.csv of this version.
    """
    if not path.exists():
        return [], 0
    text = path.read_text(encoding="utf-8", errors="replace")
    whole = text[: text.rfind("\n") + 1]
    dropped = int(whole != text)
    lines = list(csv.reader(io.StringIO(whole)))
    if lines and tuple(lines[0]) != RESULTS_COLUMNS:
        raise CommandError(f"{path} has other columns than this version writes; move it away")
    rows = [dict(zip(RESULTS_COLUMNS, line, strict=True)) for line in lines[1:] if _is_whole(line)]
    return rows, dropped + len(lines[1:]) - len(rows)


def rewrite(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Replaces the file by these rows, so that a kill leaves the old file or the new one."""
    text = _lines([dict(zip(RESULTS_COLUMNS, RESULTS_COLUMNS, strict=True)), *rows])
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def append(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Adds whole lines and waits until they are on the disk."""
    with path.open("a", encoding="utf-8") as file:
        file.write(_lines(rows))
        file.flush()
        os.fsync(file.fileno())


def _lines(rows: Iterable[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for row in rows:
        writer.writerow([_cell(row.get(column, "")) for column in RESULTS_COLUMNS])
    return text.getvalue()


def _cell(value: Any) -> str:
    """Empty for what an agent lacks or has not seen; else digits that read back unchanged."""
    if value is None or value != value:
        return ""
    return str(value.item() if hasattr(value, "item") else value)


def _is_whole(line: list[str]) -> bool:
    return len(line) == len(RESULTS_COLUMNS)
