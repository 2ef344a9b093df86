"""Does hierarchy help on a task: 1 and 2 subgoal layers against the strongest flat agent."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy

from analysis.reading import paper
from analysis.statistics import areas, comparison
from analysis.statistics.seeds import bootstrap
from analysis.verdicts import evidence
from analysis.verdicts.evidence import LEAST_SEEDS, NOT_SUPPORTED, SUPPORTED, Evidence
from analysis.verdicts.speed_claims import Rival, strongest

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

_NO_GAIN = 1e-9  # a mean of areas that is not zero for its roundings only
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
      rivals: by key of `EQUAL`, the name of the strongest flat agent, which it is compared with.
      deciding: the difference in area at equal environment steps, judged.
      minutes: that at equal core-minutes, judged.
      evidence: all that was measured, the deciding difference first.
      seeds_needed: of each agent, to decide what is undecided; None where that cannot be said.
      least_seeds: fewer decide nothing, however large the difference.
      rising: whether either agent was still getting better when its training ended.
    """

    subgoal_layers: int
    rivals: Mapping[str, str]
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
            f"the success curve, against the flat agent{self._named()}, "
            f"{pairs} pair{'' if pairs == 1 else 's'} of seeds."
        )
        if self.says == UNDECIDED:
            text = f"{text} {self._what_it_takes()}"
        return f"{text} {_STILL_RISING}" if self.rising else text

    def _named(self) -> str:
        """Which flat agent, where there are several: the strongest at equal cost of each kind."""
        steps, minutes = self.rivals[areas.STEPS], self.rivals[areas.SECONDS]
        if steps == minutes:
            return f" ({steps})" if steps else ""
        return f" ({steps} at {EQUAL[areas.STEPS]}, {minutes} at {EQUAL[areas.SECONDS]})"

    def _what_it_takes(self) -> str:
        if self.seeds_needed is None:
            if self.deciding.seeds[0] >= self.least_seeds:
                return "The agents were equally good, so no number of seeds would decide it."
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
    own = areas.with_costs(results)
    others = {name: areas.with_costs(rows) for name, rows in flats.items()}
    found = {against: strongest(own, others, against) for against in EQUAL}
    layers = sorted(set(found[areas.STEPS].results["subgoal_layers"]))
    if layers[0] != 0 or len(layers) < 2:
        raise ValueError(_nothing(layers))
    late = strongest(own, others, score=_late)
    measured = [_measure(deep, found, late) for deep in layers[1:]]
    steps, minutes = (
        evidence.judge_gains([_at_equal(items, against) for items in measured])
        for against in (areas.STEPS, areas.SECONDS)
    )
    return [
        _verdict(deep, found, both, items, len(measured))
        for deep, both, items in zip(
            layers[1:], zip(steps, minutes, strict=True), measured, strict=True
        )
    ]


COST_HEADINGS = ("agents", *EQUAL.values())


def costs(verdicts: Sequence[Verdict]) -> list[tuple[str, ...]]:
    """The gains in area at equal amounts of each key of `EQUAL`, under `COST_HEADINGS`.

    Beside each is the flat agent that is the strongest there, where there are several.
    """
    return [
        (f"{own.subgoal_layers} against 0", *(_gain(own, against) for against in EQUAL))
        for own in verdicts
    ]


def _gain(verdict: Verdict, against: str) -> str:
    rival = verdict.rivals[against]
    gain = _at_equal(verdict.evidence, against).without_unit
    return f"{gain} ({rival})" if rival else gain


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


def _measure(deep: int, found: Mapping[str, Rival], late: Rival) -> list[Evidence]:
    """All differences of an agent; `late` is the flat agent that is the strongest at the end."""
    task = str(late.results["task"].iloc[0])
    measured = []
    for against, equal in EQUAL.items():
        agents = _agents(deep, found[against])
        new, old = pairs(found[against].results, deep, against)
        if not len(new):
            raise ValueError(
                f"no seed was trained with both {deep} and 0 subgoal layers, and agents are "
                "compared by seed"
            )
        measured.append(_difference(task, agents, _AREA.format(equal=equal), new - old))
        if against == areas.STEPS:
            improvement = comparison.probability_of_improvement
            measured.append(
                Evidence(
                    task, agents, _IMPROVEMENT.format(equal=equal), "share", (len(new),),
                    float(improvement(new, old)), *bootstrap([new, old], improvement),
                    comparison.rank_p(new, old),
                )
            )  # fmt: skip
    compared = _compared(late.results, deep, areas.EPISODES)
    new, old = (_late(rows, compared.budget) for rows in (compared.new, compared.old))
    final = _FINAL.format(periods=min(LATE_PERIODS, _last_period(compared)))
    return [*measured, _difference(task, _agents(deep, late), final, (new - old).to_numpy())]


