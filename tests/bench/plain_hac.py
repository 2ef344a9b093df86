"""HAC as public ports write it: one environment, one seed, torch modules and autograd.

The episode is the recursive transcription's; each level has a replay buffer, an actor and a critic
of `torch.nn`, their target networks, and two of torch's Adam. The buffer is what most public ports
have, a list of transitions that a loop picks batches from; `ArrayReplay` is a faster one.
"""

import copy
import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import nn
from torch.nn import functional

import hac_suite
import tasks
from hac_suite.algorithm import exploration
from hac_suite.algorithm.exploration import Purpose
from hac_suite.types import LevelSpec, level_specs
from tests.bench.work import Meter, Work, total, whole_horizon
from tests.hac_suite.recursive_hac import Actor, Draws, RecursiveHac, Transition


class PlainAgents:
    """One agent for each seed, trained one after another."""

    def __init__(
        self,
        task: str,
        config: hac_suite.Config,
        seeds: Sequence[int],
        subgoal_layers: int,
        replay: "type[Replay]",
    ):
        self._agents = [_Agent(task, config, seed, subgoal_layers, replay) for seed in seeds]

    def __call__(self, episodes: int) -> Work:
        """Trains every agent for so many episodes more."""
        return total([agent.train(episodes) for agent in self._agents])


class _Agent:
    """A hierarchy that learns after each episode."""

    def __init__(
        self,
        task: str,
        config: hac_suite.Config,
        seed: int,
        subgoal_layers: int,
        replay: "type[Replay]",
    ):
        self._meter = Meter()
        self._env = self._meter.watch(whole_horizon(tasks.load_vector(task, 1)))
        self._config = dataclasses.replace(config, episodes_per_round=1)
        self._horizons = hac_suite.horizons(self._env.max_steps, subgoal_layers, self._env.horizons)
        self._specs = level_specs(self._env, self._horizons)
        torch.manual_seed(seed)
        self._levels = [
            Level(spec, config, replay(spec, config.replay_capacity, seed)) for spec in self._specs
        ]
        self._explore = exploration.stream(seed, Purpose.EXPLORE)
        self._episode_seeds = np.random.default_rng(seed)
        for level in self._levels:
            level.actor_adam.register_step_post_hook(self._count_update)

    def _count_update(self, *_) -> None:
        self._meter.updates += 1

    def train(self, episodes: int) -> Work:
        """Trains for so many whole episodes."""

        def work() -> None:
            for _ in range(episodes):
                self._play()
                learn()

        learn = self._meter.timed("updates", self._learn)
        return self._meter.measure(work)

    def _play(self) -> None:
        draws = exploration.draw_round(
            [self._explore], self._specs, self._config, self._env.max_steps
        )
        own = Draws(*([by_level[0] for by_level in drawn] for drawn in draws))
        actors: list[Actor] = [level.act for level in self._levels]
        hac = RecursiveHac(self._env, actors, self._config, list(self._horizons), own)
        for transition in hac.episode(int(self._episode_seeds.integers(2**32))):
            self._levels[transition.level].replay.add(transition)

    def _learn(self) -> None:
        for level in self._levels:
            for _ in range(self._config.updates_per_episode):
                level.update(self._config.batch_size)


