"""results.csv as the launcher keeps it: whole lines only, and only of seeds that are finished."""

import csv
import io
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from analysis.program import CommandError
from analysis.reading.files import write_text
from analysis.reading.results import read_lines, to_table
from analysis.reading.schema import (
    CORE_COLUMNS,
    LATER_COLUMNS,
    LEVEL_FIELDS,
    RESULTS_COLUMNS,
    level_column,
)

Row = dict[str, str]


_MOST_DIGITS = 15  # Python does not read numbers of thousands of digits, be they zeros
_WHOLE_NUMBERS = ("subgoal_layers", "seed", "period")  # what says which runs are finished


class Changed(OSError):
    """Somebody changed the file while a launch was at work on it."""


def read(path: Path) -> tuple[list[Row], int]:
    """Rows of the file, and how many lines were dropped because a kill cut them short.

    Raises:
      CommandError: the file is not a results.csv, or a line of it is damaged.
    """
    if not path.exists():
        return [], 0
    try:
        lines = read_lines(path)
        if lines.rows:
            to_table(lines, path)  # what cannot be is refused, here as in the analysis
    except ValueError as error:
        raise CommandError(f"{error}; repair it, or move it elsewhere") from error
    rows = [
        _row(path, number, dict(zip(lines.columns, cells, strict=True)))
        for number, cells in lines.rows.items()
    ]
    return rows, int(lines.cut_short)


def _row(path: Path, number: int, row: Row) -> Row:
    """The row, if what is counted in it is written as this file has it: in digits alone."""
    for column in _WHOLE_NUMBERS:
        cell = row[column]
        if not (cell.isascii() and cell.isdigit() and len(cell) <= _MOST_DIGITS):
            raise CommandError(
                f"{path}, line {number}: {column} is {cell[:40]!r}, not only digits; repair the "
                "line or remove it"
            )
    return row


def is_current(path: Path) -> bool:
    """Whether the file is there and has all columns of this version, so that it can be added to."""
    return path.exists() and set(RESULTS_COLUMNS) <= set(read_lines(path).columns)


def rewrite(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Replaces the file by these rows, so that a kill leaves the old file or the new one.

    It gets all columns of this version, and those beyond it that a row has.
    """
    others = dict.fromkeys(name for row in rows for name in row if name not in RESULTS_COLUMNS)
    columns = [*RESULTS_COLUMNS, *others]
    write_text(path, _lines(columns, [dict(zip(columns, columns, strict=True)), *rows]))


def append(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Adds whole lines and waits until they are on the disk.

    Raises:
      ValueError: a row has a column that the file lacks, or lacks one of its own levels'.
      Changed: somebody has removed the file or its header since it was readied.
    """
    for row in rows:
        check_columns(row)
    with path.open("rb+") as file:
        columns = next(csv.reader([file.readline().decode("utf-8", "replace")]), [])
        if not set(RESULTS_COLUMNS) <= set(columns):
            raise Changed(f"{path} lost its header while a launch was using it")
        added = _lines(columns, rows).encode()
        if file.seek(0, os.SEEK_END) and not _ends_a_line(file):
            added = b"\n" + added  # somebody's editor took it away: rows would be glued
        file.write(added)
        file.flush()
        os.fsync(file.fileno())


def _ends_a_line(file: IO[bytes]) -> bool:
    file.seek(-1, os.SEEK_END)
    return file.read(1) == b"\n"


def check_columns(row: Mapping[str, Any], *, earlier: bool = False) -> None:
    """What the engine measures and what the file holds are two lists: none may drop the other's.

    Args:
      earlier: the row may be of an earlier version, which measured less.

    Raises:
      ValueError: a row has a column that the file lacks, or lacks one of its own levels'.
    """
    levels = range(row["subgoal_layers"] + 1)
    own = {level_column(level, field) for level in levels for field in LEVEL_FIELDS}
    known = own.union(CORE_COLUMNS, LATER_COLUMNS)
    needed = set(CORE_COLUMNS) if earlier else known
    differ = sorted((needed - row.keys()) | (row.keys() - known))
    if differ:
        raise ValueError(f"columns that only results.csv or only its new row has: {differ}")


def _lines(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for row in rows:
        writer.writerow([_cell(row.get(column, "")) for column in columns])
    return text.getvalue()


def _cell(value: Any) -> str:
    """Empty for what an agent lacks or has not seen; else digits that read back unchanged."""
    if value is None or value != value:
        return ""
    return str(value.item() if hasattr(value, "item") else value)
