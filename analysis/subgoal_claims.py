"""Claims of section 4.2 about where the top level of a trained agent puts its subgoals."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from analysis import comparison, evidence
from analysis.evidence import UNDECIDED, Claim, Evidence
from analysis.subgoals import COMMAND, load_subgoals, places

_LAYERS = 2
_FAR, _BEFORE, _AFTER = "far goals", "before attachment", "after attachment"
_OFTEN = (0.5, 1.0)
"""What happens often happens in more than half of the cases."""

_REACHER, _EFFECTOR = "ur5_reacher", ("effector_x", "effector_y", "effector_z")
_HALFWAY = (0.25, 0.75)

_PICK, _GRIPPER, _ROD = "pick_place", ("gripper_x", "gripper_z"), ("rod_x", "rod_z")
_TO_TOP = np.array([0.0, 0.125])
"""From the centre of a rod, 25 cm long and upright, to its top end, where the gripper takes it."""
NEAR = 0.25
"""Metres within which a subgoal is near the rod or the target: the rod's own length."""
_NEARER = 0.15  # metres, shown beside it: about twice a subgoal's threshold


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
    effector = {kind: _EFFECTOR for kind in ("subgoal", "start", "goal")}
    gripper = {"subgoal": _GRIPPER + _ROD, "start": _ROD, "goal": _ROD, "": ("attached",)}
    return [
        _judge("f", halfway, folder, _REACHER, effector, _far_subgoals, (_FAR,)),
        _judge("g", moves, folder, _PICK, gripper, _rod_subgoals, (_BEFORE, _AFTER)),
    ]


def _judge(
    letter: str,
    statement: str,
    folder: Path,
    task: str,
    points: Mapping[str, tuple[str, ...]],
    measure: Callable[[pd.DataFrame], list[Evidence]],
    parts: tuple[str, ...],
) -> Claim:
    own = Path(folder) / task
    command = COMMAND.format(task=task, folder=own)
    try:
        table = load_subgoals(own, task, points)
    except FileNotFoundError:
        reason = f"no data: {own} has no subgoals.csv; make it with `{command}`"
        return Claim(letter, statement, UNDECIDED, reason)
    table = table[(table["subgoal_layers"] == _LAYERS) & (table["level"] == _LAYERS)]
    items = measure(table) if len(table) else []
    judged = [item for item in items if item.verdict]
    if not judged:
        reason = f"no data: subgoals.csv has none of {_LAYERS} subgoal layers; `{command}`"
        return Claim(letter, statement, UNDECIDED, reason)
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
    return [
        _over_seeds(_REACHER, _named(_FAR), share, "share", far, halfway, np.mean, judge=True),
        _over_seeds(_REACHER, _named(_FAR), position, "ratio", far, along, np.median),
        _over_seeds(_REACHER, _named(_FAR), aside, "ratio", far, beside, np.median),
    ]


def _rod_subgoals(table: pd.DataFrame) -> list[Evidence]:
    before, after = (table[table["attached"] == held] for held in (0, 1))
    return [
        *_nearness(_named(_BEFORE), before, "rod", "start"),
        *_distance(_named(_BEFORE), before, "target", "goal"),
        *_nearness(_named(_AFTER), after, "target", "goal"),
        *_distance(_named(_AFTER), after, "rod", "start"),
    ]


def _nearness(agents: str, table: pd.DataFrame, place: str, kind: str) -> list[Evidence]:
    """Shares of the gripper's subgoals near the top of a rod, and how far they are from it."""
    apart = _gripper_to_top(table, kind)
    return [
        _over_seeds(
            _PICK, agents, f"subgoals within {100 * near:.0f} cm of the {place}", "share",
            table, apart <= near, np.mean, judge=near == NEAR,
        )
        for near in (NEAR, _NEARER) if len(table)
    ] + _distance(agents, table, place, kind)  # fmt: skip


def _distance(agents: str, table: pd.DataFrame, place: str, kind: str) -> list[Evidence]:
    if table.empty:
        return []
    quantity = f"median distance of subgoals from the {place}"
    apart = _gripper_to_top(table, kind)
    return [_over_seeds(_PICK, agents, quantity, "cm", table, apart, np.median)]


def _gripper_to_top(table: pd.DataFrame, kind: str) -> np.ndarray:
    """Metres from the gripper's subgoal to where the gripper would hold a rod, [rows]."""
    return np.linalg.norm(
        places(table, "subgoal", _GRIPPER) - places(table, kind, _ROD) - _TO_TOP, axis=-1
    )


def _over_seeds(
    task: str,
    agents: str,
    quantity: str,
    unit: str,
    table: pd.DataFrame,
    values: np.ndarray,
    summary: Callable[[np.ndarray], float],
    *,
    judge: bool = False,
) -> Evidence:
    """The mean over seeds of a summary of each seed's values, [rows of the table]."""
    grouped = pd.Series(values, dtype=float).groupby(table["seed"].to_numpy())
    seeds = grouped.agg(lambda own: summary(own.to_numpy())).to_numpy(dtype=float)
    mean = comparison.contrast([seeds], [1])
    item = Evidence(task, agents, quantity, unit, (len(seeds),), *mean)
    return evidence.judge_within(item, *_OFTEN) if judge else item