def _agents(deep: int, rival: Rival) -> str:
    return f"{deep} against 0" + (f" ({rival.name})" if rival.name else "")


class _Compared(NamedTuple):
    """Results of the seeds that both agents have, and how far all of these were trained."""

    new: pd.DataFrame
    old: pd.DataFrame
    budget: float


def _compared(results: pd.DataFrame, deep: int, against: str) -> _Compared:
    new, old = (results[results["subgoal_layers"] == layers] for layers in (deep, 0))
    shared = set(new["seed"]) & set(old["seed"])
    new, old = (rows[rows["seed"].isin(shared)] for rows in (new, old))
    budget = areas.common_budget(pd.concat([new, old]), against) if shared else 0.0
    return _Compared(new, old, budget)


def pairs(results: pd.DataFrame, deep: int, against: str) -> tuple[np.ndarray, np.ndarray]:
    """Areas of agents with `deep` subgoal layers and without, [seeds that both have] each.

    Both are taken until the amount of `against` that all these seeds have behind them.
    """
    new, old, budget = _compared(results, deep, against)
    first, second = (areas.areas(rows, budget, against).to_numpy() for rows in (new, old))
    return first, second


def _difference(task: str, agents: str, quantity: str, gains: np.ndarray) -> Evidence:
    value = comparison.contrast([gains], (1,))
    p = comparison.sign_flip_p(gains)
    return Evidence(task, agents, quantity, "points", (len(gains),), *value, p)


def _late(results: pd.DataFrame, budget: float, against: str = areas.EPISODES) -> pd.Series:
    """By seed, the success of one agent over its last test periods until the budget."""
    own = results[(results["period"] > 0) & (results[against] <= budget)]
    late = own.sort_values("period").groupby("seed").tail(LATE_PERIODS)
    return late.groupby("seed")["success_rate"].mean()


def _last_period(compared: _Compared) -> int:
    within = compared.new[compared.new[areas.EPISODES] <= compared.budget]
    return int(within["period"].max())


def _at_equal(found: Sequence[Evidence], against: str) -> Evidence:
    """The difference in area at equal amounts of `against`."""
    return next(item for item in found if item.quantity == _AREA.format(equal=EQUAL[against]))


def _verdict(
    deep: int,
    found: Mapping[str, Rival],
    judged: tuple[Evidence, Evidence],
    measured: Sequence[Evidence],
    comparisons: int,
) -> Verdict:
    """`judged` are the differences in area at equal environment steps and core-minutes."""
    undecided = _says(judged[0]) == UNDECIDED
    results = found[areas.STEPS].results
    seen = pairs(results, deep, areas.STEPS)
    compared = _compared(results, deep, areas.EPISODES)
    return Verdict(
        deep,
        {against: rival.name for against, rival in found.items()},
        *judged,
        tuple(measured),
        seeds_needed(*seen, comparisons) if undecided else None,
        least_seeds(comparisons),
        rising=any(_rises(rows, compared.budget) for rows in (compared.new, compared.old)),
    )


def _rises(results: pd.DataFrame, budget: float) -> bool:
    """Whether an agent's mean success rose in the last test period until the budget."""
    within = results[results[areas.EPISODES] <= budget]
    means = within.groupby("period")["success_rate"].mean().to_numpy()
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
    if len(gains) < 3 or np.isclose(gains.mean(), 0, atol=_NO_GAIN):
        return None
    spread = gains.std(ddof=1) / abs(gains.mean())
    alpha = evidence.ALPHA / comparisons
    z = scipy.stats.norm.ppf(1 - alpha / 2) + scipy.stats.norm.ppf(POWER)
    return max(math.ceil((z * spread) ** 2), len(gains) + 1, least_seeds(comparisons))
