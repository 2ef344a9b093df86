"""Results of the depth study: the same motion, split into more decisions."""

import re
from pathlib import Path
from typing import Any

import pandas as pd

from analysis.reading.results import NoResults, load, read_manifest

STUDY = {"ur5_reacher": (200, 400, 800), "pick_place": (300, 600, 1200)}
"""By motion, the numbers of decisions that it is taken in; the suite's own comes first."""
GAINS = ((1, 0), (2, 1))
"""Agents compared, by subgoal layers: the first is to gain over the second."""
_NOTHING = (
    "{folder}: holds no results of {tasks}; `python -m analysis.depth --commands` prints the "
    "commands that train them; --data names their folder"
)
_CONFIGS = "{path}: has another configuration than {other} ({names}), so they cannot be compared"


def load_study(folder: Path, suite: Path | None = None) -> pd.DataFrame:
    """All results in `<folder>/<task>/`, with columns `motion` and `decisions`.

    Args:
      suite: holds the results of the suite's tasks, which are those of the fewest decisions: they
        are taken from there where `folder` lacks them.

    Raises:
      ValueError: there are none, some are of different configurations, or as
        `analysis.reading.results.load`.
    """
    found, configs = [], {}
    for path in sorted(Path(folder).glob("*/results.csv")):
        try:
            table = load(path.parent)
        except NoResults:
            continue
        places = [place(task) for task in table["task"]]
        if None in places:
            continue
        motions = pd.DataFrame(places, columns=["motion", "decisions"])
        found.append(pd.concat([table, motions], axis=1))
        configs[path] = read_manifest(path.parent)[0].get("config")
    there = {
        key for table in found for key in zip(table["motion"], table["decisions"], strict=True)
    }
    for motion in sorted({motion for motion, _ in there}) if suite else ():
        path, fewest = suite / motion / "results.csv", STUDY[motion][0]
        if (motion, fewest) not in there and path.is_file():
            own = {"task": f"depth-{motion}_{fewest}", "motion": motion, "decisions": fewest}
            found.append(load(path.parent).assign(**own))
            configs[path] = read_manifest(path.parent)[0].get("config")
    if not found:
        raise ValueError(_NOTHING.format(folder=folder, tasks=" or ".join(STUDY)))
    _check_same(configs)
    return pd.concat(found, ignore_index=True)


def place(task: str) -> tuple[str, int] | None:
    """Motion and decisions of a task of the study, such as depth-ur5_reacher_400."""
    named = re.fullmatch(r"(?:\w+-)?(\w+)_(\d+)", task)
    if named is None or int(named[2]) not in STUDY.get(named[1], ()):
        return None
    return named[1], int(named[2])


def _check_same(configs: dict[Path, dict[str, Any] | None]) -> None:
    known = [(path, config) for path, config in configs.items() if config is not None]
    for path, config in known[1:]:
        other, first = known[0]
        # A field that one lacks came later, and changes nothing by default.
        differ = [name for name in sorted({*first} & {*config}) if first[name] != config[name]]
        if differ:
            raise ValueError(
                _CONFIGS.format(path=path.parent, other=other.parent, names=", ".join(differ))
            )
