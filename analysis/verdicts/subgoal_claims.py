"""Claims of section 4.2 about where trained agents put their high-level subgoals."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from analysis.reading import names
from analysis.reading.subgoals import load_subgoals, places, recording_command
from analysis.statistics import comparison
from analysis.verdicts import evidence
from analysis.verdicts.evidence import UNDECIDED, Claim, Evidence

_LAYERS = 2
_FAR, _BEFORE, _AFTER = "far goals", "before attachment", "after attachment"
_OFTEN = (0.5, 1.0)
"""What happens often happens in more than half of the cases."""

_REACHER, _EFFECTOR = "ur5_reacher", ("effector_x", "effector_y", "effector_z")
_HALFWAY = (0.25, 0.75)

_PICK, _GRIPPER, _ROD = "pick_place", ("gripper_x", "gripper_z"), ("rod_x", "rod_z")
_POINTS: dict[str, dict[str, tuple[str, ...]]] = {
    _REACHER: {"subgoal": _EFFECTOR, "start": _EFFECTOR, "goal": _EFFECTOR},
    _PICK: {"subgoal": _GRIPPER, "start": _ROD, "goal": _ROD, "": ("attached",)},
}
_TO_TOP = np.array([0.0, 0.125])
"""From the centre of a rod, 25 cm long and upright, to its top end, where the gripper takes it."""
NEAR = 0.25
"""Metres within which a subgoal is near the rod or the target: the rod's own length."""
_NEARER = 0.15  # metres, shown beside it: about twice a subgoal's threshold
_WITHIN = "subgoals within {:.0f} cm of the {}"


def judge_subgoals(folder: Path) -> list[Claim]:
    """Claims (f) and (g), from `<folder>/<task>/subgoals.csv`; undecided where there is none.

    Raises:
      ValueError: such a file is damaged.
    """
    halfway = (
        "For a far goal of the UR5, the high-level subgoal of an agent with 2 subgoal layers often "
        "lies about halfway."
    )
    moves = (
        "In pick-and-place, the high-level subgoal is often near the rod before it is attached, "
        "and near the target after."
    )
    return [
        _judge("f", halfway, folder, _REACHER, _far_subgoals, (_FAR,)),
        _judge("g", moves, folder, _PICK, _rod_subgoals, (_BEFORE, _AFTER)),
    ]


def high_level(folder: Path, task: str) -> pd.DataFrame | None:
    """The high-level subgoals of a task's agents with 2 subgoal layers; None if there are none.

    Raises:
      ValueError: subgoals.csv is damaged.
    """
    try:
        table = load_subgoals(Path(folder) / task, task, _POINTS[task])
    except FileNotFoundError:
        return None
    own = table[(table["subgoal_layers"] == _LAYERS) & (table["level"] == _LAYERS)]
    return own if len(own) else None


def _judge(
    letter: str,
    statement: str,
    folder: Path,
    task: str,
    measure: Callable[[pd.DataFrame], list[Evidence]],
    parts: tuple[str, ...],
) -> Claim:
    table = high_level(folder, task)
    if table is None:
        reason = (
            f"no data: no {names.SUBGOALS} with any of {_LAYERS} subgoal layers; make it with "
            f"`{recording_command(task, Path(folder) / task)}`"
        )
        return Claim(letter, statement, UNDECIDED, reason)
    items = measure(table)
    judged = [item for item in items if item.verdict]
    absent = [when for when in parts if not any(when in item.agents for item in judged)]
    verdict = evidence.overall((item.verdict for item in judged), absent)
    weakest = min(judged, key=lambda item: item.value)
    return Claim(letter, statement, verdict, evidence.count(judged, absent), weakest, tuple(items))


def _named(when: str) -> str:
    return f"{_LAYERS}, {when}"


