"""Does hierarchy help on a task: 1 and 2 subgoal layers against the strongest flat agent."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import scipy

from analysis.reading import paper
from analysis.statistics import areas, comparison
from analysis.statistics.seeds import bootstrap
from analysis.verdicts import evidence
from analysis.verdicts.evidence import LEAST_SEEDS, NOT_SUPPORTED, SUPPORTED, Evidence
from analysis.verdicts.rivals import (
    LEARNT,
    LEAST_TESTS,
    Comparison,
    NothingToCompareError,
    Rival,
    strongest,
)

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
_FEW_TESTS = (
    "At {equal} an agent was tested fewer than {least} times, too seldom to decide: test more "
    "often (--config.episodes_per_period)."
)
_NOT_LEARNT = (
    "Neither agent's mean success rose by more than {points:.0f} points, so there is nothing to "
    "compare: train for longer, or see the advice of launch/fit.py."
)
_CUT = "Areas end after {episodes:.0f} of {longest:.0f} episodes, where a seed ended."

_AREA = "difference in area under the success curve at {equal}"
_SUCCESS = "difference in success at {equal}"
_FINAL = "difference in success over the last {periods} test periods"
_IMPROVEMENT = "probability of improvement in area at {equal}"


@dataclass(frozen=True)
class Verdict:
    """The verdict of a task's results on one hierarchy.

    Attributes:
      subgoal_layers: of the agent that is judged.
      compared: by key of `EQUAL`, what was compared.
      deciding: the difference in area at equal environment steps, judged.
      minutes: that at equal core-minutes, judged.
      evidence: all that was measured, the deciding difference first.
      seeds_needed: of each agent, to decide what is undecided; None where that cannot be said.
      least_seeds: fewer decide nothing, however large the difference.
      rising: whether either agent was still getting better when its training ended.
    """

    subgoal_layers: int
    compared: Mapping[str, Comparison]
    deciding: Evidence
    minutes: Evidence
    evidence: tuple[Evidence, ...]
    seeds_needed: int | None
    least_seeds: int
    rising: bool

    @property
    def rivals(self) -> dict[str, str]:
        """By key of `EQUAL`, the name of the strongest flat agent, which it is compared with."""
        return {against: one.rival for against, one in self.compared.items()}

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
        return " ".join([text, *self._remarks()])

    def _remarks(self) -> Iterator[str]:
        few = [key for key in (areas.STEPS, areas.SECONDS) if self.compared[key].is_guess()]
        learnt = self.compared[areas.EPISODES].learnt()
        if not learnt:
            yield _NOT_LEARNT.format(points=100 * LEARNT)
        elif few:
            equal = " and at ".join(EQUAL[key] for key in few)
            yield _FEW_TESTS.format(equal=equal, least=LEAST_TESTS)
        if learnt and self.says == UNDECIDED and areas.STEPS not in few:
            yield self._what_it_takes()
        if self.rising:
            yield _STILL_RISING
        episodes = self.compared[areas.EPISODES]
        longest = max(one[areas.EPISODES].max() for one in (episodes.new, episodes.old))
        if episodes.budget < longest:
            yield _CUT.format(episodes=episodes.budget, longest=longest)

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
    if evidence.loses(item):
        return HURTS
    return {SUPPORTED: HELPS, NOT_SUPPORTED: SMALL}.get(item.verdict, UNDECIDED)


def judge(results: pd.DataFrame, flats: Mapping[str, pd.DataFrame]) -> list[Verdict]:
    """A verdict for each number of subgoal layers, least first.

    Args:
      results: of one task; of agents without subgoal layers and with some.
      flats: results of other agents without subgoal layers, by name.

    Raises:
      NothingToCompareError: there is no flat agent, no hierarchy, or no seed of both.
    """
    own = areas.with_costs(results)
    others = {name: areas.with_costs(rows) for name, rows in flats.items()}
    found = {against: strongest(own, others, against) for against in EQUAL}
    layers = sorted(set(found[areas.STEPS].results["subgoal_layers"]))
    if layers[0] != 0 or len(layers) < 2:
        raise NothingToCompareError(_nothing(layers))
    late = strongest(own, others, score=_late)
    compared = {
        deep: {against: Comparison.of(rival, deep, against) for against, rival in found.items()}
        for deep in layers[1:]
    }
    measured = {deep: _measure(own, late) for deep, own in compared.items()}
    steps, minutes = (_judged(compared, measured, key) for key in (areas.STEPS, areas.SECONDS))
    return [
        _verdict(deep, compared[deep], (steps[deep], minutes[deep]), measured[deep], len(compared))
        for deep in compared
    ]


def _judged(
    compared: Mapping[int, Mapping[str, Comparison]],
    measured: Mapping[int, Sequence[Evidence]],
    against: str,
) -> dict[int, Evidence]:
    """By hierarchy, its difference in area at equal amounts of `against`, judged."""
    items = evidence.judge_gains([_at_equal(own, against) for own in measured.values()])
    judged = {}
    for (deep, own), item in zip(compared.items(), items, strict=True):
        one = own[against]
        decides = one.learnt() and not one.is_guess()
        judged[deep] = item if decides else replace(item, verdict=evidence.UNDECIDED)
    return judged


COST_HEADINGS = ("agents", *EQUAL.values())
CERTAIN = "*"
"""Marks a gain in area that has its sign however success went between the tests."""


def costs(verdicts: Sequence[Verdict]) -> list[tuple[str, ...]]:
    """The gains in area at equal amounts of each key of `EQUAL`, under `COST_HEADINGS`.

    Beside each is the flat agent that is the strongest there, where there are several.
    """
    return [
        (f"{own.subgoal_layers} against 0", *(_gain(own, against) for against in EQUAL))
        for own in verdicts
    ]


def _gain(verdict: Verdict, against: str) -> str:
    one = verdict.compared[against]
    gain = _at_equal(verdict.evidence, against).without_unit
    certain = CERTAIN if one.is_certain() else ""
    return f"{gain}{certain} ({one.rival})" if one.rival else f"{gain}{certain}"


def ends(verdicts: Sequence[Verdict]) -> list[tuple[str, ...]]:
    """The gains in success when those amounts are spent, under `COST_HEADINGS`.

    Beside each is the share of its training that the hierarchy has done by then.
    """
    return [
        (f"{own.subgoal_layers} against 0", *(_end(own, against) for against in EQUAL))
        for own in verdicts
    ]


def _end(verdict: Verdict, against: str) -> str:
    gain = _at_equal(verdict.evidence, against, _SUCCESS).without_unit
    return f"{gain} at {verdict.compared[against].trained():.0%}"


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


def _measure(compared: Mapping[str, Comparison], late: Rival) -> list[Evidence]:
    """All differences of a hierarchy; `late` is the flat agent that is the strongest at the end."""
    measured = []
    for against, equal in EQUAL.items():
        one = compared[against]
        new, old = one.area_pairs()
        measured.append(_difference(one, _AREA.format(equal=equal), new - old))
        if against == areas.STEPS:
            improvement = comparison.probability_of_improvement
            measured.append(
                Evidence(
                    _task(one), _agents(one), _IMPROVEMENT.format(equal=equal), "share",
                    (len(new),), float(improvement(new, old)), *bootstrap([new, old], improvement),
                    comparison.rank_p(new, old),
                )
            )  # fmt: skip
        measured.append(_difference(one, _SUCCESS.format(equal=equal), one.success_gains()))
    deep = int(compared[areas.EPISODES].new["subgoal_layers"].iloc[0])
    last = Comparison.of(late, deep, areas.EPISODES)
    new, old = (_late(rows, last.budget) for rows in (last.new, last.old))
    final = _FINAL.format(periods=min(LATE_PERIODS, _last_period(last)))
    return [*measured, _difference(last, final, (new - old).to_numpy())]


def _task(one: Comparison) -> str:
    return str(one.new["task"].iloc[0])


def _agents(one: Comparison) -> str:
    deep = one.new["subgoal_layers"].iloc[0]
    return f"{deep} against 0" + (f" ({one.rival})" if one.rival else "")


def _difference(one: Comparison, quantity: str, gains: np.ndarray) -> Evidence:
    value = comparison.contrast([gains], (1,))
    p = comparison.sign_flip_p(gains)
    return Evidence(_task(one), _agents(one), quantity, "points", (len(gains),), *value, p)


def _late(results: pd.DataFrame, budget: float, against: str = areas.EPISODES) -> pd.Series:
    """By seed, the success of one agent over its last test periods until the budget."""
    own = results[(results["period"] > 0) & (results[against] <= budget)]
    late = own.sort_values("period").groupby("seed").tail(LATE_PERIODS)
    return late.groupby("seed")["success_rate"].mean()


def _last_period(compared: Comparison) -> int:
    within = compared.new[compared.new[areas.EPISODES] <= compared.budget]
    return int(within["period"].max())


def _at_equal(found: Sequence[Evidence], against: str, quantity: str = _AREA) -> Evidence:
    """The difference in area, or in another quantity, at equal amounts of `against`."""
    return next(item for item in found if item.quantity == quantity.format(equal=EQUAL[against]))


def _verdict(
    deep: int,
    compared: Mapping[str, Comparison],
    judged: tuple[Evidence, Evidence],
    measured: Sequence[Evidence],
    comparisons: int,
) -> Verdict:
    """`judged` are the differences in area at equal environment steps and core-minutes."""
    undecided = _says(judged[0]) == UNDECIDED
    end = compared[areas.EPISODES]
    return Verdict(
        deep,
        compared,
        *judged,
        tuple(measured),
        seeds_needed(*compared[areas.STEPS].area_pairs(), comparisons) if undecided else None,
        least_seeds(comparisons),
        rising=any(_rises(rows, end.budget) for rows in (end.new, end.old)),
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
