"""How time and memory grow with seeds, levels and what the replay buffers hold."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import hac_suite
from tests.bench.population import TASK, Training
from tests.bench.repeats import rounded, summary
from tests.bench.team import Team, held_memory

SEEDS = (1, 2, 5, 10, 20)
LEVELS = (1, 2, 3, 4)
ROWS = (10_000, 100_000, 1_000_000, 10_000_000)
_REPEATS = 3
_SEEDS_BY_LEVELS = 5
_SEEDS_BY_ROWS = 1
_MEMORY_SEEDS = (5, 10, 20)
_MEMORY_EPISODES = 3000


class Case:
    """A training of so many seeds and levels, its replay buffers filled to so many rows."""

    def __init__(self, seeds: int, levels: int, rows: int):
        config = dataclasses.replace(
            hac_suite.PRESETS["suite"],
            replay_capacity=max(rows, hac_suite.PRESETS["suite"].replay_capacity),
        )
        self._training = Training(TASK, config, range(seeds), levels - 1, unreachable=True)
        self._training.fill([rows] * levels)
        self._episodes = seeds * config.episodes_per_round

    def __call__(self) -> float:
        """Seconds for an episode of one seed, with its updates."""
        return self._training.round().seconds / self._episodes


class Memory:
    """A flat training whose replay buffers are as full as at its end."""

    def __init__(self, seeds: int):
        self._training = Training(TASK, hac_suite.PRESETS["suite"], range(seeds), 0)

    def __call__(self) -> float:
        """GiB at most, as of now."""
        self._training.fill_as_after(_MEMORY_EPISODES)
        self._training.round()
        return held_memory()


def growth(say: Callable[[str], None]) -> dict[str, Any]:
    """`growth`: dictionaries of seconds per seed-episode, and the memory of a seed."""
    few = 0  # rows that a round has stored anyway
    say(f"growth with seeds: {SEEDS}")
    by_seeds = _seconds(SEEDS, [(seeds, 1, few) for seeds in SEEDS])
    say(f"growth with levels: {LEVELS}")
    by_levels = _seconds(LEVELS, [(_SEEDS_BY_LEVELS, levels, few) for levels in LEVELS])
    say(f"growth with rows in the replay buffer: {ROWS}")
    by_rows = _seconds(ROWS, [(_SEEDS_BY_ROWS, 1, rows) for rows in ROWS])
    say(f"growth of memory with seeds: {_MEMORY_SEEDS}")
    return {
        "growth": {
            "unit": "seconds for a training episode of one seed and its updates",
            "task": TASK,
            "seeds": by_seeds | {"levels": 1},
            "levels": by_levels | {"seeds": _SEEDS_BY_LEVELS},
            "replay_rows": by_rows | {"levels": 1, "seeds": _SEEDS_BY_ROWS},
            "memory": _memory(),
        }
    }


def _seconds(values: Sequence[int], cases: Sequence[tuple]) -> dict[str, Any]:
    """Medians and their intervals, of cases in one process that take turns."""
    with Team(Cases, [(cases,)]) as team:
        turns = [team.work()[1][0] for _ in range(1 + _REPEATS)][1:]  # the first is a warm-up
    medians = {}
    intervals = {}
    for value, samples in zip(values, zip(*turns, strict=True), strict=True):
        middle, interval = summary(samples)
        medians[str(value)] = rounded(middle)
        intervals[str(value)] = [rounded(end) for end in interval]
    return {"seconds": medians, "seconds_ci": intervals}


class Cases:
    """Several trainings side by side."""

    def __init__(self, cases: Sequence[tuple]):
        self._cases = [Case(*case) for case in cases]

    def __call__(self) -> list[float]:
        """A round of each."""
        return [case() for case in self._cases]


def _memory() -> dict[str, Any]:
    """Peaks of fresh processes, and what a seed adds to them."""
    peaks = {}
    for seeds in _MEMORY_SEEDS:
        with Team(Memory, [(seeds,)]) as team:
            (peaks[seeds],) = team.work()[1]
    least, most = _MEMORY_SEEDS[0], _MEMORY_SEEDS[-1]
    return {
        "after_episodes": _MEMORY_EPISODES,
        "levels": 1,
        "gib": {str(seeds): rounded(peak) for seeds, peak in peaks.items()},
        "mib_per_seed": rounded(1024 * (peaks[most] - peaks[least]) / (most - least)),
    }
