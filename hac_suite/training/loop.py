"""The training loop: rounds of episodes and updates, and a test period every so often."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch

from hac_suite.algorithm import exploration
from hac_suite.algorithm.exploration import Purpose
from hac_suite.algorithm.hierarchy import collect
from hac_suite.algorithm.record import Outcome
from hac_suite.config import Config
from hac_suite.policy import Policy
from hac_suite.state import SeedState, restoring
from hac_suite.training.callback import Boundary, Callback, LostSeed, Progress
from hac_suite.training.evaluation import EpisodeStats
from hac_suite.training.population import Population
from hac_suite.training.tally import Tally
from hac_suite.types import VectorEnv


class PeriodResult(NamedTuple):
    """A test period of every seed that is still in training."""

    period: int
    rows: list[dict[str, Any]]  # per seed, the columns of results.csv but for the task
    policies: list[Policy]  # per seed, as tested


_NOT_A_MAKER = (
    "make_env must be a function that makes as many environments as it is asked for, such as "
    "tasks.find(...).load_vector or env.copies, not a {kind}."
)
_HORIZONS = "{layers} subgoal layers need {count} horizons (T_0, ..., T_n), not {horizons}."


def train(
    make_env: Callable[[int], VectorEnv],
    config: Config,
    seeds: Sequence[int],
    *,
    subgoal_layers: int,
    horizons: tuple[int, ...],
    periods: int,
    device: torch.device | str = "cpu",
    start: Iterable[SeedState] | None = None,
    callback: Callback | None = None,
) -> Iterator[PeriodResult]:
    """Trains one agent per seed; yields each test period, the untrained one (period 0) first.

    A seed's results depend only on the seed, the config and the task: not on other seeds, nor on
    whether the training was resumed.

    Args:
        make_env: makes a vectorised environment of the given size.
        config: the hyperparameters, of all levels and seeds.
        seeds: one or more different integers of at least 0.
        subgoal_layers: n, the number of levels above the lowest.
        horizons: (T_0, ..., T_n).
        periods: test periods after training began; each follows `config.episodes_per_period`
            episodes of each seed. The untrained one comes first, so there are one more results.
        device: where the agents learn; "cuda" takes a round of updates as one CUDA graph.
        start: the seeds' states at an earlier boundary, all from the same episode; the training
            resumes there, with the next test period. They are read one by one, because they are
            large.
        callback: receives the progress. A seed whose weights are no longer finite stops, without
            effect on the others. The training ends when no seed is left.

    Raises:
        ValueError: seeds repeat, horizons do not match subgoal_layers, `make_env` is an environment
            and not a function, or `start` is not of these seeds and this config, or of a later
            episode than the last.
    """
    seeds = tuple(int(seed) for seed in seeds)  # also numpy's
    if len(set(seeds)) != len(seeds) or not seeds:
        raise ValueError(f"Give one or more different seeds, not {list(seeds)}.")
    if not callable(make_env):
        raise ValueError(_NOT_A_MAKER.format(kind=type(make_env).__name__))
    if isinstance(horizons, Mapping) or len(horizons) != subgoal_layers + 1:
        count = subgoal_layers + 1
        raise ValueError(_HORIZONS.format(layers=subgoal_layers, count=count, horizons=horizons))
    training = Training(make_env, config, seeds, horizons, device)
    if start is not None:
        training.restore(start)
        training.check_end(periods)
    return training.run(periods, callback or Callback())


class Training:
    """The state of one training: its population, environments and counters.

    Most callers need only `train`; this is for code that measures or steps a training itself.

    Attributes:
        population: the agents, and what they have stored.
        env: in which they train.
        test_seeds: int [seeds * test_episodes], what decides each episode of a test period.
    """

    def __init__(
        self,
        make_env: Callable[[int], VectorEnv],
        config: Config,
        seeds: tuple[int, ...],
        horizons: tuple[int, ...],
        device: torch.device | str,
    ):
        self._config, self._horizons = config, horizons
        self._make_env, self._device = make_env, device
        self._begin(seeds)

    def _begin(self, seeds: tuple[int, ...]) -> None:
        config = self._config
        self._seeds = seeds
        self.env = self._make_env(len(seeds) * config.episodes_per_round)
        self._test_env = self._make_env(len(seeds) * config.test_episodes)
        self.population = Population(self.env, config, self._horizons, seeds, self._device)
        self.test_seeds = self._episode_seeds(Purpose.TEST_EPISODE, 0, config.test_episodes)
        self._episodes = 0
        self._steps = np.zeros(len(seeds), np.int64)
        self._tally = self._new_tally()
        self._rows: list[list[dict[str, Any]]] = [[] for _ in seeds]  # of the periods so far
        self._started, self._cpu_started = time.monotonic(), time.process_time()
        # Before that, in earlier processes:
        self._earlier, self._cpu_earlier = np.zeros(len(seeds)), np.zeros(len(seeds))

    def _new_tally(self) -> Tally:
        return Tally(len(self._seeds), len(self._horizons))

    def _episode_seeds(self, purpose: Purpose, first: int, count: int) -> np.ndarray:
        return np.concatenate(
            [exploration.episode_seeds(seed, purpose, first, count) for seed in self._seeds]
        )

    def _seconds(self) -> np.ndarray:
        """How long each seed has been trained."""
        return self._earlier + (time.monotonic() - self._started)

    def _core_seconds(self) -> np.ndarray:
        """Each seed's share of the CPU time: what it would cost on a core of its own."""
        spent = time.process_time() - self._cpu_started
        return self._cpu_earlier + spent / len(self._seeds)

    def states(self) -> Iterator[SeedState]:
        """Of each seed, one after the other."""
        # Read once: seeds that are trained side by side stand at one time.
        seconds, core_seconds = self._seconds(), self._core_seconds()
        for index, seed in enumerate(self._seeds):
            learnt = self.population.state(index)
            own = {
                "seed": seed,
                "train_episodes": self._episodes,
                "train_steps": int(self._steps[index]),
                "seconds": float(seconds[index]),
                "core_seconds": float(core_seconds[index]),
                "tally": self._tally.state(index),
                "rows": list(self._rows[index]),
            }
            yield SeedState(learnt.tensors, {**learnt.numbers, **own})

    def restore(self, states: Iterable[SeedState]) -> None:
        """Restores these states, one per seed.

        Raises:
            ValueError: they belong to other seeds, another config, or different episodes.
        """
        with restoring():
            episodes = set()
            for index, (seed, state) in enumerate(zip(self._seeds, states, strict=True)):
                numbers = state.numbers
                if numbers["seed"] != seed:
                    raise ValueError(
                        f"A state belongs to seed {numbers['seed']}, not to seed {seed}."
                    )
                self.population.restore(index, state)
                self._tally.restore(index, numbers["tally"])
                self._steps[index] = numbers["train_steps"]
                self._earlier[index] = numbers["seconds"]
                # States of earlier versions do not say it.
                self._cpu_earlier[index] = numbers.get("core_seconds", np.nan)
                self._rows[index] = list(numbers["rows"])
                episodes.add(numbers["train_episodes"])
            if len(episodes) > 1:
                raise ValueError(
                    f"The states of the seeds are from different episodes: {sorted(episodes)}."
                )
            (self._episodes,) = episodes

    def check_end(self, periods: int) -> None:
        """Checks that the training does not stand beyond the end of so many periods.

        Raises:
            ValueError: it does; its policies would be later ones.
        """
        end = periods * self._config.episodes_per_period
        if self._episodes > end:
            raise ValueError(
                f"The states are from episode {self._episodes}, beyond the end of {periods} "
                f"periods, which is episode {end}."
            )

    def run(self, periods: int, callback: Callback) -> Iterator[PeriodResult]:
        """Trains and tests from where it stands until `periods` are done.

        What stands at that end already gives its last test period once more: whoever took it the
        first time may not have lived to keep it.
        """
        per_period = self._config.episodes_per_period
        if len(self._rows[0]) == periods + 1:
            yield PeriodResult(
                periods, [rows[-1] for rows in self._rows], self.population.policies()
            )
            callback.on_boundary(Boundary(self._episodes, True, self.states, last=True))
        for period in range(len(self._rows[0]), periods + 1):
            while self._episodes < period * per_period:
                self.train_round()
                broken = self.population.broken()
                if broken and not self._go_on_without(broken, callback):
                    return
                success = float(np.mean([rows[-1]["success_rate"] for rows in self._rows]))
                callback.on_progress(Progress(self._episodes, success))
                if self._episodes < period * per_period:
                    callback.on_boundary(Boundary(self._episodes, False, self.states))
            yield self.test(period)
            last = period == periods
            callback.on_boundary(Boundary(self._episodes, True, self.states, last))

    def train_round(self) -> None:
        """A round of episodes and updates of every seed."""
        population, config = self.population, self._config
        draws = population.draw_round(self.env.max_steps)
        run = collect(
            self.env,
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

    def _go_on_without(self, broken: Mapping[int, int], callback: Callback) -> bool:
        """Becomes the training of the other seeds, if there are any; `broken`: levels by index."""
        for index, level in broken.items():
            updates = self.population.updates(index, level)
            callback.on_lost(LostSeed(self._seeds[index], level, updates, self._episodes))
        kept = [state for index, state in enumerate(self.states()) if index not in broken]
        if kept:
            self._begin(tuple(state.numbers["seed"] for state in kept))
            self.restore(kept)
        return bool(kept)

    def test(self, period: int) -> PeriodResult:
        """A test period of every seed."""
        population = self.population
        run = collect(
            self._test_env,
            population.tested_actors(),
            self._config,
            self._horizons,
            None,
            self.test_seeds,
            test=True,
        )
        stats = EpisodeStats.of(run)
        diagnosed = population.diagnose(period)
        # Read once: seeds that are trained side by side stand at one time.
        clocks = {"wall_seconds": self._seconds(), "core_seconds": self._core_seconds()}
        rows = [
            self._row(period, index, stats, diagnosed)
            | {name: float(values[index]) for name, values in clocks.items()}
            for index in range(len(self._seeds))
        ]
        self._tally = self._new_tally()
        for own, row in zip(self._rows, rows, strict=True):
            own.append(row)
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
            "diverged_episodes": int(self._tally.diverged[index] + stats.diverged[own].sum()),
        }
        for level, measured in enumerate(diagnosed):
            columns = self._tally.columns(level, index)
            columns.update({name: values[index] for name, values in measured.items()})
            columns.update(_in_tests(stats.outcomes[level, own].sum(axis=0)))
            row.update({f"level{level}_{name}": columns.get(name, np.nan) for name in DIAGNOSTICS})
        return row


def _in_tests(outcomes: np.ndarray) -> dict[str, float]:
    """Shares of a level's subgoals by what came of them, of counts [4] of each Outcome."""
    proposed = outcomes.sum()
    if not proposed:
        return {}
    return {
        "test_achieved": float(outcomes[Outcome.ACHIEVED] / proposed),
        "test_missed": float(outcomes[Outcome.MISSED] / proposed),
    }


# Per level and test period: attempts an episode (`proposed`), shares of them, the learner's state
# on replayed transitions, and shares of the subgoals of the noise-free tests.
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
    "test_achieved",
    "test_missed",
)
