"""The actor-critic of one level, for a population of seeds (Sections 2 and 3.1): DDPG by hand.

All passes are batched over seeds and no operation mixes them, so a seed learns the same, bit for
bit, in any population.
"""

import math

import torch
from torch.nn import functional

from hac_suite.config import Config
from hac_suite.networks import StackedMLP
from hac_suite.replay import RowLayout
from hac_suite.types import LevelSpec

_REGISTERS = 32  # floats; a multiple of every vector width


class BoundedCritic:
    """Maps a critic's raw output x to Q = -T * sigmoid(x + offset), in (-T, 0) [R20].

    No return lies outside: each action costs 1 and T of them are all a level has. `offset` makes
    an untrained critic (x near 0) optimistic: Q near `initial_q`.
    """

    def __init__(self, attempts: int, initial_q: float):
        self.bound = float(attempts)
        self._offset = -math.log(self.bound / -initial_q - 1)

    def value(self, raw: torch.Tensor) -> torch.Tensor:
        """Q of raw outputs [..., B]."""
        # What is left over after whole vector registers goes through another sigmoid, with other
        # roundings: rows are filled up, so that nothing is left over whatever the population.
        left_over = raw.shape[-1] % _REGISTERS if raw.ndim else 0
        filled = functional.pad(raw, (0, _REGISTERS - left_over)) if left_over else raw
        value = torch.sigmoid(filled + self._offset) * -self.bound
        return value[..., : raw.shape[-1]] if left_over else value

    def raw_gradient(self, gradient: torch.Tensor, value: torch.Tensor) -> torch.Tensor:
        """d loss / dx from d loss / dQ: dQ/dx = Q * (1 + Q / T)."""
        return gradient * value * (1 + value / self.bound)

    def clip(self, target: torch.Tensor) -> torch.Tensor:
        return target.clamp_(-self.bound, 0)


class UnboundedCritic:
    """Q is the critic's raw output, and targets are taken as they come [R18]."""

    bound = math.inf

    def value(self, raw: torch.Tensor) -> torch.Tensor:
        return raw.clone()

    def raw_gradient(self, gradient: torch.Tensor, value: torch.Tensor) -> torch.Tensor:
        return gradient

    def clip(self, target: torch.Tensor) -> torch.Tensor:
        return target


def critic_gradient(value: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """d/dQ of each seed's loss, the mean over the batch of (Q - y)^2: [S, B]."""
    return (value - target).mul_(2 / value.shape[1])


class Learner:
    """Actor, critic, their targets and optimisers of one level for S seeds."""

    def __init__(self, spec: LevelSpec, config: Config, generators: list[torch.Generator]):
        seeds, features = len(generators), spec.observation_dim + spec.goal_space.dim
        actor_sizes = (features, *config.hidden_sizes, spec.action_dim)
        critic_sizes = (features + spec.action_dim, *config.hidden_sizes, 1)
        self._layout = RowLayout.of(spec)
        self._target_rate = config.target_rate
        self._saturation_penalty = config.saturation_penalty
        self.actor = StackedMLP(seeds, actor_sizes)
        self.critic = StackedMLP(seeds, critic_sizes)
        for seed, generator in enumerate(generators):
            self.actor.initialise(seed, generator)
            self.critic.initialise(seed, generator)
        self.target_actor = self._target_of(self.actor, actor_sizes)
        self.target_critic = self._target_of(self.critic, critic_sizes)
        self.critic_kind = (
            BoundedCritic(spec.attempts, config.initial_q)
            if config.bounded_critic
            else UnboundedCritic()
        )
        self.optimisers = [
            torch.optim.Adam([network.parameters], lr=config.learning_rate, fused=True)
            for network in (self.critic, self.actor)
        ]
        for network in (self.critic, self.actor):
            network.parameters.grad = network.gradient

    def _target_of(self, network: StackedMLP, sizes: tuple[int, ...]) -> StackedMLP:
        if not self._target_rate:
            return network
        target = StackedMLP(network.parameters.shape[0], sizes)
        target.parameters.copy_(network.parameters)
        return target

    def update(self, rows: torch.Tensor) -> None:
        """One step of critic, actor and targets on rows [S, B, width] (overwritten)."""
        layout = self._layout
        now, after = rows[..., : layout.block], rows[..., layout.block : 2 * layout.block]
        target = self._target(after, rows[..., -2], rows[..., -1])
        self._update_critic(now, target)
        self._update_actor(now)
        if self._target_rate:
            self.target_actor.parameters.lerp_(self.actor.parameters, self._target_rate)
            self.target_critic.parameters.lerp_(self.critic.parameters, self._target_rate)

    def _target(
        self, after: torch.Tensor, reward: torch.Tensor, discount: torch.Tensor
    ) -> torch.Tensor:
        """y = r + gamma_g Q(s', pi(s', g), g): [S, B]."""
        self._act(self.target_actor, after)
        value = self.critic_kind.value(self.target_critic.forward(after)[..., 0])
        return self.critic_kind.clip(value.mul_(discount).add_(reward))

    def _act(self, actor: StackedMLP, block: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Writes the actor's output into the block's action columns.

        Returns:
            The output [S, B, A], and what it was before the tanh.
        """
        actions = self._layout.action_dim
        raw = actor.forward(block[..., actions:])
        output = torch.tanh(raw)
        block[..., :actions] = output
        return output, raw

    def _update_critic(self, now: torch.Tensor, target: torch.Tensor) -> None:
        value = self.critic_kind.value(self.critic.forward(now)[..., 0])
        gradient = self.critic_kind.raw_gradient(critic_gradient(value, target), value)
        self.critic.backward(gradient.unsqueeze(-1))
        self.optimisers[0].step()

    def _update_actor(self, now: torch.Tensor) -> None:
        """Ascends the mean over the batch of Q(s, pi(s, g), g), less the penalty on saturation.

        Where tanh is flat, Q gives the actor nothing to follow; the penalty on its argument does.
        """
        output, before_tanh = self._act(self.actor, now)
        value = self.critic_kind.value(self.critic.forward(now)[..., 0])
        ascent = torch.full_like(value, -1 / value.shape[1])
        raw = self.critic_kind.raw_gradient(ascent, value).unsqueeze(-1)
        to_action = self.critic.backward(raw, parameters=False, inputs=self._layout.action_dim)
        assert to_action is not None
        pull = before_tanh * (2 * self._saturation_penalty / value.shape[1])
        self.actor.backward(to_action.mul_(1 - output * output).add_(pull))
        self.optimisers[1].step()

    def diagnose(self, rows: torch.Tensor) -> dict[str, list[float]]:
        """Per seed: mean and least Q of the policy, share of Q at the bound, saturation."""
        block = rows[..., : self._layout.block]
        output, _ = self._act(self.actor, block)
        value = self.critic_kind.value(self.critic.forward(block)[..., 0])
        return {
            "q_mean": value.mean(1).tolist(),
            "q_min": value.amin(1).tolist(),
            "q_at_bound": (value < -0.95 * self.critic_kind.bound).float().mean(1).tolist(),
            "saturation": (output.abs() > 0.99).float().mean((1, 2)).tolist(),
        }
