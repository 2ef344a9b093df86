"""Does hierarchy help on a task: 1 and 2 subgoal layers against the strongest flat agent."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import scipy

from analysis.reading import paper
from analysis.statistics import areas, comparison
from analysis.statistics.seeds import bootstrap
from analysis.verdicts import evidence
from analysis.verdicts.evidence import LEAST_SEEDS, NOT_SUPPORTED, SUPPORTED, Evidence
from analysis.verdicts.speed_claims import Rival, rivals

LATE_PERIODS = 3
POWER = 0.8
"""The chance that as many seeds as named would find a gain of the size that was seen."""
EQUAL = {
    areas.STEPS: "equal environment steps",
    areas.SECONDS: "equal core-minutes",
    areas.EPISODES: "equal training episodes",
}
"""What agents are given equal amounts of; the first decides."""
HELPS, HURTS, SMALL, UNDECIDED = "it helps", "it costs", "no gain worth the name", "undecided"

_AREA = "gain in area under the success curve at {equal}"
_FINAL = f"gain in success over the last {LATE_PERIODS} test periods"
_IMPROVEMENT = "probability of improvement in area at {equal}"


@dataclass(frozen=True)
class Verdict:
    """What a task's results say of one hierarchy.

    Attributes:
      subgoal_layers: of the agent that is judged.
      rival: what the flat agent is called that it was compared with.
      says: `HELPS`, `HURTS`, `SMALL` or `UNDECIDED`.
      deciding: the gain in area at equal environment steps, judged.
      evidence: all that was measured, the deciding gain first.
      seeds_needed: of each agent, to decide what is undecided; None where that cannot be said.
    """

    subgoal_layers: int
    rival: str
    says: str
    deciding: Evidence
    evidence: tuple[Evidence, ...]
    seeds_needed: int | None

    @property
    def sentence(self) -> str:
        """As in "1 subgoal layer: it helps. +31.2 [+25.0, +37.1] points of area ..."."""
        name = paper.agent_name(self.subgoal_layers)
        pairs = self.deciding.seeds[0]
        text = (
            f"{name}: {self.says}. {self.deciding.shown} of area under the success curve against "
            f"the flat agent{f' ({self.rival})' if self.rival else ''} at "
            f"{next(iter(EQUAL.values()))}, {pairs} pair{'' if pairs == 1 else 's'} of seeds, "
            f"p = {self.deciding.p_holm:.2g}."
        )
        if self.says == UNDECIDED:
            text += f" {self._what_it_takes()}"
        return text

    def _what_it_takes(self) -> str:
        if self.seeds_needed is None:
            return f"With {LEAST_SEEDS} seeds or more of each agent it can be judged."
        return f"If the gain is what was seen, about {self.seeds_needed} seeds of each would tell."


def judge(results: pd.DataFrame, flats: Mapping[str, pd.DataFrame]) -> list[Verdict]:
    """A verdict for each number of subgoal layers, least first.

    Args:
      results: of one task; of agents without subgoal layers and with some.
      flats: results of other agents without subgoal layers, by name.

    Raises:
      ValueError: there is nothing to compare: no flat agent, no hierarchy, or no seed of both.
    """
    task = str(results["task"].iloc[0])
    rival = rivals({task: results}, {name: {task: rows} for name, rows in flats.items()})[task]
    complete = areas.with_core_seconds(rival.results)
    layers = sorted(set(complete["subgoal_layers"]))
    if layers[0] != 0 or len(layers) < 2:
        raise ValueError(_nothing(layers))
    own = [_measure(task, complete, deep, rival) for deep in layers[1:]]
    judged = evidence.judge_gains([items[0] for items in own])
    return [
        _verdict(deep, rival.name, first, items[1:], complete)
        for deep, first, items in zip(layers[1:], judged, own, strict=True)
    ]


HEADINGS = ("agents", "quantity", "pairs of seeds", "value [95% interval]", "p")


def rows(verdicts: Sequence[Verdict]) -> list[tuple[str, str, int, str, str]]:
    """All that was measured, under `HEADINGS`."""
    return [
        (item.agents, item.quantity, item.seeds[0], item.shown, f"{item.p:.2g}")
        for verdict in verdicts
        for item in verdict.evidence
    ]


def _nothing(layers: Sequence[int]) -> str:
    has = " and ".join(map(paper.agent_name, layers))
    wanted = "an agent without subgoal layers" if layers[0] else "agents with subgoal layers"
    return (
        f"holds results of {has} only: the verdict compares hierarchies with a flat "
        f"agent; train {wanted} on the same task as well"
    )


def _measure(task: str, results: pd.DataFrame, deep: int, rival: Rival) -> list[Evidence]:
    agents = f"{deep} against 0" + (f" ({rival.name})" if rival.name else "")
    found = []
    for against, equal in EQUAL.items():
        new, old = pairs(results, deep, against)
        if not len(new):
            raise ValueError(
                f"no seed of {deep} and of 0 subgoal layers was trained: they are compared by seed"
            )
        found.append(_gain(task, agents, _AREA.format(equal=equal), new - old))
        if against == areas.STEPS:
            improvement = comparison.probability_of_improvement
            found.append(
                Evidence(
                    task, agents, _IMPROVEMENT.format(equal=equal), "share", (len(new),),
                    float(improvement(new, old)), *bootstrap([new, old], improvement),
                    comparison.rank_p(new, old),
                )
            )  # fmt: skip
    late = _late(results, deep) - _late(results, 0)
    return [*found, _gain(task, agents, _FINAL, late.dropna().to_numpy())]


def pairs(results: pd.DataFrame, deep: int, against: str) -> tuple[np.ndarray, np.ndarray]:
    """Areas of agents with `deep` subgoal layers and without, [seeds that both have] each.

    Both are taken until the amount of `against` that all these seeds have behind them.
    """
    both = results[results["subgoal_layers"].isin([0, deep])]
    budget = areas.common_budget(both, against)
    new, old = (
        areas.areas(both[both["subgoal_layers"] == layers], budget, against) for layers in (deep, 0)
    )
    shared = new.index.intersection(old.index)
    return new[shared].to_numpy(), old[shared].to_numpy()


def _gain(task: str, agents: str, quantity: str, gains: np.ndarray) -> Evidence:
    value = comparison.contrast([gains], (1,))
    p = comparison.sign_flip_p(gains)
    return Evidence(task, agents, quantity, "points", (len(gains),), *value, p)


def _late(results: pd.DataFrame, layers: int) -> pd.Series:
    """Success over the last test periods, by seed."""
    own = results[(results["subgoal_layers"] == layers) & (results["period"] > 0)]
    late = own.sort_values("period").groupby("seed").tail(LATE_PERIODS)
    return late.groupby("seed")["success_rate"].mean()


def _verdict(
    deep: int, rival: str, first: Evidence, others: Sequence[Evidence], results: pd.DataFrame
) -> Verdict:
    says = {SUPPORTED: HELPS, NOT_SUPPORTED: SMALL}.get(first.verdict, UNDECIDED)
    if first.verdict == NOT_SUPPORTED and first.high < 0 and first.p_holm < evidence.ALPHA:
        says = HURTS
    needed = seeds_needed(*pairs(results, deep, areas.STEPS)) if says == UNDECIDED else None
    shown = tuple(replace(item, verdict="") for item in others)
    return Verdict(deep, rival, says, first, (first, *shown), needed)


def seeds_needed(new: np.ndarray, old: np.ndarray) -> int | None:
    """Pairs of seeds with which a gain of the size seen would be found with chance `POWER`.

    By the normal approximation of a paired test at `ALPHA`; None from fewer than 3 pairs, or where
    no gain was seen.
    """
    gains = new - old
    if len(gains) < 3 or not gains.mean():
        return None
    spread = gains.std(ddof=1) / abs(gains.mean())
    z = scipy.stats.norm.ppf(1 - evidence.ALPHA / 2) + scipy.stats.norm.ppf(POWER)
    return max(math.ceil((z * spread) ** 2), len(gains) + 1, LEAST_SEEDS)
