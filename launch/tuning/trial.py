"""One trial: trains a configuration on the tuning seeds of some tasks, and scores it."""

import functools
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

import hac_suite
import tasks

Train = Callable[..., Iterator[hac_suite.PeriodResult]]  # called as `hac_suite.train` is


class Agent(NamedTuple):
    """What a trial trains on one task."""

    task: str
    subgoal_layers: int
    horizons: tuple[int, ...]
    config: hac_suite.Config
    seeds: tuple[int, ...]
    periods: int


class Curve:
    """Success of an agent's seeds at each test so far, and the core-minutes it took till then."""

    def __init__(self, agent: Agent):
        self.agent = agent
        self.success: list[list[float]] = []  # [period][seed], the untrained one first
        self.minutes: list[float] = []  # [period], for each seed, from the untrained test on
        self.train_steps: list[int] = []  # [period], of all seeds
        self.lost: dict[int, str] = {}  # by seed, why it could not go on

    def add(self, rows: Sequence[dict[str, Any]], minutes: float) -> None:
        """Adds a test; a seed that could not go on succeeds no more."""
        found = {int(row["seed"]): row for row in rows}
        rates = [float(found[s]["success_rate"]) if s in found else 0.0 for s in self.agent.seeds]
        steps = sum(int(row["train_steps"]) for row in rows)
        self.success.append(rates)
        self.minutes.append(minutes)
        self.train_steps.append(steps)

    def mean(self) -> float:
        """Mean success over the seeds at the last test."""
        return float(np.mean(self.success[-1]))


def objective(success: np.ndarray, minutes: np.ndarray, budget: float) -> np.ndarray:
    """What curves are worth: half by episodes, half by CPU time; from 0 to 1, more is better.

    The mean of
    - the area under success against episodes: the mean success of all tests but the untrained
      one, since test periods are equally long; and
    - the area under success against core-minutes, from the untrained test until `budget`, divided
      by `budget`. Between two tests success is taken to change linearly, and after the last one
      not at all; what is learnt after `budget` does not count here.

    CPU time is that of training and tests on this machine as it was: a busy machine takes a little
    more of it.

    Args:
      success: [periods + 1, seeds], the untrained test first.
      minutes: [periods + 1], core-minutes for each seed, rising from 0.
      budget: core-minutes for each seed.

    Returns:
      [seeds]
    """
    by_episodes = success[1:].mean(axis=0)
    inside = minutes < budget
    at = np.append(minutes[inside], budget)
    by_minutes = [
        np.trapezoid(np.append(own[inside], np.interp(budget, minutes, own)), at) / budget
        for own in success.T
    ]
    return (by_episodes + np.array(by_minutes)) / 2


def values(curves: Sequence[Curve], budget: float) -> dict[int, float]:
    """By seed, the objective of a trial that has all its tests: the mean over its tasks."""
    each = [objective(np.array(c.success), np.array(c.minutes), budget) for c in curves]
    return dict(zip(curves[0].agent.seeds, np.mean(each, axis=0).tolist(), strict=True))


def train(
    agents: Sequence[Agent], train_agent: Train, on_round: Callable[[], None]
) -> Iterator[list[Curve]]:
    """Trains the agents side by side, a test period of each at a time.

    So a period's mean success is over the same tasks in every trial.

    Args:
      on_round: called after each round of episodes; what it raises ends the training.

    Yields:
      The agents' curves, after each period; the untrained one first.
    """
    curves = [Curve(agent) for agent in agents]
    trainings = [_start(curve, train_agent, on_round) for curve in curves]
    spent = [0.0] * len(agents)
    for period in range(agents[0].periods + 1):
        for index, (curve, training) in enumerate(zip(curves, trainings, strict=True)):
            started = time.process_time()
            result = next(training, None)  # None: no seed is left
            if period:
                spent[index] += time.process_time() - started
            minutes = spent[index] / 60 / len(curve.agent.seeds)
            curve.add(result.rows if result else [], minutes)
        yield curves


def _start(
    curve: Curve, train_agent: Train, on_round: Callable[[], None]
) -> Iterator[hac_suite.PeriodResult]:
    agent = curve.agent
    return train_agent(
        functools.partial(tasks.load_vector, agent.task),
        agent.config,
        agent.seeds,
        subgoal_layers=agent.subgoal_layers,
        horizons=agent.horizons,
        periods=agent.periods,
        callback=_Watching(curve, on_round),
    )


class _Watching(hac_suite.Callback):
    """Notes seeds that stopped, and passes on that a round has ended."""

    def __init__(self, curve: Curve, on_round: Callable[[], None]):
        self._curve, self._on_round = curve, on_round

    def on_progress(self, progress: hac_suite.Progress) -> None:
        self._on_round()

    def on_lost(self, lost: hac_suite.LostSeed) -> None:
        self._curve.lost[lost.seed] = str(lost)


def as_json(curves: Sequence[Curve]) -> dict[str, dict[str, Any]]:
    """By task, what a trial leaves on record."""
    return {
        curve.agent.task: {
            "T": list(curve.agent.horizons),
            "success": [[round(rate, 4) for rate in rates] for rates in curve.success],
            "minutes": [round(minutes, 4) for minutes in curve.minutes],
            "train_steps": curve.train_steps,
            **({"lost": curve.lost} if curve.lost else {}),
        }
        for curve in curves
    }
