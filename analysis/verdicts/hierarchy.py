"""Does hierarchy help on a task: 1 and 2 subgoal layers against the strongest flat agent."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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
"""The chance that as many seeds as named would find a difference as large as was seen."""
EQUAL = {
    areas.STEPS: "equal environment steps",
    areas.SECONDS: "equal core-minutes",
    areas.UPDATES: "equal updates",
    areas.EPISODES: "equal training episodes",
}
"""What agents are given equal amounts of; the first decides."""
HELPS, HURTS, SMALL, UNDECIDED = "it helps", "it loses", "no gain that matters", "undecided"

RISING = 0.05
"""Success that rises by more than this from the test period before the last to the last."""
_STILL_RISING = "Success was still rising at the end, so longer training may change this."

_AREA = "difference in area under the success curve at {equal}"
_FINAL = "difference in success over the last {periods} test periods"
_IMPROVEMENT = "probability of improvement in area at {equal}"


@dataclass(frozen=True)
class Verdict:
    """The verdict of a task's results on one hierarchy.

    Attributes:
      subgoal_layers: of the agent that is judged.
      rival: the name of the flat agent that it was compared with.
      deciding: the difference in area at equal environment steps, judged.
      minutes: that at equal core-minutes, judged.
      evidence: all that was measured, the deciding difference first.
      seeds_needed: of each agent, to decide what is undecided; None where that cannot be said.
      least_seeds: fewer decide nothing, however large the difference.
      rising: whether either agent was still getting better when its training ended.
    """

    subgoal_layers: int
    rival: str
    deciding: Evidence
    minutes: Evidence
    evidence: tuple[Evidence, ...]
    seeds_needed: int | None
    least_seeds: int
    rising: bool

    @property
    def says(self) -> str:
        """`HELPS`, `HURTS`, `SMALL` or `UNDECIDED`, at equal environment steps."""
        return _says(self.deciding)

    @property
    def short(self) -> str:
        """As in "it helps at equal environment steps, it loses at equal core-minutes"."""
        steps, minutes = EQUAL[areas.STEPS], EQUAL[areas.SECONDS]
        if self.says == _says(self.minutes):
            return f"{self.says} at {steps} and at {minutes}"
        return f"{self.says} at {steps}, {_says(self.minutes)} at {minutes}"

    @property
    def sentence(self) -> str:
        """As in "1 subgoal layer: it helps at equal environment steps (a gain: +31.2 ...); ..."."""
        pairs = self.deciding.seeds[0]
        compared = (
            f"{_says(item)} at {EQUAL[against]} "
            f"({evidence.direction(item)}: {item.shown}, corrected p = {item.p_holm:.2g})"
            for against, item in ((areas.STEPS, self.deciding), (areas.SECONDS, self.minutes))
        )
        text = (
            f"{paper.agent_name(self.subgoal_layers)}: {'; '.join(compared)}. Points of area under "
            f"the success curve, against the flat agent{f' ({self.rival})' if self.rival else ''}, "
            f"{pairs} pair{'' if pairs == 1 else 's'} of seeds."
        )
        if self.says == UNDECIDED:
            text = f"{text} {self._what_it_takes()}"
        return f"{text} {_STILL_RISING}" if self.rising else text

    def _what_it_takes(self) -> str:
        if self.seeds_needed is None:
            return f"At least {self.least_seeds} seeds of each agent are needed to decide it."
        seen = evidence.direction(self.deciding).removeprefix("a ")
        return (
            f"If the true {seen} at {EQUAL[areas.STEPS]} is the one measured, about "
            f"{self.seeds_needed} seeds of each agent would decide it."
        )


def _says(item: Evidence) -> str:
    """The verdict on a judged difference in words."""
    if item.verdict == NOT_SUPPORTED and item.high < 0 and item.p_holm < evidence.ALPHA:
        return HURTS
    return {SUPPORTED: HELPS, NOT_SUPPORTED: SMALL}.get(item.verdict, UNDECIDED)


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
    complete = areas.with_costs(rival.results)
    layers = sorted(set(complete["subgoal_layers"]))
    if layers[0] != 0 or len(layers) < 2:
        raise ValueError(_nothing(layers))
    own = [_measure(task, complete, deep, rival) for deep in layers[1:]]
    steps, minutes = (
        evidence.judge_gains([_at_equal(items, against) for items in own])
        for against in (areas.STEPS, areas.SECONDS)
    )
    judged = zip(steps, minutes, strict=True)
    return [
        _verdict(deep, rival.name, both, items, complete, len(own))
        for deep, both, items in zip(layers[1:], judged, own, strict=True)
    ]


COST_HEADINGS = ("agents", *EQUAL.values())


def costs(verdicts: Sequence[Verdict]) -> list[tuple[str, ...]]:
    """The gains in area at equal amounts of each key of `EQUAL`, under `COST_HEADINGS`."""
    return [
        (own.deciding.agents, *(_at_equal(own.evidence, of).without_unit for of in EQUAL))
        for own in verdicts
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
                f"no seed was trained with both {deep} and 0 subgoal layers, and agents are "
                "compared by seed"
            )
        found.append(_difference(task, agents, _AREA.format(equal=equal), new - old))
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
    periods = min(LATE_PERIODS, results.loc[results["period"] > 0, "period"].nunique())
    final = _FINAL.format(periods=periods)
    return [*found, _difference(task, agents, final, late.dropna().to_numpy())]


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


def _difference(task: str, agents: str, quantity: str, gains: np.ndarray) -> Evidence:
    value = comparison.contrast([gains], (1,))
    p = comparison.sign_flip_p(gains)
    return Evidence(task, agents, quantity, "points", (len(gains),), *value, p)


def _late(results: pd.DataFrame, layers: int) -> pd.Series:
    """Success over the last test periods, by seed."""
    own = results[(results["subgoal_layers"] == layers) & (results["period"] > 0)]
    late = own.sort_values("period").groupby("seed").tail(LATE_PERIODS)
    return late.groupby("seed")["success_rate"].mean()


def _at_equal(found: Sequence[Evidence], against: str) -> Evidence:
    """The difference in area at equal amounts of `against`."""
    return next(item for item in found if item.quantity == _AREA.format(equal=EQUAL[against]))


def _verdict(
    deep: int,
    rival: str,
    judged: tuple[Evidence, Evidence],
    found: Sequence[Evidence],
    results: pd.DataFrame,
    comparisons: int,
) -> Verdict:
    """`judged` are the differences in area at equal environment steps and core-minutes."""
    undecided = _says(judged[0]) == UNDECIDED
    seen = pairs(results, deep, areas.STEPS)
    needed = seeds_needed(*seen, comparisons) if undecided else None
    return Verdict(
        deep,
        rival,
        *judged,
        tuple(found),
        needed,
        least_seeds(comparisons),
        rising=_rises(results, deep) or _rises(results, 0),
    )


def _rises(results: pd.DataFrame, layers: int) -> bool:
    """Whether an agent's mean success rose in its last test period."""
    own = results[results["subgoal_layers"] == layers]
    means = own.groupby("period")["success_rate"].mean().to_numpy()
    return bool(len(means) > 1 and means[-1] - means[-2] > RISING)


def least_seeds(comparisons: int) -> int:
    """Pairs of seeds below which no difference is found, even if every pair shows it.

    n pairs have 2^n patterns of signs, so that the two-sided p is at least 2 / 2^n; Holm's
    correction multiplies the least p by the number of comparisons.
    """
    patterns = 2 * comparisons / evidence.ALPHA
    return max(math.floor(math.log2(patterns)) + 1, LEAST_SEEDS)


def seeds_needed(new: np.ndarray, old: np.ndarray, comparisons: int = 1) -> int | None:
    """Pairs of seeds with which a difference as seen would be found with chance `POWER`.

    By the normal approximation of a paired test at `ALPHA` over the number of comparisons; None
    from fewer than 3 pairs, or where no difference was seen.
    """
    gains = new - old
    if len(gains) < 3 or not gains.mean():
        return None
    spread = gains.std(ddof=1) / abs(gains.mean())
    alpha = evidence.ALPHA / comparisons
    z = scipy.stats.norm.ppf(1 - alpha / 2) + scipy.stats.norm.ppf(POWER)
    return max(math.ceil((z * spread) ** 2), len(gains) + 1, least_seeds(comparisons))
