"""Trainings that take no time, or die: they stand in for `hac_suite.train` in tests of tuning."""

import dataclasses
import math
import time
from collections.abc import Iterator, Sequence

import hac_suite

ROUNDS = 3  # in a period


def quality(config: hac_suite.Config) -> float:
    """How well a config does here: best with a learning rate of 1e-3."""
    return 1 - abs(math.log10(config.learning_rate / 1e-3))


def burn(seconds: float) -> None:
    """Takes CPU time."""
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


def quick(
    _make_env, config, seeds, *, subgoal_layers, horizons, periods, callback
) -> Iterator[hac_suite.PeriodResult]:
    """Success rises to the config's `quality` over the periods; a round takes 10 ms."""
    assert len(horizons) == subgoal_layers + 1
    for period in range(periods + 1):
        for number in range(ROUNDS if period else 0):
            burn(0.01)
            callback.on_progress(hac_suite.Progress(ROUNDS * (period - 1) + number, 0.0))
        yield result(period, seeds, quality(config) * period / periods)


def result(period: int, seeds: Sequence[int], success: float) -> hac_suite.PeriodResult:
    rows = [{"seed": seed, "success_rate": success, "train_steps": 100 * period} for seed in seeds]
    return hac_suite.PeriodResult(period, rows, [])


def endless(
    _make_env, config, seeds, *, subgoal_layers, horizons, periods, callback
) -> Iterator[hac_suite.PeriodResult]:
    """As `quick`, but its second period never ends."""
    yield result(0, seeds, 0.0)
    burn(0.1)
    yield result(1, seeds, 0.5)
    while True:
        burn(0.01)
        callback.on_progress(hac_suite.Progress(0, 0.0))


def raises(*_, **__) -> Iterator[hac_suite.PeriodResult]:
    raise RuntimeError("the reason\nand more of it")


def tiny(make_env, config, seeds, **arguments) -> Iterator[hac_suite.PeriodResult]:
    """The real training, made small."""
    small = dataclasses.replace(
        config, episodes_per_period=4, test_episodes=2, batch_size=8, hidden_sizes=(8,)
    )
    return hac_suite.train(make_env, small, seeds, **arguments)