class Replay:
    """A list of transitions, which loses its oldest fifth when it is full."""

    def __init__(self, spec: LevelSpec, capacity: int, seed: int):
        self._spec, self._capacity = spec, capacity
        self._random = np.random.default_rng(seed)
        self._held: list[tuple] = []

    def add(self, transition: Transition) -> None:
        if len(self._held) >= self._capacity:
            del self._held[: self._capacity // 5]
        self._held.append(self._fields_of(transition))

    def _fields_of(self, transition: Transition) -> tuple:
        """As networks see them."""
        scale = self._spec.observation_scale
        return (
            transition.observation / scale,
            transition.action,
            [transition.reward],
            transition.next_observation / scale,
            self._spec.goal_space.normalise(transition.goal),
            [transition.discount],
        )

    def sample(self, batch: int) -> list[torch.Tensor]:
        """Observations, actions, rewards, next observations, goals, discounts: [batch, ...]."""
        rows = self._random.integers(0, len(self._held), batch)
        fields = zip(*(self._held[row] for row in rows), strict=True)
        return [torch.from_numpy(np.array(field, np.float32)) for field in fields]


class ArrayReplay(Replay):
    """A ring of transitions, an array for each of their fields."""

    def __init__(self, spec: LevelSpec, capacity: int, seed: int):
        super().__init__(spec, capacity, seed)
        self._added = 0
        observation, goal = spec.observation_dim, spec.goal_space.dim
        sizes = (observation, spec.action_dim, 1, observation, goal, 1)
        self._fields = [np.zeros((capacity, size), np.float32) for size in sizes]

    def add(self, transition: Transition) -> None:
        for field, value in zip(self._fields, self._fields_of(transition), strict=True):
            field[self._added % self._capacity] = value
        self._added += 1

    def sample(self, batch: int) -> list[torch.Tensor]:
        rows = self._random.integers(0, min(self._added, self._capacity), batch)
        return [torch.from_numpy(field[rows]) for field in self._fields]


class Level:
    """The actor-critic of one level: DDPG, with what `Config` says of targets and bounds."""

    def __init__(self, spec: LevelSpec, config: hac_suite.Config, replay: Replay):
        self._spec, self._config, self.replay = spec, config, replay
        features = spec.observation_dim + spec.goal_space.dim
        self._actor = _network((features, *config.hidden_sizes, spec.action_dim))
        self._critic = _network((features + spec.action_dim, *config.hidden_sizes, 1))
        self._target_actor = copy.deepcopy(self._actor)
        self._target_critic = copy.deepcopy(self._critic)
        self.actor_adam = torch.optim.Adam(self._actor.parameters(), config.learning_rate)
        self._critic_adam = torch.optim.Adam(self._critic.parameters(), config.learning_rate)
        self._offset = -math.log(spec.attempts / -config.initial_q - 1)

    def act(self, observation: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """The policy, for one environment: natural units to [-1, 1]."""
        seen = observation / self._spec.observation_scale, self._spec.goal_space.normalise(goal)
        with torch.no_grad():
            inputs = torch.from_numpy(np.concatenate(seen).astype(np.float32))
            return torch.tanh(self._actor(inputs)).numpy().astype(np.float64)

    def update(self, batch: int) -> None:
        """One step of critic, actor and targets."""
        observation, action, reward, after, goal, discount = self.replay.sample(batch)
        with torch.no_grad():
            following = torch.tanh(self._target_actor(torch.cat([after, goal], 1)))
            value = self._value(self._target_critic, after, goal, following)
            target = (reward + discount * value).clamp(-self._spec.attempts, 0)
        loss = functional.mse_loss(self._value(self._critic, observation, goal, action), target)
        _step(self._critic_adam, loss)
        raw = self._actor(torch.cat([observation, goal], 1))
        value = self._value(self._critic, observation, goal, torch.tanh(raw))
        penalty = self._config.saturation_penalty * raw.square().sum(1).mean()
        _step(self.actor_adam, penalty - value.mean())
        self._average(self._target_actor, self._actor)
        self._average(self._target_critic, self._critic)

    def _value(
        self, critic: nn.Module, observation: torch.Tensor, goal: torch.Tensor, action: torch.Tensor
    ) -> torch.Tensor:
        raw = critic(torch.cat([observation, goal, action], 1))
        return -self._spec.attempts * torch.sigmoid(raw + self._offset)

    @torch.no_grad()
    def _average(self, target: nn.Module, network: nn.Module) -> None:
        for mean, parameter in zip(target.parameters(), network.parameters(), strict=True):
            mean.lerp_(parameter, self._config.target_rate)


def _network(sizes: Sequence[int]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for inputs, outputs in itertools.pairwise(sizes):
        layers += [nn.Linear(inputs, outputs), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


def _step(optimiser: torch.optim.Optimizer, loss: torch.Tensor) -> None:
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()
