"""The training loop: rounds of episodes and updates, and a test period every so often."""

import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch

from hac_suite import exploration
from hac_suite.config import Config
from hac_suite.evaluation import EpisodeStats
from hac_suite.exploration import Purpose
from hac_suite.hierarchy import collect
from hac_suite.policy import Policy
from hac_suite.population import Population
from hac_suite.record import Round
from hac_suite.transitions import penalised
from hac_suite.types import VectorEnv


class Progress(NamedTuple):
    """Where a training stands after a round of episodes."""

    train_episodes: int  # per seed
    total_episodes: int
    success_rate: float  # of the last test period, mean over seeds


class PeriodResult(NamedTuple):
    """A test period of every seed."""

    period: int
    rows: list[dict[str, Any]]  # per seed, the columns of results.csv but for the task
    policies: list[Policy]  # per seed, as tested


def train(
    make_env: Callable[[int], VectorEnv],
    config: Config,
    seeds: Sequence[int],
    *,
    subgoal_layers: int,
    horizons: tuple[int, ...],
    periods: int,
    on_progress: Callable[[Progress], None] | None = None,
    device: torch.device | str = "cpu",
) -> Iterator[PeriodResult]:
    """Trains one agent per seed; yields each test period, the untrained one (period 0) first.

    A seed's results depend on nothing but the seed, the config and the task.

    Args:
        make_env: makes a vectorised environment of the given size.
        horizons: (T_0, ..., T_n), n = subgoal_layers.
        device: where the agents learn; "cuda" takes a round of updates as one CUDA graph.

    Raises:
        ValueError: seeds repeat, or horizons do not match subgoal_layers.
    """
    if len(set(seeds)) != len(seeds) or not seeds:
        raise ValueError(f"Seeds must be given and differ from each other: {list(seeds)}.")
    if len(horizons) != subgoal_layers + 1:
        raise ValueError(f"{subgoal_layers} subgoal layers need {subgoal_layers + 1} horizons.")
    training = _Training(make_env, config, tuple(seeds), horizons, on_progress, device)
    return training.run(periods)


class _Tally:
    """Sums over training episodes since the last test period, per seed."""

    def __init__(self, seeds: int, levels: int):
        self.episodes = 0
        self.diverged = np.zeros(seeds, np.int64)
        # Per level: [attempts, subgoals achieved, tested, penalised, segments, segments reached].
        self.counts = np.zeros((levels, 6, seeds))

    def add(self, run: Round, config: Config) -> None:
        per_seed = (len(self.diverged), config.episodes_per_round)
        self.episodes += config.episodes_per_round
        self.diverged += run.diverged.reshape(per_seed).sum(1)
        for level, record in enumerate(run.levels):
            flags = (
                record.done,
                record.done & record.hit,
                record.done & record.tested,
                penalised(record, config),
                record.segment_end,
                record.segment_end & record.reached,
            )
            for row, flag in enumerate(flags):
                self.counts[level, row] += flag.sum(0).reshape(per_seed).sum(1)

    def columns(self, level: int, seed: int) -> dict[str, float]:
        """Attempts an episode, and rates; only levels that propose subgoals have those of them."""
        attempts, hit, tested, penalties, segments, reached = self.counts[level, :, seed]
        proposes = {
            "achieved": _ratio(hit, attempts),
            "tested": _ratio(tested, attempts),
            "penalised": _ratio(penalties, attempts),
        }
        return {
            "proposed": _ratio(attempts, self.episodes),
            **(proposes if level else dict.fromkeys(proposes, np.nan)),
            "success": _ratio(reached, segments),
        }


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else np.nan


