"""Agents of many seeds that learn side by side: their learners, replay buffers and streams."""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
import torch

from hac_suite.algorithm import exploration, transitions
from hac_suite.algorithm.exploration import Purpose
from hac_suite.algorithm.record import Round
from hac_suite.config import Config, updates_of_level
from hac_suite.learning import learners, mixed
from hac_suite.learning.cuda_graph import CapturedRound
from hac_suite.learning.learner import Learner
from hac_suite.learning.mixed import PRECISIONS
from hac_suite.learning.networks import StackedMLP
from hac_suite.learning.replay import Replay, RowLayout
from hac_suite.policy import Policy, as_actor
from hac_suite.state import SeedState, copy_into
from hac_suite.types import Actor, LevelSpec, VectorEnv, level_specs
from hac_suite.values import critics_of


class Population:
    """S agents of the same shape, one per seed; nothing is shared between them."""

    def __init__(
        self,
        env: VectorEnv,
        config: Config,
        horizons: tuple[int, ...],
        seeds: Sequence[int],
        device: torch.device | str = "cpu",
    ):
        """`device` is where networks and replay buffers are; environments and actors stay here.

        Raises:
            ValueError: the config's learner is not there, or cannot learn on the device, or the
                machine lacks the config's precision.
        """
        make = learners.find(config.learner)
        mixed.check(config.precision, device, make)
        self.seeds, self.config, self.horizons = tuple(seeds), config, horizons
        self.levels: tuple[LevelSpec, ...] = level_specs(env, horizons)
        self._spaces = (env.goal_space, env.subgoal_space)
        on_cpu = torch.device(device).type == "cpu"
        if not (on_cpu or make.on_gpu):
            raise ValueError(f"the learner {config.learner} learns on CPUs only, not on {device}.")
        self.learners: list[Learner] = [
            make(spec, _of_level(config, level), self._torch_streams(level), device)
            for level, spec in enumerate(self.levels)
        ]
        self.replays = [
            Replay(len(self.seeds), config.replay_capacity, RowLayout.of(spec), device)
            for spec in self.levels
        ]
        # On a CPU a few seeds at a time do their whole round: what they need stays in the cache.
        few = PRECISIONS[config.precision].seeds_at_a_time
        stride = few if on_cpu else len(self.seeds)
        self._round = self._update if on_cpu else CapturedRound(self._update)
        edges = [*range(0, len(self.seeds), stride), len(self.seeds)]
        self._parts = [
            [(a, b, learner.of_seeds(a, b)) for a, b in itertools.pairwise(edges)]
            for learner in self.learners
        ]
        self._not_finite: dict[int, int] = {}  # levels by index of seeds, of their transitions
        self._explore = [exploration.stream(seed, Purpose.EXPLORE) for seed in self.seeds]
        self._replay_streams = [
            [exploration.stream(seed, Purpose.REPLAY, level) for seed in self.seeds]
            for level in range(len(self.levels))
        ]

    def _torch_streams(self, level: int) -> list[torch.Generator]:
        return [_torch_stream(seed, Purpose.INITIALISE, level) for seed in self.seeds]

    def exploring_actors(self) -> list[Actor]:
        """The online actors, lowest level first."""
        return self._actors([learner.actor for learner in self.learners])

    def tested_networks(self) -> list[StackedMLP]:
        """The networks that test periods run."""
        return [learner.tested_actor for learner in self.learners]

    def tested_actors(self) -> list[Actor]:
        return self._actors(self.tested_networks())

    def _actors(self, networks: list[StackedMLP]) -> list[Actor]:
        return [
            as_actor(n.to_act_with(), spec) for n, spec in zip(networks, self.levels, strict=True)
        ]

    def policies(self) -> list[Policy]:
        """A copy of each seed's agent, as tested, and of the critics that it learnt from."""
        networks, critics = self.tested_networks(), critics_of(self.learners)
        seeds = range(len(self.seeds))
        return [Policy.of_seed(networks, i, self.horizons, critics) for i in seeds]

    def draw_round(self, steps: int) -> exploration.Draws:
        return exploration.draw_round(self._explore, self.levels, self.config, steps)

    def store(self, recorded: Round, draws: exploration.Draws) -> None:
        """Puts a round's transitions into every level's replay buffers."""
        built = transitions.build(
            recorded, self.config, self.horizons, draws.hindsight, *self._spaces
        )
        levels = zip(self.replays, built, self.levels, strict=True)
        for level, (replay, made, spec) in enumerate(levels):
            rows = replay.layout.pack(made, spec)
            owner = made.env // self.config.episodes_per_round
            order = np.argsort(owner, kind="stable")
            bounds = np.searchsorted(owner[order], np.arange(len(self.seeds) + 1))
            for seed in range(len(self.seeds)):
                own = rows[order[bounds[seed] : bounds[seed + 1]]]
                replay.add(seed, own)
                if not np.isfinite(own).all():
                    self._not_finite.setdefault(seed, level)

    def learn(self) -> None:
        """A round of updates on every level."""
        config = self.config
        levels = enumerate(zip(self.replays, self._replay_streams, strict=True))
        self._round(
            [
                replay.sample_indices(
                    streams,
                    updates_of_level(config, level) * config.episodes_per_round,
                    config.batch_size,
                )
                for level, (replay, streams) in levels
            ]
        )

    def _update(self, indices: Sequence[torch.Tensor]) -> None:
        """Updates on the replayed rows of these indices, per level [updates, S, B]."""
        for replay, parts, chosen in zip(self.replays, self._parts, indices, strict=True):
            for start, stop, learner in parts:
                for rows in replay.batches(chosen[:, start:stop], start):
                    learner.update(rows)

    def broken(self) -> dict[int, int]:
        """Which seeds (by index) have a weight or a transition that is no finite number.

        Returns:
            The lowest such level, by index. Such a transition is not left to show in the weights:
            in bf16 a ReLU makes NaN zero.
        """
        found: dict[int, int] = {}
        for level, learner in reversed(list(enumerate(self.learners))):
            # NaN and infinity survive being summed.
            sums = torch.stack([table.sum(1) for table in learner.parameters()])
            lost = ~torch.isfinite(sums).all(0)
            found.update(dict.fromkeys(lost.nonzero()[:, 0].tolist(), level))
        for index, level in self._not_finite.items():
            found[index] = min(level, found.get(index, level))
        return found

    def updates(self, index: int, level: int) -> int:
        """How many updates a level of one seed has had."""
        return int(self.learners[level].updates()[index])

    def diagnose(self, period: int) -> list[dict[str, list[float]]]:
        """Per level, per seed: what the critic and actor look like on replayed states."""
        found: list[dict[str, list[float]]] = []
        for level, (learner, replay) in enumerate(zip(self.learners, self.replays, strict=True)):
            if not replay.sizes.any():
                found.append({})
                continue
            streams = [
                np.random.default_rng(
                    np.random.SeedSequence(seed, spawn_key=(Purpose.DIAGNOSE, level, period))
                )
                for seed in self.seeds
            ]
            indices = replay.sample_indices(streams, 1, self.config.batch_size)
            (measured,) = map(learner.diagnose, replay.batches(indices))
            measured["replay_fill"] = (replay.sizes / replay.capacity).tolist()
            for values in measured.values():  # nothing replayed, nothing to say: seed by seed
                values[:] = np.where(replay.sizes > 0, values, np.nan)
            found.append(measured)
        return found

    def _tensors(self, index: int) -> dict[str, torch.Tensor]:
        """Views of all that one seed has learnt."""
        return {
            f"level{level}.{name}": tensor
            for level, learner in enumerate(self.learners)
            for name, tensor in learner.tensors(index).items()
        }

    def state(self, index: int) -> SeedState:
        """One seed's networks, optimisers, replay buffers and random streams."""
        rows = {_rows_name(level): replay.held(index) for level, replay in enumerate(self.replays)}
        numbers = {
            "added": [int(replay.added[index]) for replay in self.replays],
            "explore_stream": self._explore[index].bit_generator.state,
            "replay_streams": [own[index].bit_generator.state for own in self._replay_streams],
        }
        return SeedState({**self._tensors(index), **rows}, numbers)

    def restore(self, index: int, state: SeedState) -> None:
        """Makes one seed what `state` said of it; all memory stays where it is.

        Raises:
            ValueError: it is a state of another task or config.
        """
        copy_into(self._tensors(index), state.tensors)
        for level, (replay, added) in enumerate(
            zip(self.replays, state.numbers["added"], strict=True)
        ):
            replay.restore(index, state.tensors[_rows_name(level)], added)
        self._explore[index].bit_generator.state = state.numbers["explore_stream"]
        streams = state.numbers["replay_streams"]
        for own, saved in zip(self._replay_streams, streams, strict=True):
            own[index].bit_generator.state = saved


def _of_level(config: Config, level: int) -> Config:
    """The config of a level's learner: its tested actor averages over as many episodes."""
    share = config.updates_per_episode / updates_of_level(config, level)
    return dataclasses.replace(config, tested_actor_rate=min(1.0, config.tested_actor_rate * share))


def _torch_stream(seed: int, purpose: Purpose, level: int) -> torch.Generator:
    """As `exploration.stream`, for torch."""
    state = np.random.SeedSequence(seed, spawn_key=(purpose, level)).generate_state(1)[0]
    return torch.Generator().manual_seed(int(state))


def _rows_name(level: int) -> str:
    return f"level{level}.replay"
