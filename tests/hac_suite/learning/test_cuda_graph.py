"""A captured round does what the same calls would, on the memory of the moment of the replay."""

import dataclasses

import numpy as np
import pytest
import torch

from hac_suite.algorithm.hierarchy import collect
from hac_suite.config import PAPER
from hac_suite.learning import cuda_graph
from hac_suite.training.population import Population
from tests.hac_suite.tiny_envs import PointEnv

SMALL = dataclasses.replace(
    PAPER, batch_size=32, updates_per_episode=3, hidden_sizes=(16, 16), replay_capacity=500
)
HORIZONS = (4, 3)


class Recorder:
    """Stands in for a GPU's capture: counts, and repeats by calling again."""

    def __init__(self):
        self.captures = self.replays = 0

    def __call__(self, work):
        self.captures += 1

        def replay():
            self.replays += 1
            work()

        return replay


def test_runs_then_captures_then_replays():
    recorder, total = Recorder(), torch.zeros(2)
    addresses = set()

    def update(inputs):
        addresses.add(inputs[0].data_ptr())
        total.add_(inputs[0])

    run = cuda_graph.CapturedRound(update, recorder)
    for value in (1.0, 10.0, 100.0):
        run([torch.full((2,), value)])
    assert total.tolist() == [111.0, 111.0]
    assert (recorder.captures, recorder.replays) == (1, 2)
    assert len(addresses) == 1  # a graph reads the memory that it was captured with


def trained(population_round) -> Population:
    """A population after four rounds, its updates done through `population_round(update)`."""
    env = PointEnv(2 * SMALL.episodes_per_round)
    population = Population(env, SMALL, HORIZONS, seeds=(3, 5))
    population._round = population_round(population._update)
    for number in range(4):
        draws = population.draw_round(env.max_steps)
        seeds = np.arange(env.num_envs) + 100 * number
        actors = population.exploring_actors()
        population.store(collect(env, actors, SMALL, HORIZONS, draws, seeds), draws)
        population.learn()
    return population


def test_a_population_learns_the_same_through_a_captured_round():
    plain = trained(lambda update: update)
    captured = trained(lambda update: cuda_graph.CapturedRound(update, Recorder()))
    for ours, theirs in zip(plain.learners, captured.learners, strict=True):
        for name in ("actor", "critic", "target_actor", "target_critic"):
            one, other = (getattr(learner, name).parameters for learner in (ours, theirs))
            assert torch.equal(one, other)
            assert one.any()


@pytest.mark.slow
def test_on_a_gpu_everything_an_update_touches_is_there():
    """The meta device has shapes and no memory: it refuses any operation that mixes devices."""
    population = Population(PointEnv(8), SMALL, HORIZONS, seeds=(3, 5), device=torch.device("meta"))
    for learner, replay in zip(population.learners, population.replays, strict=True):
        for network in (learner.actor, learner.critic, learner.target_actor):
            assert network.parameters.device.type == "meta"
        assert replay.rows.device.type == "meta"
    assert isinstance(population._round, cuda_graph.CapturedRound)
    assert all(len(parts) == 1 for parts in population._parts)  # all seeds at once
    updates = SMALL.updates_per_episode * SMALL.episodes_per_round
    population._update(
        [torch.zeros(updates, 2, 32, dtype=torch.int64, device="meta") for _ in HORIZONS]
    )