def relative_position(table: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Where subgoals lie on the way from the effector to the goal, [rows] each.

    Returns:
      The position along the straight line (0: at the effector, 1: at the goal) and the distance
      from that line, both as shares of its length.
    """
    start, goal, subgoal = (places(table, k, _EFFECTOR) for k in ("start", "goal", "subgoal"))
    way, ahead = goal - start, subgoal - start
    length = np.linalg.norm(way, axis=-1)
    along = (ahead * way).sum(axis=-1) / length**2
    beside = np.linalg.norm(ahead - along[:, None] * way, axis=-1) / length
    return along, beside


def far_goals(table: pd.DataFrame) -> pd.DataFrame:
    """First subgoals of episodes whose goal is at least as far away as in half of them."""
    first = table[table["step"] == 0]
    apart = places(first, "goal", _EFFECTOR) - places(first, "start", _EFFECTOR)
    distance = np.linalg.norm(apart, axis=-1)
    return first[distance >= np.median(distance)]


def _far_subgoals(table: pd.DataFrame) -> list[Evidence]:
    far = far_goals(table)
    along, beside = relative_position(far)
    halfway = (along >= _HALFWAY[0]) & (along <= _HALFWAY[1])
    share = "subgoals from a quarter to three quarters of the way"
    position = "median position (0: effector, 1: goal)"
    aside = "median distance from the straight line / its length"
    is_halfway = _over_seeds(_Quantity(_REACHER, _FAR, share, "share", np.mean), far, halfway)
    return [
        evidence.judge_within(is_halfway, *_OFTEN),
        _over_seeds(_Quantity(_REACHER, _FAR, position, "ratio", np.median), far, along),
        _over_seeds(_Quantity(_REACHER, _FAR, aside, "ratio", np.median), far, beside),
    ]


def to_rod_and_target(table: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Metres from the gripper's subgoals to where it would hold the rod, and at the target."""
    gripper = places(table, "subgoal", _GRIPPER)
    tops = (places(table, kind, _ROD) + _TO_TOP for kind in ("start", "goal"))
    rod, target = (np.linalg.norm(gripper - top, axis=-1) for top in tops)
    return rod, target


def _rod_subgoals(table: pd.DataFrame) -> list[Evidence]:
    before, after = (table[table["attached"] == held] for held in (0, 1))
    items = []
    if len(before):
        rod, target = to_rod_and_target(before)
        items += _nearness(_BEFORE, before, "rod", rod) + _distance(
            _BEFORE, before, "target", target
        )
    if len(after):
        rod, target = to_rod_and_target(after)
        items += _nearness(_AFTER, after, "target", target) + _distance(_AFTER, after, "rod", rod)
    return items


def _nearness(when: str, table: pd.DataFrame, place: str, apart: np.ndarray) -> list[Evidence]:
    """Shares of the subgoals near a place, and how far they are from it."""
    near, nearer = (
        _over_seeds(
            _Quantity(_PICK, when, _WITHIN.format(100 * limit, place), "share", np.mean),
            table,
            apart <= limit,
        )
        for limit in (NEAR, _NEARER)
    )
    judged = evidence.judge_within(near, *_OFTEN)
    return [judged, nearer, *_distance(when, table, place, apart)]


def _distance(when: str, table: pd.DataFrame, place: str, apart: np.ndarray) -> list[Evidence]:
    name = f"median distance of subgoals from the {place}"
    return [_over_seeds(_Quantity(_PICK, when, name, "cm", np.median), table, apart)]


class _Quantity(NamedTuple):
    """What is measured of each seed's subgoals."""

    task: str
    when: str  # of which subgoals
    name: str
    unit: str
    summary: Callable[[np.ndarray], float]  # of a seed's values


def _over_seeds(quantity: _Quantity, table: pd.DataFrame, values: np.ndarray) -> Evidence:
    """The mean over seeds of the summary of each seed's values, [rows of the table]."""
    task, when, name, unit, summary = quantity
    grouped = pd.Series(values, dtype=float).groupby(table["seed"].to_numpy())
    seeds = grouped.agg(lambda own: summary(own.to_numpy())).to_numpy(dtype=float)
    mean = comparison.contrast([seeds], [1])
    return Evidence(task, _named(when), name, unit, (len(seeds),), *mean)
