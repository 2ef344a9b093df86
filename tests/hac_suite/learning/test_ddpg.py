"""Losses, targets and updates against values worked by hand and against autograd."""

import dataclasses
import math

import numpy as np
import pytest
import torch

from hac_suite.config import PAPER
from hac_suite.learning import ddpg as learner_module
from hac_suite.learning.ddpg import BoundedCritic, Learner, UnboundedCritic
from hac_suite.learning.networks import StackedMLP
from hac_suite.learning.replay import RowLayout
from hac_suite.types import LevelSpec
from tasks.goal_space import GoalSpace

GOALS = GoalSpace(("x",), ("m",), np.array([-2.0]), np.array([2.0]), np.array([0.1]))
SPEC = LevelSpec(observation_scale=np.ones(2), goal_space=GOALS, action_dim=2, attempts=10)
LAYOUT = RowLayout.of(SPEC)
ROWS = 16


def a_batch(seeds: int = 2, dtype: torch.dtype = torch.float32) -> torch.Tensor:
    generator = torch.Generator().manual_seed(7)
    rows = torch.randn(seeds, ROWS, LAYOUT.width, generator=generator)
    rows[..., LAYOUT.block - 1] = rows[..., 2 * LAYOUT.block - 1] = 1
    rows[..., -2] = -1
    rows[..., -1] = torch.tensor([0.98, 0.0] * (ROWS // 2))
    return rows.to(dtype)


def a_learner(seeds: int = 2, **changes) -> Learner:
    config = dataclasses.replace(PAPER, **changes)
    return Learner(SPEC, config, [torch.Generator().manual_seed(s) for s in range(seeds)])


def test_bounded_critic_by_hand():
    critic = BoundedCritic(floor=10, initial_q=-0.1)
    # Raw 0 is the optimistic start; raw = +offset' with sigmoid = 1/2 is half the bound.
    assert critic.value(torch.tensor([0.0])).item() == pytest.approx(-0.1)
    assert critic.value(torch.tensor([math.log(99.0)])).item() == pytest.approx(-5.0)
    assert critic.clip(torch.tensor([-11.0, -3.0, 1.0])).tolist() == [-10.0, -3.0, 0.0]
    # dQ/dx = -T s (1 - s): at s = 1/2, -10 / 4.
    slope = critic.raw_gradient(torch.tensor(1.0), torch.tensor(-5.0))
    assert slope.item() == pytest.approx(-2.5)


def test_unbounded_critic_is_the_identity():
    critic, raw = UnboundedCritic(), torch.tensor([-300.0, 4.0])
    assert torch.equal(critic.value(raw), raw)
    assert torch.equal(critic.clip(raw), raw)
    assert torch.equal(critic.raw_gradient(raw, torch.zeros(2)), raw)


def test_target_by_hand():
    """y = r + gamma_g Q': an untrained critic's Q' is initial_q, and gamma_g = 0 drops it."""
    learner = a_learner(seeds=1)
    learner.target_critic.parameters.zero_()
    rows = a_batch(1)[:, :6]
    rows[..., -2] = torch.tensor([[-1.0, -1.0, -1.0, -10.0, 0.0, -1.0]])
    rows[..., -1] = torch.tensor([[0.98, 0.98, 0.0, 0.0, 0.0, 0.98]])
    target = learner._target(rows)
    bootstrapped = -1 - 0.98 * 0.067
    expected = [bootstrapped, bootstrapped, -1.0, -10.0, 0.0, bootstrapped]
    assert target[0].tolist() == pytest.approx(expected, abs=1e-6)


def autograd_forward(network: StackedMLP, flat: torch.Tensor, block: torch.Tensor) -> torch.Tensor:
    """What the network with these parameters says, by ordinary products."""
    hidden = block
    for index, weight in enumerate(network._views(flat)):
        if index:
            hidden = torch.cat([hidden.relu(), torch.ones_like(hidden[..., :1])], dim=-1)
        hidden = hidden @ weight.transpose(1, 2)
    return hidden[..., : network.outputs]


def parameters_of(network: StackedMLP) -> torch.Tensor:
    return network.parameters.detach().clone().requires_grad_()


@pytest.mark.parametrize("bounded", [True, False])
def test_critic_update_follows_the_gradient_of_its_loss(bounded):
    """The loss of a seed is the mean over its batch of (Q - y)^2."""
    learner, rows = a_learner(bounded_critic=bounded), a_batch()
    block = rows[..., : LAYOUT.block]
    target = learner._target(rows)
    flat = parameters_of(learner.critic)
    value = learner.critic_kind.value(autograd_forward(learner.critic, flat, block)[..., 0])
    (expected,) = torch.autograd.grad(((value - target) ** 2).mean(dim=1).sum(), flat)
    learner._critic_gradient(rows, ROWS, accumulate=False)
    torch.testing.assert_close(learner.critic.gradient, expected, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("penalty", [0.0, 0.5])
@pytest.mark.parametrize("bounded", [True, False])
def test_actor_update_follows_the_gradient_of_its_loss(bounded, penalty):
    """The loss of a seed is the mean over its batch of -Q(s, tanh(u)) + penalty * |u|^2."""
    learner = a_learner(bounded_critic=bounded, saturation_penalty=penalty)
    for network in (learner.actor, learner.critic):
        network.parameters.copy_(torch.randn(network.parameters.shape) * 0.3)
    block, actions = a_batch()[..., : LAYOUT.block], LAYOUT.action_dim
    flat = parameters_of(learner.actor)
    before_tanh = autograd_forward(learner.actor, flat, block[..., actions:])
    judged = torch.cat([before_tanh.tanh(), block[..., actions:]], dim=-1)
    raw = autograd_forward(learner.critic, learner.critic.parameters, judged)[..., 0]
    loss = penalty * (before_tanh**2).sum(dim=-1) - learner.critic_kind.value(raw)
    (expected,) = torch.autograd.grad(loss.mean(dim=1).sum(), flat)
    learner._actor_gradient(a_batch(), ROWS, accumulate=False)
    torch.testing.assert_close(learner.actor.gradient, expected, rtol=1e-4, atol=1e-6)


def test_actor_update_raises_the_critics_value():
    learner, rows = a_learner(target_rate=0.0), a_batch()
    learner.critic.parameters.copy_(torch.randn(learner.critic.parameters.shape) * 0.3)

    def mean_value() -> torch.Tensor:
        block = learner._now(rows.clone())
        learner._act(learner.actor, block)
        return learner._value(learner.critic, block).mean(dim=1)

    before = mean_value()
    for _ in range(20):
        learner._actor_gradient(rows.clone(), ROWS, accumulate=False)
        learner.actor_optimiser.step()
    assert (mean_value() > before).all()


def test_targets_follow_at_the_target_rate():
    learner = a_learner(target_rate=0.25)
    old_target, rows = learner.target_actor.parameters.clone(), a_batch()
    learner.update(rows)
    expected = old_target + 0.25 * (learner.actor.parameters - old_target)
    torch.testing.assert_close(learner.target_actor.parameters, expected)
    assert not torch.equal(learner.actor.parameters, old_target)


def test_a_batch_in_pieces_updates_as_a_whole_one(monkeypatch):
    whole, pieces = a_learner(), a_learner()
    for _ in range(3):
        whole.update(a_batch())
    monkeypatch.setattr(learner_module, "_CACHED_ROWS", 6)
    for _ in range(3):
        pieces.update(a_batch())
    for name in ("actor", "critic", "target_actor", "target_critic"):
        found, expected = (getattr(of, name).parameters for of in (pieces, whole))
        torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)


def test_the_learner_of_some_seeds_updates_theirs_alone():
    together, apart = a_learner(seeds=3), a_learner(seeds=3)
    parts = [apart.of_seeds(0, 1), apart.of_seeds(1, 3)]
    for _ in range(3):
        together.update(a_batch(3))
        for part, rows in zip(parts, a_batch(3).split([1, 2]), strict=True):
            part.update(rows)
    for name in ("actor", "critic", "target_actor", "target_critic"):
        found, expected = (getattr(of, name).parameters for of in (apart, together))
        assert torch.equal(found, expected)


def test_the_tested_actor_follows_at_its_rate_and_changes_nothing_else():
    learner, other = a_learner(tested_actor_rate=0.8), a_learner(tested_actor_rate=0.0)
    average = learner.actor.parameters.clone()
    for share in (10 / 11, 10 / 12, 0.8, 0.8):  # 10 / (n + 10), but no less than the rate
        learner.update(a_batch())
        other.update(a_batch())
        average += share * (learner.actor.parameters - average)
    torch.testing.assert_close(learner.tested_actor.parameters, average)
    assert torch.equal(learner.actor.parameters, other.actor.parameters)
    assert other.tested_actor is other.actor


def test_without_target_networks_the_online_ones_serve():
    learner = a_learner(target_rate=0.0)
    assert learner.target_actor is learner.actor
    assert learner.target_critic is learner.critic