class _Training:
    """The state of one training: its population, environments and counters."""

    def __init__(
        self,
        make_env: Callable[[int], VectorEnv],
        config: Config,
        seeds: tuple[int, ...],
        horizons: tuple[int, ...],
        on_progress: Callable[[Progress], None] | None,
        device: torch.device | str = "cpu",
    ):
        self._config, self._seeds, self._horizons = config, seeds, horizons
        self._on_progress = on_progress
        self._env = make_env(len(seeds) * config.episodes_per_round)
        self._test_env = make_env(len(seeds) * config.test_episodes)
        self._population = Population(self._env, config, horizons, seeds, device)
        self._test_seeds = self._episode_seeds(Purpose.TEST_EPISODE, 0, config.test_episodes)
        self._episodes = 0
        self._steps = np.zeros(len(seeds), np.int64)
        self._tally = self._new_tally()
        self._started = time.monotonic()

    def _new_tally(self) -> _Tally:
        return _Tally(len(self._seeds), len(self._horizons))

    def _episode_seeds(self, purpose: Purpose, first: int, count: int) -> np.ndarray:
        return np.concatenate(
            [exploration.episode_seeds(seed, purpose, first, count) for seed in self._seeds]
        )

    def run(self, periods: int) -> Iterator[PeriodResult]:
        total = periods * self._config.episodes_per_period
        result = self._test(0)
        for period in range(1, periods + 1):
            yield result
            success = float(np.mean([row["success_rate"] for row in result.rows]))
            while self._episodes < period * self._config.episodes_per_period:
                self._train_round()
                if self._on_progress:
                    self._on_progress(Progress(self._episodes, total, success))
            result = self._test(period)
        yield result

    def _train_round(self) -> None:
        population, config = self._population, self._config
        draws = population.draw_round(self._env.max_steps)
        run = collect(
            self._env,
            population.exploring_actors(),
            config,
            self._horizons,
            draws,
            self._episode_seeds(Purpose.TRAIN_EPISODE, self._episodes, config.episodes_per_round),
        )
        population.store(run, draws)
        population.learn()
        self._episodes += config.episodes_per_round
        self._steps += run.steps.reshape(len(self._seeds), -1).sum(1)
        self._tally.add(run, config)

    def _test(self, period: int) -> PeriodResult:
        population = self._population
        run = collect(
            self._test_env,
            population.tested_actors(),
            self._config,
            self._horizons,
            None,
            self._test_seeds,
            test=True,
        )
        stats = EpisodeStats.of(run)
        diagnosed = population.diagnose(period)
        rows = [self._row(period, i, stats, diagnosed) for i in range(len(self._seeds))]
        self._tally = self._new_tally()
        return PeriodResult(period, rows, population.policies())

    def _row(
        self,
        period: int,
        index: int,
        stats: EpisodeStats,
        diagnosed: list[dict[str, list[float]]],
    ) -> dict[str, Any]:
        tests = self._config.test_episodes
        own = slice(index * tests, (index + 1) * tests)
        success, steps = stats.success[own], stats.steps[own]
        row = {
            "subgoal_layers": len(self._horizons) - 1,
            "seed": self._seeds[index],
            "period": period,
            "train_episodes": self._episodes,
            "train_steps": int(self._steps[index]),
            "test_episodes": tests,
            "success_rate": float(success.mean()),
            "mean_steps_to_goal": float(steps[success].mean()) if success.any() else np.nan,
            "wall_seconds": time.monotonic() - self._started,
            "diverged_episodes": int(self._tally.diverged[index] + stats.diverged[own].sum()),
        }
        for level, measured in enumerate(diagnosed):
            columns = self._tally.columns(level, index)
            columns.update({name: values[index] for name, values in measured.items()})
            row.update({f"level{level}_{name}": columns.get(name, np.nan) for name in DIAGNOSTICS})
        return row


# Per level and test period: attempts an episode (`proposed`), shares of them, and the learner's
# state on replayed transitions.
DIAGNOSTICS = (
    "proposed",
    "achieved",
    "tested",
    "penalised",
    "q_mean",
    "q_min",
    "q_at_bound",
    "saturation",
    "replay_fill",
    "success",
)
