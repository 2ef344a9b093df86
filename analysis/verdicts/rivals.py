"""The strongest agent without subgoal layers on a task, and a hierarchy compared with it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from analysis.statistics.areas import EPISODES, area_bounds, areas, at_budget, common_budget
from analysis.verdicts.evidence import LEAST_SEEDS

LEAST_TESTS = 3
"""With fewer tests of an agent on average, areas are guesses, unless their gain is certain."""
LEARNT = 0.1
"""An agent has learnt something if its mean success rises by so much above the untrained one."""
# By seed, how good one agent's results are until an amount of a column.
Score = Callable[[pd.DataFrame, float, str], pd.Series]

OWN = "DDPG+HER"  # what the grid's own agent without subgoal layers is called beside others


class Rival(NamedTuple):
    """The strongest agent without subgoal layers on a task, in a grid in which it is the only one.

    `name` is empty where there is no other.
    """

    name: str
    results: pd.DataFrame
    weaker: Mapping[str, pd.DataFrame]  # the same results with each of the others instead


def strongest(
    results: pd.DataFrame,
    others: Mapping[str, pd.DataFrame],
    against: str = EPISODES,
    score: Score = areas,
) -> Rival:
    """The agent without subgoal layers that beats the most others by its mean score over seeds.

    Two of them are compared until the amount of `against` that both have reached, and the
    hierarchies as well: a third one, which may have ended earlier, has no say in that. Out of the
    running are agents whose training has not begun, and those that share fewer seeds with the
    hierarchies than decide anything, where another shares more.

    Args:
      results: of one task, which may have an agent without subgoal layers of its own.
      others: results of others by name.
    """
    layered = results[results["subgoal_layers"] > 0]
    found = {name: pd.concat([rows, layered]) for name, rows in others.items() if len(rows)}
    if len(layered) < len(results):
        found = {OWN if found else "": results, **found}
    if not found:
        return Rival("", results, {})
    running = _in_the_running(found, against)
    wins = {
        name: sum(_better(rows, running[other], against, score) for other in running)
        for name, rows in running.items()
    }
    best = max(wins, key=wins.__getitem__, default=next(iter(found)))
    return Rival(best, found.pop(best), found)


def _in_the_running(found: Mapping[str, pd.DataFrame], against: str) -> dict[str, pd.DataFrame]:
    """The results, of seeds that the flat agent shares with a hierarchy if there are any."""
    shared = {name: _shared(rows) for name, rows in found.items()}
    enough = min(LEAST_SEEDS, max(map(len, shared.values())))
    paired = {
        name: rows[rows["seed"].isin(shared[name])] if shared[name] else rows
        for name, rows in found.items()
        if len(shared[name]) >= enough
    }
    return {name: rows for name, rows in paired.items() if common_budget(rows, against)}


def _shared(rows: pd.DataFrame) -> set[int]:
    flat = rows["subgoal_layers"] == 0
    return set(rows["seed"][flat]) & set(rows["seed"][~flat])


def _better(rows: pd.DataFrame, other: pd.DataFrame, against: str, score: Score) -> bool:
    budget = min(common_budget(rows, against), common_budget(other, against))
    mine, its = (
        score(one[one["subgoal_layers"] == 0], budget, against).mean() for one in (rows, other)
    )
    return bool(mine > its)


class NothingToCompareError(ValueError):
    """There is no flat agent, no hierarchy, or no seed of both."""


@dataclass(frozen=True)
class Comparison:
    """A hierarchy and a flat agent at equal amounts of one cost.

    Attributes:
      against: what they have had equal amounts of, a column.
      rival: the name of the flat agent: the strongest there; empty where there is no other.
      new, old: results of the hierarchy and of the flat agent, of the seeds that both have.
      budget: the amount of `against` that all of these seeds have behind them.
    """

    against: str
    rival: str
    new: pd.DataFrame
    old: pd.DataFrame
    budget: float

    @classmethod
    def of(cls, rival: Rival, deep: int, against: str) -> "Comparison":
        """`deep` is the hierarchy's number of subgoal layers."""
        layers, seeds = rival.results["subgoal_layers"], rival.results["seed"]
        shared = set(seeds[layers == deep]) & set(seeds[layers == 0])
        if not shared:
            raise NothingToCompareError(
                f"no seed was trained with both {deep} and 0 subgoal layers, and agents are "
                "compared by seed"
            )
        new, old = (rival.results[(layers == own) & seeds.isin(shared)] for own in (deep, 0))
        budget = common_budget(pd.concat([new, old]), against)
        if not budget:
            raise NothingToCompareError("a seed of each was not yet tested after training began")
        return cls(against, rival.name, new, old, budget)

    def area_pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the hierarchy and of the flat agent, [seeds] each in the same order."""
        first, second = (areas(one, self.budget, self.against) for one in (self.new, self.old))
        both = pd.concat([first, second], axis=1).dropna()
        return both[0].to_numpy(), both[1].to_numpy()

    def success_gains(self) -> np.ndarray:
        """What the hierarchy's seeds gain in success when the budget is spent, [seeds]."""
        new, old = (self._at_end("success_rate", one) for one in (self.new, self.old))
        return (new - old).dropna().to_numpy()

    def trained(self) -> float:
        """The share of its training that the hierarchy has done by then, mean over seeds."""
        done = self._at_end(EPISODES, self.new)
        return float((done / self.new.groupby("seed")[EPISODES].max()).mean())

    def _at_end(self, column: str, results: pd.DataFrame) -> pd.Series:
        return at_budget(results, self.budget, self.against, column)

    def is_guess(self) -> bool:
        """Whether an agent was tested too seldom within the budget to know the gain's sign."""
        return not self.is_certain() and any(
            self._tests(one) < LEAST_TESTS for one in (self.new, self.old)
        )

    def learnt(self) -> bool:
        """Whether either agent has learnt something within the budget."""
        for one in (self.new, self.old):
            within = one[one[self.against] <= self.budget]
            means = within.groupby("period")["success_rate"].mean().to_numpy()
            # Empty where an agent's first test comes after the budget, which the other one sets.
            if means.size and means.max() - means[0] > LEARNT:
                return True
        return False

    def _tests(self, results: pd.DataFrame) -> float:
        """Tests within the budget after training began, mean over seeds."""
        within = (results["period"] > 0) & (results[self.against] <= self.budget)
        return within.sum() / results["seed"].nunique()

    def is_certain(self) -> bool:
        """Whether the mean gain in area has its sign however success went between the tests."""
        (least, most), (other_least, other_most) = (
            area_bounds(one, self.budget, self.against) for one in (self.new, self.old)
        )
        return bool((least - other_most).mean() > 0 or (most - other_least).mean() < 0)
