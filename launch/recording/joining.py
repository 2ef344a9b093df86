"""Joins separately trained pieces of one experiment: other seeds or agents."""

import csv
import io
import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from analysis.program import CommandError
from analysis.reading import files, names
from launch.folder import manifest, results
from launch.folder.layout import RunFolder

Run = tuple[int, int]
"""Subgoal layers and seed."""

_OTHER_COLUMNS = "{path}: has other columns than the new records; publish everything again"


def join_results(published: Path, folder: RunFolder) -> set[Run]:
    """Puts a run folder's rows among the published ones, in the place of those of the same runs.

    Args:
      published: the published folder; its results.csv and manifest.json are replaced.

    Returns:
      The runs that were joined.

    Raises:
      CommandError: they are of another configuration than the published ones.
    """
    here = manifest.read(published / names.MANIFEST)
    own = manifest.read(folder.manifest)
    if here is None or own is None:
        raise CommandError(
            f"{published if here is None else folder.path}: has no {names.MANIFEST}, so nothing "
            "can be added to it; publish all of it again without --add"
        )
    manifest.check_same(published / names.MANIFEST, here, own)
    rows = results.read(folder.results)[0]
    runs = {_run(row) for row in rows}
    kept = [row for row in results.read(published / names.RESULTS)[0] if _run(row) not in runs]
    results.rewrite(published / names.RESULTS, sorted([*kept, *rows], key=_place))
    manifest.write(published / names.MANIFEST, manifest.joined(here, own))
    return runs


def _run(row: Mapping[str, Any]) -> Run:
    return int(row["subgoal_layers"]), int(row["seed"])


def _place(row: Mapping[str, Any]) -> tuple[Run, int]:
    return _run(row), int(row["period"])


class Records:
    """What was recorded of published policies, to be joined with records of others."""

    def __init__(self, published: Path) -> None:
        self._folder = published
        self._subgoals = _table(published / names.SUBGOALS)
        self._anatomy = _episodes(published / names.ANATOMY)

    def join(self, runs: Collection[Run]) -> None:
        """Puts what was there before among what has been recorded of these runs since.

        Raises:
          CommandError: it has other columns.
        """
        path = self._folder / names.SUBGOALS
        head, rows = _table(path)
        before, others = self._subgoals
        if others and before != head:
            raise CommandError(_OTHER_COLUMNS.format(path=path))
        place = [head.index(column) for column in ("subgoal_layers", "seed")]
        rows += [row for row in others if (int(row[place[0]]), int(row[place[1]])) not in runs]
        # One after another by run; within it in the order that they were recorded in.
        rows.sort(key=lambda row: (int(row[place[0]]), int(row[place[1]])))
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([head, *rows])
        files.write_text(path, text.getvalue())
        path = self._folder / names.ANATOMY
        described = json.loads(files.read_text(path))
        # An agent's episode that was chosen among other seeds of it is as good a one.
        kept = [own for own in self._anatomy if (own["subgoal_layers"], own["seed"]) not in runs]
        agents = {episode["subgoal_layers"] for episode in kept}
        new = [own for own in described["episodes"] if own["subgoal_layers"] not in agents]
        described["episodes"] = sorted([*kept, *new], key=lambda own: own["subgoal_layers"])
        files.write_text(path, json.dumps(described) + "\n")


def _table(path: Path) -> tuple[list[str], list[list[str]]]:
    """Head and rows; nothing where there is no file."""
    if not path.is_file():
        return [], []
    head, *rows = csv.reader(io.StringIO(files.read_text(path)))
    return head, rows


def _episodes(path: Path) -> list[dict[str, Any]]:
    return json.loads(files.read_text(path))["episodes"] if path.is_file() else []
