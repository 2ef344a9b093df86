"""Our side: the training loop of the launcher, its rounds counted and timed by part."""

import time
from collections.abc import Sequence
from typing import Any, cast

import hac_suite
import tasks
from hac_suite.learning.ddpg import DDPG
from hac_suite.training.loop import PeriodResult
from hac_suite.training.loop import Training as Loop
from tests.bench.work import Meter, Work, whole_horizon

TASK = "pick_place"  # where a measurement is of one task


class Training:
    """A population in training.

    Attributes:
      episodes: that each seed has played.
      max_steps: of an episode.
    """

    def __init__(
        self,
        task: str,
        config: hac_suite.Config,
        seeds: Sequence[int],
        subgoal_layers: int,
        *,
        unreachable: bool = False,
    ):
        """`unreachable`: with goals that nothing achieves, so that the work is always the same."""

        def make_env(num_envs: int) -> Any:
            env = tasks.load_vector(task, num_envs)
            return whole_horizon(env) if unreachable else env

        env = tasks.load_vector(task, 1)
        self.max_steps = env.max_steps
        horizons = hac_suite.horizons(self.max_steps, subgoal_layers, env.horizons)
        self._training = Loop(make_env, config, tuple(seeds), horizons, "cpu")
        self.config = config
        self.episodes = 0
        self._meter = Meter()
        self._watch()

    def _watch(self) -> None:
        population, meter = self._training.population, self._meter
        meter.watch(self._training.env)
        exploring = population.exploring_actors

        def timed_actors() -> list:
            return [meter.timed("acting", actor) for actor in exploring()]

        population.exploring_actors = timed_actors  # type: ignore[method-assign]
        population.learn = meter.timed("updates", population.learn)  # type: ignore[method-assign]

    @property
    def learners(self) -> list[DDPG]:
        return cast(list[DDPG], self._training.population.learners)

    def round(self) -> Work:
        """A round of episodes and updates of every seed."""
        before = self._updates()
        work = self._meter.measure(self._training.train_round)
        self.episodes += self.config.episodes_per_round
        return work._replace(updates=self._updates() - before)

    def learn(self) -> Work:
        """A round's updates without its episodes."""
        before = self._updates()
        work = self._meter.measure(self._training.population.learn)
        return work._replace(updates=self._updates() - before)

    def _updates(self) -> int:
        """Updates of all seeds and levels."""
        return sum(updates_made(learner) for learner in self.learners)

    def test(self) -> tuple[float, PeriodResult]:
        """A test period of every seed, and its seconds."""
        start = time.perf_counter()
        result = self._training.test(1)
        return time.perf_counter() - start, result

    def fill(self, rows: Sequence[int]) -> None:
        """Plays a round, and stores it again until each buffer of level i holds rows[i]."""
        self._store_again(self._recorded_round(), rows)

    def fill_as_after(self, episodes: int) -> None:
        """Plays a round, and stores it again: about what the buffers hold after the episodes."""
        stored = self._recorded_round()
        per_episode = [r.sizes.mean() / self.episodes for r in self._training.population.replays]
        self._store_again(stored, [int(rows * episodes) for rows in per_episode])

    def _recorded_round(self) -> list[list[tuple]]:
        """Plays a round; what it stored, per level as arguments of the replay buffer's `add`."""
        replays = self._training.population.replays
        stored: list[list[tuple]] = [[] for _ in replays]
        for replay, calls in zip(replays, stored, strict=True):
            replay.add = _recorded(replay.add, calls)  # type: ignore[method-assign]
        self.round()
        for replay in replays:
            del replay.add
        return stored

    def _store_again(self, stored: Sequence[Sequence[tuple]], rows: Sequence[int]) -> None:
        replays = self._training.population.replays
        for replay, calls, wanted in zip(replays, stored, rows, strict=True):
            while (held := replay.sizes.min()) < min(wanted, replay.capacity):
                for arguments in calls:
                    replay.add(*arguments)
                if replay.sizes.min() == held:
                    raise RuntimeError("a seed stored nothing in a round")


def updates_made(learner: DDPG) -> int:
    """Updates of a level, all seeds together."""
    return int(learner.updates().sum())


def _recorded(add, calls: list[tuple]):
    def call(*arguments: Any) -> None:
        calls.append(arguments)
        add(*arguments)

    return call
