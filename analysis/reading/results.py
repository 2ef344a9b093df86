"""Reads results.csv of one or several run folders into one tidy table, and a run's manifest."""

import contextlib
import csv
import io
import json
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from analysis.reading import files, names, paper, schema

_LARGEST_WHOLE = 2**53
_PART = 16 * 2**20  # bytes parsed at a time: a part takes several times its size
_UNUSUAL = (b'"', b"\r", b"\0", b"\n\n")
_MOST_BYTES = 2**31  # several million rows
_SHARES = {
    schema.level_column(level, field)
    for level in range(schema.MAX_LEVELS)
    for field in schema.SHARES
}
_KNOWN = {*schema.CORE_COLUMNS, *schema.RESULTS_COLUMNS}
_MISSING_FILE = (
    "{path}: no results.csv here; give a run folder such as runs/pick_place, or the file"
)
_NO_ROWS = "{path}: holds no results yet (no complete row)"
_MISSING_COLUMNS = "{path}: lacks the column(s) {names}"
_REPEATED_COLUMNS = "{path}: names the column(s) {names} twice"
_WRONG_LENGTH = "{path}, line {line}: {got} values where the header names {expected} columns"
_BAD_VALUE = "{path}, line {line}: {column} is {value!r}, not {expected}"
_UPDATES = 20  # of a level in an episode, by default: folders without a manifest have had as many
_DUPLICATES = "results hold more than one row for {rows}; was a run folder given twice?"
_CUT_SHORT = "{path}: the last line has no line end, so it is incomplete; it is ignored"


class NoResults(ValueError):
    """A results.csv without a complete row, as before the first test period."""


def load(paths: str | Path | Sequence[str | Path]) -> pd.DataFrame:
    """Loads results: a row per (task, subgoal_layers, seed, period), sorted by these.

    Args:
      paths: a run folder, a results.csv, or several of either. Columns beyond the schema are kept.

    Raises:
      FileNotFoundError: no results.csv at a path.
      NoResults: a file has no complete row.
      ValueError: a file lacks columns or holds an impossible value, or two rows have the same task,
        agent, seed and period. An incomplete last line only warns.
    """
    if isinstance(paths, str | Path):
        paths = [paths]
    if not paths:
        raise ValueError("no run folder given")
    tables = [_load_file(results_file(path)) for path in paths]
    results = pd.concat(tables, ignore_index=True) if len(tables) > 1 else tables[0]
    _check_unique(results)
    return results.sort_values(list(schema.KEY), ignore_index=True)


def results_file(path: str | Path) -> Path:
    """The results.csv that `path` names: itself, or the one in that run folder."""
    path = Path(path)
    if path.is_dir():
        path = path / names.RESULTS
    if not path.is_file():
        raise FileNotFoundError(_MISSING_FILE.format(path=path))
    return path


def _load_file(path: Path) -> pd.DataFrame:
    # Line by line, which can say what is wrong with which, takes minutes for a million rows.
    with contextlib.suppress(ValueError):
        table = _read_plain(path)
        return _typed(table, table, path)
    return _load_lines(path)


def _load_lines(path: Path) -> pd.DataFrame:
    lines = read_lines(path)
    if lines.cut_short:
        warnings.warn(_CUT_SHORT.format(path=path), stacklevel=3)
    if not lines.rows:
        raise NoResults(_NO_ROWS.format(path=path))
    return to_table(lines, path)


def _read_plain(path: Path) -> pd.DataFrame:
    """A table of numbers and empty cells, but for the task: quickly, and nothing else.

    Raises:
      ValueError: there is something to say or to mend, which takes reading it line by line.
    """
    content = files.read_bytes(path, _MOST_BYTES)
    if not content.endswith(b"\n") or any(sign in content for sign in _UNUSUAL):
        raise ValueError(f"{path}: not plainly a table")
    head, body = content.split(b"\n", 1)
    del content
    columns = head.decode("utf-8").split(",")
    types = {name: "category" if name == "task" else "float64" for name in columns}
    _check_columns(columns, path)
    table = pd.concat([_parse(part, columns, types) for part in _parts(body)], ignore_index=True)
    return table.astype({"task": str})


def _parts(body: bytes) -> Iterator[bytes]:
    """Whole lines, of about `_PART` bytes together."""
    start = 0
    while start < len(body):
        end = body.find(b"\n", start + _PART) + 1 or len(body)
        yield body[start:end]
        start = end


def _parse(part: bytes, columns: list[str], types: dict[str, str]) -> pd.DataFrame:
    signs = np.frombuffer(part, np.uint8)
    ends = np.flatnonzero(signs == ord("\n"))
    commas = np.searchsorted(np.flatnonzero(signs == ord(",")), ends)
    if (np.diff(commas, prepend=0) != len(columns) - 1).any():  # pandas would fill up a short line
        raise ValueError("lines differ in length")
    return pd.read_csv(
        io.BytesIO(part),
        names=columns,
        dtype=types,
        index_col=False,
        keep_default_na=False,
        na_values=["", "nan"],
    )


class Lines(NamedTuple):
    """A results.csv as text, before any number is looked at."""

    columns: list[str]  # all of the core, others perhaps; none in an empty file
    rows: dict[int, list[str]]  # by line number, as long as the columns
    cut_short: bool  # the last line has no line end, so that it was cut in writing; it is left out


