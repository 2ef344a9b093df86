"""The evidence for claims: measured quantities with intervals, and the rules that judge them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from math import isnan, nan
from typing import NamedTuple

from analysis.statistics import comparison

SUPPORTED = "supported"
NOT_SUPPORTED = "not supported"
UNDECIDED = "undecided"

ALPHA = 0.05
LEAST_SEEDS = 5
"""Fewer seeds per agent decide nothing."""
MARGIN = 0.05
"""A gain whose interval ends below five points is too small to be called one."""


class _Form(NamedTuple):
    scale: float
    number: str
    suffix: str


_FORMS = {
    "points": _Form(100, "{:+.1f}", " points"),
    "share": _Form(100, "{:.0f}%", ""),
    "episodes": _Form(1, "{:+.0f}", " episodes"),
    "ratio": _Form(1, "{:.2f}", ""),
    "cm": _Form(100, "{:.0f}", " cm"),
}
"""How values of each unit are shown; files hold fractions of 1, episodes or metres, unrounded."""


@dataclass(frozen=True)
class Evidence:
    """One measured quantity. `seeds` are those of each agent; `low`, `high` its 95% interval.

    `verdict` is empty for a quantity that is only shown. `p` is of no difference; `p_holm` is it
    after Holm's correction over all quantities of the claim that have a verdict.
    """

    task: str
    agents: str
    quantity: str
    unit: str
    seeds: tuple[int, ...]
    value: float
    low: float
    high: float
    p: float = nan
    p_holm: float = nan
    verdict: str = ""

    @property
    def shown(self) -> str:
        """As in "+41.0 [+33.1, +48.2] points"."""
        return f"{self.without_unit}{_FORMS[self.unit].suffix}"

    @property
    def without_unit(self) -> str:
        """As in "+41.0 [+33.1, +48.2]"."""
        form = _FORMS[self.unit]
        value, low, high = (
            form.number.format(form.scale * number) for number in (self.value, self.low, self.high)
        )
        interval = "(no interval)" if isnan(self.low) else f"[{low}, {high}]"
        return f"{value} {interval}"


@dataclass(frozen=True)
class Claim:
    """A claim of the paper, our verdict on it, and the evidence."""

    letter: str
    statement: str
    verdict: str
    reason: str
    headline: Evidence | None = None
    evidence: tuple[Evidence, ...] = field(default=())


def direction(item: Evidence) -> str:
    """What a difference is called, whether it is sure or not."""
    return "a gain" if item.value > 0 else "a loss" if item.value < 0 else "no difference"


def judge_gain(item: Evidence) -> Evidence:
    """Judges an improvement: there, too small to be one, or undecided."""
    if min(item.seeds) < LEAST_SEEDS:
        return replace(item, verdict=UNDECIDED)
    if item.high < MARGIN:  # too small to be called one, however sure
        return replace(item, verdict=NOT_SUPPORTED)
    surely = item.p_holm < ALPHA and item.value > 0
    return replace(item, verdict=SUPPORTED if surely else UNDECIDED)


def loses(item: Evidence) -> bool:
    """Whether a judged gain is surely a loss, and not one that is too small to matter."""
    surely = item.p_holm < ALPHA and item.high < 0
    return item.verdict == NOT_SUPPORTED and surely and item.low < -MARGIN


def judge_gains(items: Sequence[Evidence]) -> list[Evidence]:
    """A claim's comparisons, corrected for each other by Holm and judged as gains."""
    adjusted = comparison.holm([item.p for item in items])
    pairs = zip(items, adjusted, strict=True)
    return [judge_gain(replace(item, p_holm=p)) for item, p in pairs]


def judge_within(item: Evidence, low: float, high: float) -> Evidence:
    """Judges by whether the interval lies in [low, high], apart from it, or across an end."""
    if min(item.seeds) < LEAST_SEEDS or isnan(item.low):
        verdict = UNDECIDED
    elif low <= item.low and item.high <= high:
        verdict = SUPPORTED
    else:
        verdict = NOT_SUPPORTED if item.high < low or item.low > high else UNDECIDED
    return replace(item, verdict=verdict)


def overall(verdicts: Iterable[str], missing: Sequence[str] = ()) -> str:
    """Of a claim that is to hold everywhere: one counterexample is enough against it."""
    found = set(verdicts)
    if NOT_SUPPORTED in found:
        return NOT_SUPPORTED
    return SUPPORTED if found == {SUPPORTED} and not missing else UNDECIDED


def count(judged: Sequence[Evidence], missing: Sequence[str] = ()) -> str:
    """As in "supported on 7 of 8; undecided: pick_place (2 against 1); no data: ..."."""
    total = len(judged)
    parts = [f"{SUPPORTED} on {sum(e.verdict == SUPPORTED for e in judged)} of {total}"]
    for verdict in (NOT_SUPPORTED, UNDECIDED):
        names = [f"{item.task} ({item.agents})" for item in judged if item.verdict == verdict]
        if names:
            parts.append(f"{verdict}: {', '.join(names)}")
    if missing:
        parts.append(f"no data: {', '.join(missing)}")
    return "; ".join(parts)


def named(tasks: Iterable[str]) -> str:
    """Which tasks a pooled quantity is of: the only one, or how many."""
    distinct = list(dict.fromkeys(tasks))
    return distinct[0] if len(distinct) == 1 else f"{len(distinct)} tasks"
