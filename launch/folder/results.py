"""results.csv as the launcher keeps it: whole lines only, and only of seeds that are finished."""

import csv
import io
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from analysis.program import CommandError
from analysis.reading.files import write_atomically
from analysis.reading.schema import CORE_COLUMNS, LEVEL_FIELDS, RESULTS_COLUMNS, level_column

Row = dict[str, str]

_MOST_DIGITS = 15  # Python does not read numbers of thousands of digits
_WHOLE_NUMBERS = ("subgoal_layers", "seed", "period")  # what says which runs are finished


def read(path: Path) -> tuple[list[Row], int]:
    """Rows of the file, and how many lines were dropped because a kill cut them short.

    Raises:
      CommandError: the file is not a results.csv of this version, or a line of it is damaged.
    """
    if not path.exists():
        return [], 0
    text = path.read_text(encoding="utf-8", errors="replace")
    whole = text[: text.rfind("\n") + 1]
    reader = csv.reader(io.StringIO(whole))
    try:
        header = next(reader, None)
        lines = [(reader.line_num, line) for line in reader]
    except csv.Error as error:
        raise CommandError(f"{path}, line {reader.line_num}: {error}; move it away") from error
    if header is not None and tuple(header) != RESULTS_COLUMNS:
        raise CommandError(f"{path} has other columns than this version writes; move it away")
    rows = [_row(path, number, line) for number, line in lines if _is_whole(line)]
    return rows, int(whole != text) + len(lines) - len(rows)


def _row(path: Path, number: int, line: list[str]) -> Row:
    row = dict(zip(RESULTS_COLUMNS, line, strict=True))
    for column in _WHOLE_NUMBERS:
        cell = row[column]
        if not (cell.isascii() and cell.isdigit() and len(cell) <= _MOST_DIGITS):
            raise CommandError(
                f"{path}, line {number}: {column} is {cell[:40]!r}, not a whole number; "
                "mend the line or remove it"
            )
    return row


def rewrite(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Replaces the file by these rows, so that a kill leaves the old file or the new one."""
    text = _lines([dict(zip(RESULTS_COLUMNS, RESULTS_COLUMNS, strict=True)), *rows])
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def append(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Adds whole lines and waits until they are on the disk.

    Raises:
      ValueError: a row has a column that the file lacks, or lacks one of its own levels'.
    """
    for row in rows:
        check_columns(row)
    with path.open("a", encoding="utf-8") as file:
        file.write(_lines(rows))
        file.flush()
        os.fsync(file.fileno())


def check_columns(row: Mapping[str, Any]) -> None:
    """What the engine measures and what the file holds are two lists: none may drop the other's.

    Raises:
      ValueError: a row has a column that the file lacks, or lacks one of its own levels'.
    """
    levels = range(row["subgoal_layers"] + 1)
    own = {level_column(level, field) for level in levels for field in LEVEL_FIELDS}
    differ = sorted(own.union(CORE_COLUMNS) ^ row.keys())
    if differ:
        raise ValueError(f"columns that only results.csv or only its new row has: {differ}")


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
