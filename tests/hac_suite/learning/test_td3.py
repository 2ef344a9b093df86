"""TD3's targets, gradients and delays against values worked by hand and against autograd."""

import pytest
import torch

from hac_suite.learning.td3 import TD3, smoothing_noise
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

ACTIONS = LAYOUT.action_dim
NEXT_ACTION = slice(LAYOUT.block, LAYOUT.block + ACTIONS)


def always(critic, value: float) -> None:
    """Makes a critic's output one number."""
    critic.parameters.zero_()
    critic.weights[-1][:, 0, -1] = value


@pytest.mark.parametrize("values", [(-3.0, -5.0), (-5.0, -3.0)])
def test_the_target_is_of_the_lesser_critic(values):
    learner, rows = a_learner(TD3, bounded_critic=False), a_batch()
    for critic, value in zip((learner.target_critic, learner.target_second), values, strict=True):
        always(critic, value)
    target = learner._target(rows)
    expected = [-1 + 0.98 * -5.0, -1.0] * (ROWS // 2)
    assert target[1].tolist() == pytest.approx(expected)


def test_the_lesser_one_is_chosen_row_by_row():
    learner, rows = a_learner(TD3, bounded_critic=False), a_batch()
    shake(learner)
    after = rows[..., LAYOUT.block : 2 * LAYOUT.block].transpose(1, 2)
    found = learner._next_value(after)
    first, second = (
        learner._value(c, after) for c in (learner.target_critic, learner.target_second)
    )
    assert (first < second).any() and (second < first).any()
    assert torch.equal(found, torch.where(first < second, first, second))


def expected_target(learner: TD3, rows: torch.Tensor) -> torch.Tensor:
    """y = r + gamma_g min_k Q_k(s', clip(pi(s') + noise)), by ordinary products."""
    after = rows[..., LAYOUT.block : 2 * LAYOUT.block]
    noise, rest = after[..., :ACTIONS], after[..., ACTIONS:]
    raw = autograd_forward(learner.target_actor, learner.target_actor.parameters, rest)
    judged = torch.cat([(raw.tanh() + noise).clamp(-1, 1), rest], dim=-1)
    values = [
        learner.critic_kind.value(autograd_forward(critic, critic.parameters, judged)[..., 0])
        for critic in (learner.target_critic, learner.target_second)
    ]
    bound = learner.critic_kind.bound
    return (rows[..., -2] + rows[..., -1] * torch.stack(values).amin(0)).clamp(-bound, bound)


def a_wide_learner(**changes) -> TD3:
    learner = a_learner(TD3, **changes)
    shake(learner)
    return in_float64(learner)


@pytest.mark.parametrize("bounded", [True, False])
def test_both_critics_follow_the_gradient_of_their_losses(bounded):
    """The loss of a seed is the mean over its batch of (Q_1 - y)^2 + (Q_2 - y)^2."""
    learner, rows = a_wide_learner(bounded_critic=bounded), a_batch(dtype=torch.float64)
    target, block = expected_target(learner, rows), rows[..., : LAYOUT.block].clone()
    learner._critic_gradient(rows, ROWS, accumulate=False)
    for critic in (learner.critic, learner.second_critic):
        flat = parameters_of(critic)
        value = learner.critic_kind.value(autograd_forward(critic, flat, block)[..., 0])
        (expected,) = torch.autograd.grad(((value - target) ** 2).mean(dim=1).sum(), flat)
        assert expected.any()
        torch.testing.assert_close(critic.gradient, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("bounded", [True, False])
def test_the_actor_follows_the_gradient_of_the_first_critic(bounded):
    """The loss of a seed is the mean over its batch of -Q_1(s, tanh(u)) + penalty * |u|^2."""
    learner = a_wide_learner(bounded_critic=bounded, saturation_penalty=0.5)
    block = a_batch(dtype=torch.float64)[..., : LAYOUT.block]
    flat = parameters_of(learner.actor)
    before_tanh = autograd_forward(learner.actor, flat, block[..., ACTIONS:])
    judged = torch.cat([before_tanh.tanh(), block[..., ACTIONS:]], dim=-1)
    raw = autograd_forward(learner.critic, learner.critic.parameters, judged)[..., 0]
    loss = 0.5 * (before_tanh**2).sum(dim=-1) - learner.critic_kind.value(raw)
    (expected,) = torch.autograd.grad(loss.mean(dim=1).sum(), flat)
    learner._actor_gradient(a_batch(dtype=torch.float64), ROWS, accumulate=False)
    torch.testing.assert_close(learner.actor.gradient, expected, rtol=1e-9, atol=1e-12)


def test_actor_and_targets_take_a_step_with_each_third_of_the_critics():
    learner = a_learner(TD3, policy_delay=3, target_rate=0.25)
    pairs = [
        (learner.target_actor, learner.actor),
        (learner.target_critic, learner.critic),
        (learner.target_second, learner.second_critic),
    ]
    for number in range(1, 8):
        before = [network.parameters.clone() for pair in pairs for network in pair]
        learner.update(a_batch())
        moved = [
            not torch.equal(network.parameters, old)
            for network, old in zip([n for pair in pairs for n in pair], before, strict=True)
        ]
        settled = number % 3 == 0
        assert moved == [settled, settled, settled, True, settled, True], number
        for (target, online), old in zip(pairs, before[::2], strict=True):
            if settled:
                expected = old + 0.25 * (online.parameters - old)
                torch.testing.assert_close(target.parameters, expected)
    assert learner.updates().tolist() == [7, 7]
    assert learner.actor_optimiser.steps.tolist() == [2, 2]


def test_with_a_delay_of_one_the_actor_steps_each_time():
    learner = a_learner(TD3, policy_delay=1)
    for _ in range(3):
        learner.update(a_batch())
    assert learner.actor_optimiser.steps.tolist() == [3, 3]


def test_smoothing_noise_is_scaled_and_clipped():
    learner, rows = a_learner(TD3, target_noise=0.4, target_noise_clip=0.5), a_batch()
    learner._write_noise(rows, [8, 8])
    for seed in range(2):
        drawn = 0.4 * smoothing_noise(learner._bases[seed], 8, (ROWS, ACTIONS))
        assert (drawn.abs() > 0.5).any() and (drawn.abs() < 0.5).any()
        assert torch.equal(rows[seed, :, NEXT_ACTION], drawn.clamp(-0.5, 0.5))


def test_an_action_with_its_noise_stays_in_range():
    """Both ends of the range, and all between: outputs near 0 keep the noise as it is."""
    learner, rows = a_learner(TD3), a_batch()
    always(learner.target_actor, 0.0)
    learner.target_actor.weights[-1][:, 1, -1] = 100.0  # tanh of it is 1
    rows[..., NEXT_ACTION] = 0.3
    learner._target(rows)
    assert rows[..., NEXT_ACTION][0, 0].tolist() == pytest.approx([0.3, 1.0])


def test_noise_is_of_a_seed_and_of_a_time():
    shape, learner = (1000, ACTIONS), a_learner(TD3)
    assert len(set(learner._bases)) == 2
    drawn = [smoothing_noise(base, n, shape) for base in learner._bases for n in (0, 1, 2)]
    for index, noise in enumerate(drawn):
        assert abs(noise.mean()) < 0.1 and abs(noise.std() - 1) < 0.1
        for other in drawn[:index]:  # as streams of their own: 1 / sqrt(2000) by chance
            assert abs((noise * other).mean()) < 0.1
    assert torch.equal(drawn[1], smoothing_noise(learner._bases[0], 1, shape))


def test_the_noise_reaches_what_is_learnt():
    still, smoothed = a_learner(TD3, target_noise=0.0), a_learner(TD3)
    for learner in (still, smoothed):
        learner.update(a_batch())
    assert not torch.equal(still.critic.parameters, smoothed.critic.parameters)


def test_the_critics_differ_from_the_start():
    learner = a_learner(TD3)
    assert not torch.equal(learner.critic.parameters, learner.second_critic.parameters)
    assert torch.equal(learner.target_second.parameters, learner.second_critic.parameters)


def test_a_learner_derived_from_it_needs_target_networks_too():
    with pytest.raises(ValueError, match="TD3 has target networks"):
        a_learner(type("Mine", (TD3,), {}), target_rate=0.0)
