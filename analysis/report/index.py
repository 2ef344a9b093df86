"""One page about all run folders in a folder: results, progress, and what is running.

Run as `python -m analysis.report.index runs`.
"""

import sys
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pandas as pd

from analysis import program
from analysis.reading import names, paper
from analysis.reading.files import write_text
from analysis.reading.results import load
from analysis.report.page import render
from analysis.statistics.seeds import last_rows

INDEX = "index.html"

_HELP = """Writes index.html, an overview of all run folders in a folder.

  python -m analysis.report.index runs

`launch/run.py` also writes it, repeatedly while it trains.

Flags:
{flags}

Exit status: 0; 2 the folder holds no run folder, or the command was wrong."""


def write_index(
    folder: Path,
    at_work: Collection[str] = (),
    *,
    title: str | None = None,
    links: Mapping[str, str] = MappingProxyType({}),
) -> Path:
    """Writes index.html into a folder of run folders and returns its path.

    A run folder whose results are damaged or not there yet is listed with the reason.

    Args:
      at_work: names of the run folders in which training is running; the page then reloads itself.
      title: the page's, if not the folder's name.
      links: other pages to lead to, relative to this one, by what they are called.

    Raises:
      ValueError: the folder holds no run folder.
    """
    folder = Path(folder)
    found = sorted({path.parent for path in folder.glob(f"*/{names.MANIFEST}")}
                   | {path.parent for path in folder.glob(f"*/{names.RESULTS}")})  # fmt: skip
    if not found:
        raise ValueError(f"{folder}: holds no run folder; give one such as runs")
    runs = [_run(path, path.name in at_work) for path in found]
    count = f"{len(runs)} run folder{'' if len(runs) == 1 else 's'}"
    document = render(
        "index.html",
        title=title or f"Runs in {folder.resolve().name}",
        links=links,
        headline=f"{count}, {len(at_work)} running." if at_work else f"{count}.",
        running=[run["progress"] for run in runs if run["progress"]],
        runs=runs,
    )
    write_text(folder / INDEX, document)
    return folder / INDEX


def _run(path: Path, at_work: bool) -> dict[str, Any]:
    """What the page shows of a run folder, with paths relative to the page."""
    shown: dict[str, Any] = {"name": path.name, "folder": path.name, "rows": [], "lacking": ""}
    for key, file in (("report", names.REPORT), ("figure", names.FIGURE)):
        shown[key] = f"{path.name}/{file}" if (path / file).is_file() else ""
    shown["progress"] = f"{path.name}: no test yet" if at_work else ""
    try:
        results = load(path)
    except (FileNotFoundError, ValueError) as error:
        return {**shown, "lacking": str(error)}
    tasks = list(dict.fromkeys(results["task"]))
    shown["name"] = " and ".join(map(paper.title, tasks))
    shown["rows"] = [_agent(int(k), own) for k, own in results.groupby("subgoal_layers")]
    if at_work:
        done = "; ".join(f"{row[0]} after {row[2]} episodes" for row in shown["rows"])
        shown["progress"] = f"{shown['name']}: {done}"
    return shown


def _agent(layers: int, results: pd.DataFrame) -> tuple[str, str, str, str]:
    """An agent, its seeds, the episodes they have behind them, and their mean success then."""
    last = last_rows(results)
    least, most = last["train_episodes"].min(), last["train_episodes"].max()
    episodes = f"{least}" if least == most else f"{least} to {most}"
    success = f"{last['success_rate'].mean():.0%}"
    return paper.agent_name(layers), str(len(last)), episodes, success


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    return program.over_a_folder(_HELP, argv, lambda folder: print(write_index(folder)))


if __name__ == "__main__":
    sys.exit(main(sys.argv))
