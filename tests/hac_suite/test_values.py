"""Q of policies: what the learner's own critic says, before and after the file."""

import numpy as np
import pytest
import torch

import hac_suite
from hac_suite.algorithm.transitions import Transitions
from hac_suite.learning.replay import RowLayout
from hac_suite.training.population import Population
from hac_suite.types import level_specs
from tests.hac_suite.tiny_envs import PointEnv

HORIZONS = (4, 3)


class OffsetEnv(PointEnv):
    """Positions far from zero, as fitted tasks have them."""

    observation_offset = np.array([2.0, -3.0, 0.0, 0.0])


def population(**settings) -> Population:
    """Two seeds whose critics have something to say."""
    config = hac_suite.Config(hidden_sizes=(8, 8), **settings)
    made = Population(OffsetEnv(2), config, HORIZONS, (5, 6))
    for learner in made.learners:
        for seed in range(2):
            learner.critic.initialise(seed, torch.Generator().manual_seed(seed), last=0.5)
            learner.actor.initialise(seed, torch.Generator().manual_seed(9 + seed), last=1.0)
            learner.tested_actor.parameters.copy_(learner.actor.parameters)
    return made


def q_values(policy: hac_suite.Policy, config: hac_suite.Config) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    specs = level_specs(OffsetEnv(5), HORIZONS)
    goals = [rng.normal(size=(5, spec.goal_space.dim)) for spec in specs]
    return hac_suite.q_values(policy, specs, config, rng.normal(size=(5, 4)), goals)


def by_the_learner(trained: Population, seed: int) -> list[np.ndarray]:
    """The same by the learner itself, from rows of its replay's layout."""
    rng = np.random.default_rng(0)
    specs = level_specs(OffsetEnv(5), HORIZONS)
    goals = [rng.normal(size=(5, spec.goal_space.dim)) for spec in specs]
    observation = rng.normal(size=(5, 4))
    found = []
    for learner, spec, goal in zip(trained.learners, specs, goals, strict=True):
        zeros, action = np.zeros(5), np.zeros((5, spec.action_dim))
        stored = Transitions(zeros, zeros, observation, action, zeros, observation, goal, zeros)
        layout = RowLayout.of(spec)
        rows = torch.from_numpy(layout.pack(stored, spec)[:, : layout.block].T.copy())
        block = rows.expand(2, -1, -1).contiguous()
        learner._act(learner.tested_actor, block)
        found.append(learner._value(learner.critic, block)[seed].numpy().copy())
    return found


@pytest.mark.parametrize("learner", ["ddpg", "td3"])
@pytest.mark.parametrize("bounded", [True, False])
def test_q_is_what_the_learner_says(learner, bounded, tmp_path):
    trained = population(learner=learner, bounded_critic=bounded)
    for seed, policy in enumerate(trained.policies()):
        expected = by_the_learner(trained, seed)
        assert (
            np.ptp(expected[0]) > 0.05 * np.abs(expected[0]).mean()
        )  # it is not the same of everything
        for q, by_learner in zip(q_values(policy, trained.config), expected, strict=True):
            np.testing.assert_allclose(q, by_learner, rtol=1e-5)
        policy.save(tmp_path / "p", {})
        loaded = hac_suite.Policy.load(tmp_path / "p")
        for ours, kept in zip(
            q_values(policy, trained.config), q_values(loaded, trained.config), strict=True
        ):
            np.testing.assert_array_equal(ours, kept)


def test_a_bounded_q_is_within_its_bounds():
    trained = population()
    for q, attempts in zip(q_values(trained.policies()[0], trained.config), HORIZONS, strict=True):
        assert (-attempts < q).all() and (q < 0).all()


def test_a_policy_without_critics_has_no_q():
    trained = population()
    policy = hac_suite.Policy.of_seed(trained.tested_networks(), 0, HORIZONS)
    assert q_values(policy, trained.config) == []