def read_lines(path: Path) -> Lines:
    """Reads a results.csv of this version or an earlier one, which had fewer diagnostics.

    Raises:
      ValueError: it is no such table; the message names the file, and the line of a damaged one.
    """
    try:
        text = files.read_text(path, _MOST_BYTES)
        # Even with all its commas, a cut line's last number may have lost digits.
        whole = text[: text.rfind("\n") + 1]
        reader = csv.reader(io.StringIO(whole), strict=True)
        columns = next(reader, [])
        numbered = [(reader.line_num, row) for row in reader if row]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path}: not a {names.RESULTS} ({error})") from error
    if columns:
        _check_columns(columns, path)
    for line, row in numbered:
        if len(row) != len(columns):
            raise ValueError(
                _WRONG_LENGTH.format(path=path, line=line, got=len(row), expected=len(columns))
            )
    return Lines(columns, dict(numbered), cut_short=whole != text)


def to_table(lines: Lines, path: Path) -> pd.DataFrame:
    """The rows as numbers.

    Args:
      path: theirs, for messages.

    Raises:
      ValueError: a value cannot be; the message names its line and column.
    """
    # The index holds line numbers until the values are checked, to name the line of a bad one.
    table = pd.DataFrame.from_dict(lines.rows, orient="index", columns=lines.columns, dtype=object)
    return _typed(_numbers(table, path), table, path)


def _check_columns(columns: Sequence[str], path: Path) -> None:
    repeated = sorted({name for name in columns if columns.count(name) > 1})
    if repeated:
        raise ValueError(_REPEATED_COLUMNS.format(path=path, names=", ".join(repeated)))
    missing = [name for name in schema.CORE_COLUMNS if name not in columns]
    if missing:
        raise ValueError(_MISSING_COLUMNS.format(path=path, names=", ".join(missing)))


def _numbers(written: pd.DataFrame, path: Path) -> pd.DataFrame:
    """Cells as numbers, but for columns of words; empty ones become NaN."""
    table, known = written.copy(), _KNOWN - {"task"}
    for column in written.columns:
        numbers = pd.to_numeric(written[column], errors="coerce").astype(float)
        unreadable = numbers.isna() & ~written[column].str.strip().str.lower().isin(["", "nan"])
        if column in known:
            _check(~unreadable, written[column], path, "a number")
        if column in known or not unreadable.any():
            table[column] = numbers
    return table


def _typed(table: pd.DataFrame, written: pd.DataFrame, path: Path) -> pd.DataFrame:
    """The table with all columns of this version, once no value is out of its range."""
    for column in [name for name in table.columns if name in _KNOWN and name != "task"]:
        _check_range(table[column], written[column], path)
    task = table["task"].astype(str)
    _check(task.str.strip() != "", written["task"], path, "a task's name")
    later = [name for name in schema.RESULTS_COLUMNS if name not in table]
    types = {**dict.fromkeys(schema.WHOLE_NUMBERS, "int64"), "task": str}
    table = table.astype(types).reset_index(drop=True)
    return table.reindex(columns=[*table.columns, *later]) if later else table


def _check_range(numbers: pd.Series, written: pd.Series, path: Path) -> None:
    if numbers.name in schema.WHOLE_NUMBERS:
        whole = (numbers >= 0) & (numbers < _LARGEST_WHOLE) & (np.floor(numbers) == numbers)
        _check(whole, written, path, "a whole number of at least 0")
    elif numbers.name == "success_rate":
        _check(numbers.between(0, 1), written, path, "a rate from 0 to 1")
    elif numbers.name in _SHARES:
        _check(numbers.between(0, 1) | numbers.isna(), written, path, "empty or a share of 1")


def _check(valid: pd.Series, written: pd.Series, path: Path, expected: str) -> None:
    if not valid.all():
        line = valid.index[~valid][0]
        message = _BAD_VALUE.format(
            path=path, line=line, column=written.name, value=written[line], expected=expected
        )
        raise ValueError(message)


def _check_unique(results: pd.DataFrame) -> None:
    doubled = results[results.duplicated(list(schema.KEY))]
    if len(doubled):
        rows = [
            f"{row.task}, {paper.agent_name(row.subgoal_layers)}, seed {row.seed}, "
            f"period {row.period}"
            for row in doubled.head(3).itertuples()
        ]
        more = f" and {len(doubled) - 3} more" if len(doubled) > 3 else ""
        raise ValueError(_DUPLICATES.format(rows="; ".join(rows) + more))


def read_manifest(folder: Path) -> tuple[dict[str, Any], str]:
    """A run folder's manifest, or {} and what is wrong: results are worth reading without one.

    Args:
      folder: the run folder, or its results.csv.
    """
    folder = folder.parent if folder.is_file() else folder
    try:
        manifest = json.loads(files.read_text(folder / names.MANIFEST))
    except FileNotFoundError:
        return {}, "No manifest.json here: the command is inferred from the results."
    except (OSError, RecursionError, ValueError) as error:
        return {}, f"manifest.json cannot be read: {error}"
    if not isinstance(manifest, dict):
        return {}, "manifest.json is not a run folder's manifest."
    return manifest, ""


def with_updates(results: pd.DataFrame, folder: Path) -> pd.DataFrame:
    """The results with a column `updates`: gradient steps of all levels of a seed so far.

    Args:
      results: of this run folder, whose manifest says how many a level makes in an episode.
    """
    config = read_manifest(folder)[0].get("config")
    config = config if isinstance(config, dict) else {}
    lowest, above = (
        config.get(name) for name in ("updates_per_episode", "upper_updates_per_episode")
    )
    lowest = lowest if isinstance(lowest, int) and lowest > 0 else _UPDATES
    above = above if isinstance(above, int) and above > 0 else lowest
    in_an_episode = lowest + above * results["subgoal_layers"]
    return results.assign(updates=results["train_episodes"] * in_an_episode)
