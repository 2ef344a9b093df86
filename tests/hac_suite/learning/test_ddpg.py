"""Losses, targets and updates against values worked by hand and against autograd."""

import math

import pytest
import torch

from hac_suite.learning.ddpg import DDPG, BoundedCritic, UnboundedCritic
from tests.hac_suite.learning.level import (
    LAYOUT,
    ROWS,
    a_batch,
    a_learner,
    autograd_forward,
    in_float64,
    parameters_of,
    shake,
)


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
    learner = a_learner(DDPG, seeds=1)
    learner.target_critic.parameters.zero_()
    rows = a_batch(1)[:, :6]
    rows[..., -2] = torch.tensor([[-1.0, -1.0, -1.0, -10.0, 0.0, -1.0]])
    rows[..., -1] = torch.tensor([[0.98, 0.98, 0.0, 0.0, 0.0, 0.98]])
    target = learner._target(rows)
    bootstrapped = -1 - 0.98 * 0.067
    expected = [bootstrapped, bootstrapped, -1.0, -10.0, 0.0, bootstrapped]
    assert target[0].tolist() == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("bounded", [True, False])
def test_critic_update_follows_the_gradient_of_its_loss(bounded):
    """The loss of a seed is the mean over its batch of (Q - y)^2."""
    learner = in_float64(a_learner(DDPG, bounded_critic=bounded))
    rows = a_batch(dtype=torch.float64)
    block = rows[..., : LAYOUT.block]
    target = learner._target(rows)
    flat = parameters_of(learner.critic)
    value = learner.critic_kind.value(autograd_forward(learner.critic, flat, block)[..., 0])
    (expected,) = torch.autograd.grad(((value - target) ** 2).mean(dim=1).sum(), flat)
    learner._critic_gradient(rows, ROWS, accumulate=False)
    torch.testing.assert_close(learner.critic.gradient, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("penalty", [0.0, 0.5])
@pytest.mark.parametrize("bounded", [True, False])
def test_actor_update_follows_the_gradient_of_its_loss(bounded, penalty):
    """The loss of a seed is the mean over its batch of -Q(s, tanh(u)) + penalty * |u|^2."""
    learner = a_learner(DDPG, bounded_critic=bounded, saturation_penalty=penalty)
    shake(learner)
    in_float64(learner)
    block, actions = a_batch(dtype=torch.float64)[..., : LAYOUT.block], LAYOUT.action_dim
    flat = parameters_of(learner.actor)
    before_tanh = autograd_forward(learner.actor, flat, block[..., actions:])
    judged = torch.cat([before_tanh.tanh(), block[..., actions:]], dim=-1)
    raw = autograd_forward(learner.critic, learner.critic.parameters, judged)[..., 0]
    loss = penalty * (before_tanh**2).sum(dim=-1) - learner.critic_kind.value(raw)
    (expected,) = torch.autograd.grad(loss.mean(dim=1).sum(), flat)
    learner._actor_gradient(a_batch(dtype=torch.float64), ROWS, accumulate=False)
    torch.testing.assert_close(learner.actor.gradient, expected, rtol=1e-9, atol=1e-12)


def test_actor_update_raises_the_critics_value():
    learner, rows = a_learner(DDPG, target_rate=0.0), a_batch()
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
    learner = a_learner(DDPG, target_rate=0.25)
    old_target, rows = learner.target_actor.parameters.clone(), a_batch()
    learner.update(rows)
    expected = old_target + 0.25 * (learner.actor.parameters - old_target)
    torch.testing.assert_close(learner.target_actor.parameters, expected)
    assert not torch.equal(learner.actor.parameters, old_target)


def test_the_tested_actor_follows_at_its_rate_and_changes_nothing_else():
    learner, other = a_learner(DDPG, tested_actor_rate=0.8), a_learner(DDPG, tested_actor_rate=0.0)
    average = learner.actor.parameters.clone()
    for share in (10 / 11, 10 / 12, 0.8, 0.8):  # 10 / (n + 10), but no less than the rate
        learner.update(a_batch())
        other.update(a_batch())
        average += share * (learner.actor.parameters - average)
    torch.testing.assert_close(learner.tested_actor.parameters, average)
    assert torch.equal(learner.actor.parameters, other.actor.parameters)
    assert other.tested_actor is other.actor


def test_without_target_networks_the_online_ones_serve():
    learner = a_learner(DDPG, target_rate=0.0)
    assert learner.target_actor is learner.actor
    assert learner.target_critic is learner.critic
