"""Judges the gains of an agent over a shallower one: where a second layer starts to pay."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from analysis.reading.depth import GAINS, STUDY, place
from analysis.statistics import comparison
from analysis.statistics.areas import areas
from analysis.verdicts import evidence
from analysis.verdicts.evidence import NOT_SUPPORTED, SUPPORTED, Evidence

_NO_SUCH_TEST = (
    "{folder}: no seed of {motion} was tested after {episodes} episodes, but after {all}"
)
_LAYERS = {1: "a first layer over none", 2: "a second layer over one"}
_PAYS, _COSTS, _UNDECIDED = "it pays", "it costs", "undecided"
_TOO_LITTLE = f"a gain of {evidence.MARGIN * 100:.0f} points or more is excluded"


def budgets(results: pd.DataFrame, episodes: int | None, folder: Path) -> dict[str, int]:
    """By motion, the episodes over which its agents are compared: as many as every task has.

    Those of a task are the most that one of its seeds has: seeds that lag behind are left out.

    Args:
      episodes: compares over as many instead.

    Raises:
      ValueError: no seed was tested then.
    """
    tested = results.groupby("motion")["train_episodes"].unique()
    if episodes is None:
        longest = results.groupby(["motion", "decisions"])["train_episodes"].max()
        return {motion: int(longest[motion].min()) for motion in tested.index}
    for motion, own in tested.items():
        if episodes not in own:
            after = ", ".join(str(number) for number in sorted(own) if number)
            raise ValueError(
                _NO_SUCH_TEST.format(folder=folder, motion=motion, episodes=episodes, all=after)
            )
    return dict.fromkeys(tested.index, episodes)


def paired_gains(results: pd.DataFrame, new: int, old: int, budget: int) -> np.ndarray:
    """[pairs] what seeds of agent `new` gain in area over the same seeds of agent `old`."""
    layers = results["subgoal_layers"]
    gains = areas(results[layers == new], budget) - areas(results[layers == old], budget)
    return gains.dropna().to_numpy()


def compare(results: pd.DataFrame, budget: dict[str, int]) -> list[Evidence]:
    """Every gain that there are pairs of seeds for, judged; those of a motion are one family.

    Returns:
      Evidence whose `task` is as in "ur5_reacher_400" and `agents` as in "2 over 1"; `p` is that
      of flipping the signs of the pairs' gains.
    """
    judged = []
    for motion, steps in STUDY.items():
        found = []
        for decisions in steps:
            own = results[(results["motion"] == motion) & (results["decisions"] == decisions)]
            for new, old in GAINS if len(own) else ():
                gains = paired_gains(own, new, old, budget[motion])
                if len(gains):
                    found.append(_gain(f"{motion}_{decisions}", f"{new} over {old}", gains))
        judged += evidence.judge_gains(found)
    return judged


def trend(results: pd.DataFrame, motion: str, budget: int) -> str | None:
    """A sentence: how a second layer's gain changes from the fewest decisions to the most.

    None where there is only one number of decisions with pairs of seeds.
    """
    own = results[results["motion"] == motion]
    measured = {n: paired_gains(own[own["decisions"] == n], 2, 1, budget) for n in STUDY[motion]}
    found = [decisions for decisions, gains in measured.items() if len(gains)]
    if len(found) < 2:
        return None
    few, many = measured[found[0]], measured[found[-1]]
    change = Evidence(
        motion, "2 over 1", "change of gain", "points", (len(few), len(many)),
        *comparison.contrast([many, few], (1, -1)), comparison.permutation_p(many, few),
    )  # fmt: skip
    return (
        f"{motion}: from {found[0]} to {found[-1]} decisions, a second layer's gain changes by "
        f"{change.shown} (p = {change.p:.2g})."
    )


def _gain(task: str, agents: str, gains: np.ndarray) -> Evidence:
    value = comparison.contrast([gains], (1,))
    p = comparison.sign_flip_p(gains)
    return Evidence(task, agents, "gain in area", "points", (len(gains),), *value, p)


def as_table(gains: Sequence[Evidence], budget: dict[str, int]) -> pd.DataFrame:
    """What the figure's last column shows, a row for each gain; shares of the area, not points."""
    rows = []
    for item in gains:
        found = place(item.task)
        assert found is not None  # `compare` made it
        rows.append(
            {
                "motion": found[0], "decisions": found[1], "agents": item.agents,
                "pairs": item.seeds[0], "episodes": budget[found[0]],
                "gain": item.value, "low": item.low, "high": item.high,
                "p": item.p, "p_holm": item.p_holm, "verdict": _verdict(item),
            }
        )  # fmt: skip
    return pd.DataFrame(rows)


def _verdict(item: Evidence) -> str:
    if item.verdict == NOT_SUPPORTED:
        return _COSTS if evidence.loses(item) else _TOO_LITTLE
    return _PAYS if item.verdict == SUPPORTED else _UNDECIDED


def sentences(gains: Sequence[Evidence], budget: dict[str, int]) -> list[str]:
    """A sentence for each number of decisions and pair of agents, and one for each motion."""
    table, said = as_table(gains, budget), []
    for item, row in zip(gains, table.itertuples(), strict=True):
        pairs = f"{row.pairs} pair{'' if row.pairs == 1 else 's'} of seeds"
        said.append(
            f"{row.motion} in {row.decisions} decisions: {_LAYERS[int(row.agents[0])]}, "
            f"{evidence.direction(item)}: {item.shown} of area over {row.episodes} episodes "
            f"({pairs}, p = {row.p_holm:.2g} after Holm): {row.verdict}."
        )
    return said + [_answer(motion, own) for motion, own in table.groupby("motion", sort=False)]


def _answer(motion: str, table: pd.DataFrame) -> str:
    """From how many decisions on the second layer pays."""
    second = table[table["agents"] == "2 over 1"].sort_values("decisions")
    absent = [str(n) for n in STUDY[motion] if n not in set(second["decisions"])]
    lacking = f" Not measured: {', '.join(absent)}." if absent else ""
    if second.empty:
        return f"{motion}: no runs of a second layer to compare yet."
    start = None
    for row in second.iloc[::-1].itertuples():
        if row.verdict != _PAYS:
            break
        start = row.decisions
    if start is None:
        most = second["decisions"].max()
        return f"{motion}: a second layer is not shown to pay in {most} decisions.{lacking}"
    return f"{motion}: a second layer pays from {start} decisions on, of those measured.{lacking}"
