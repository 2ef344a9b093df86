"""The actor-critic of one level, for a population of seeds (Sections 2 and 3.1): DDPG by hand.

All passes are batched over seeds and no operation mixes them, so a seed learns the same, bit for
bit, in any population. Batches come in pieces that stay in the processor's cache; their gradients
add up.
"""

import copy
import math
from collections.abc import Sequence
from typing import Self

import torch

from hac_suite.config import Config
from hac_suite.learning.adam import Adam
from hac_suite.learning.learner import Learner
from hac_suite.learning.mixed import PRECISIONS
from hac_suite.learning.networks import StackedMLP, in_whole_registers
from hac_suite.learning.replay import RowLayout
from hac_suite.types import LevelSpec

_AVERAGED_PART = 10.0  # a tested actor averages over about the last 1/10 of its updates, at first


class BoundedCritic:
    """Maps a critic's raw output x to Q = -F * sigmoid(x + offset), in (-F, 0) [R20].

    Targets are clipped to [-F, 0]: see `critic_floor`. `offset` makes an untrained critic (x near
    0) optimistic: Q near `initial_q`.
    """

    def __init__(self, floor: float, initial_q: float):
        self.bound = float(floor)
        self._offset = -math.log(self.bound / -initial_q - 1)

    def value(self, raw: torch.Tensor) -> torch.Tensor:
        """Q of raw outputs [..., B]."""
        return in_whole_registers(torch.sigmoid, raw + self._offset) * -self.bound

    def raw_gradient(self, gradient: torch.Tensor, value: torch.Tensor) -> torch.Tensor:
        """d loss / dx from d loss / dQ: dQ/dx = Q * (1 + Q / F)."""
        return gradient * value * (1 + value / self.bound)

    def clip(self, target: torch.Tensor) -> torch.Tensor:
        return target.clamp_(-self.bound, 0)


def critic_floor(attempts: int, config: Config) -> float:
    """F > 0: the worst that a level with so many attempts can do is worth -F.

    Each attempt costs 1, and T_i of them are all a level has: F = T_i [R20]. Discounted, they cost
    1 + g + ... + g^(T_i - 1) together, which is far less where T_i is large: 50 for 500 attempts
    at g = 0.98. What lies below, such as a penalty of -T_i, counts as -F.
    """
    g = config.discount
    if config.critic_floor == "attempts" or g == 1:
        return float(attempts)
    return (1 - g**attempts) / (1 - g)


class UnboundedCritic:
    """Q is the critic's raw output, and targets are taken as they come [R18]."""

    bound = math.inf

    def value(self, raw: torch.Tensor) -> torch.Tensor:
        return raw.clone()

    def raw_gradient(self, gradient: torch.Tensor, value: torch.Tensor) -> torch.Tensor:
        return gradient

    def clip(self, target: torch.Tensor) -> torch.Tensor:
        return target


def critic_kind(spec: LevelSpec, config: Config) -> BoundedCritic | UnboundedCritic:
    """What a level's critic makes of its network's raw output."""
    if config.bounded_critic:
        return BoundedCritic(critic_floor(spec.attempts, config), config.initial_q)
    return UnboundedCritic()


class DDPG(Learner):
    """Actor, critic, their targets, averages and optimisers of one level for S seeds."""

    on_gpu = True
    in_bf16 = True

    def __init__(
        self,
        spec: LevelSpec,
        config: Config,
        generators: list[torch.Generator],
        device: torch.device | str = "cpu",
    ):
        seeds, features = len(generators), spec.observation_dim + spec.goal_space.dim
        self._layout = RowLayout.of(spec)
        self._target_rate = config.target_rate
        self._tested_rate = config.tested_actor_rate
        self._saturation_penalty = config.saturation_penalty
        networks, _, self._rows_at_a_time = PRECISIONS[config.precision]
        sizes = (*config.hidden_sizes, spec.action_dim)
        self.actor = networks(seeds, (features, *sizes), device=device)
        sizes = (*config.hidden_sizes, 1)
        self.critic = networks(seeds, (features + spec.action_dim, *sizes), device=device)
        for index, generator in enumerate(generators):
            self.actor.initialise(index, generator)
            self.critic.initialise(index, generator)
        self.target_actor = self.actor.twin() if config.target_rate else self.actor
        self.target_critic = self.critic.twin() if config.target_rate else self.critic
        self.tested_actor = self.actor.twin() if config.tested_actor_rate else self.actor
        self.critic_kind = critic_kind(spec, config)
        self.actor_optimiser = Adam(self.actor, config.learning_rate)
        self.critic_optimiser = Adam(self.critic, config.learning_rate)

    def of_seeds(self, start: int, stop: int) -> Self:
        """The learner of some of the seeds: it updates their rows of the same memory."""
        part = copy.copy(self)
        part.actor, part.critic = (n.of_seeds(start, stop) for n in (self.actor, self.critic))
        part.target_actor, part.target_critic = part.actor, part.critic
        part.tested_actor = part.actor
        if self._target_rate:
            part.target_actor = self.target_actor.of_seeds(start, stop)
            part.target_critic = self.target_critic.of_seeds(start, stop)
        if self._tested_rate:
            part.tested_actor = self.tested_actor.of_seeds(start, stop)
        part.actor_optimiser = self.actor_optimiser.of_seeds(start, stop, part.actor)
        part.critic_optimiser = self.critic_optimiser.of_seeds(start, stop, part.critic)
        return part

    def tensors(self, index: int) -> dict[str, torch.Tensor]:
        """Views of all that one seed's updates have made: networks and optimisers."""
        networks = {"actor": self.actor, "critic": self.critic}
        if self._target_rate:
            networks |= {"target_actor": self.target_actor, "target_critic": self.target_critic}
        if self._tested_rate:
            networks["tested_actor"] = self.tested_actor
        found = {name: network.parameters[index] for name, network in networks.items()}
        for name, optimiser in (("actor", self.actor_optimiser), ("critic", self.critic_optimiser)):
            found |= {f"{name}.{part}": of for part, of in optimiser.tensors(index).items()}
        return found

    def parameters(self) -> list[torch.Tensor]:
        return [self.actor.parameters, self.critic.parameters]

    def updates(self) -> torch.Tensor:
        return self.critic_optimiser.steps

    def update(self, rows: torch.Tensor) -> None:
        """One step of critic, actor and targets on rows [S, B, width] (overwritten)."""
        batch, pieces = rows.shape[1], self._pieces(rows)
        self._critic_step(pieces, batch)
        self._actor_step(pieces, batch)

    def _pieces(self, rows: torch.Tensor) -> Sequence[torch.Tensor]:
        few = self._rows_at_a_time if rows.device.type == "cpu" else rows.shape[1]
        return rows.split(few, dim=1)

    def _critic_step(self, pieces: Sequence[torch.Tensor], batch: int) -> None:
        for first, piece in enumerate(pieces):
            self._critic_gradient(piece, batch, accumulate=first > 0)
        self.critic_optimiser.step()

    def _actor_step(self, pieces: Sequence[torch.Tensor], batch: int) -> None:
        """A step of the actor, and of all that follows it or the critic."""
        for first, piece in enumerate(pieces):
            self._actor_gradient(piece, batch, accumulate=first > 0)
        self.actor_optimiser.step()
        if self._target_rate:
            self.target_actor.parameters.lerp_(self.actor.parameters, self._target_rate)
            self.target_critic.parameters.lerp_(self.critic.parameters, self._target_rate)
        if self._tested_rate:
            recent = _AVERAGED_PART / (self.actor_optimiser.steps + _AVERAGED_PART)
            share = recent.clamp_(min=self._tested_rate).unsqueeze(1)
            self.tested_actor.parameters.lerp_(self.actor.parameters, share)

    def _now(self, rows: torch.Tensor) -> torch.Tensor:
        """[action | observation | goal | 1] of rows [S, B, width], feature-major."""
        return rows[..., : self._layout.block].transpose(1, 2)

    def _act(self, actor: StackedMLP, block: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Writes the actor's output into the block's action rows.

        Returns:
            The output [S, A, B], and what it was before the tanh.
        """
        actions = self._layout.action_dim
        raw = actor.forward(block[:, actions:])
        output = in_whole_registers(torch.tanh, raw)
        block[:, :actions] = output
        return output, raw

    def _value(self, critic: StackedMLP, block: torch.Tensor) -> torch.Tensor:
        """Q of every column of the block: [S, B]."""
        return self.critic_kind.value(critic.forward(block)[:, 0])

    def _target(self, rows: torch.Tensor) -> torch.Tensor:
        """y = r + gamma_g Q(s', pi(s', g), g): [S, B]."""
        after = rows[..., self._layout.block : 2 * self._layout.block].transpose(1, 2)
        value = self._next_value(after)
        return self.critic_kind.clip(value.mul_(rows[..., -1]).add_(rows[..., -2]))

    def _next_value(self, after: torch.Tensor) -> torch.Tensor:
        """Q of the target actor's action in every column of the block: [S, B]."""
        self._act(self.target_actor, after)
        return self._value(self.target_critic, after)

    def _critic_gradient(self, rows: torch.Tensor, batch: int, *, accumulate: bool) -> None:
        """Descends each seed's loss, the mean over its batch of (Q - y)^2."""
        self._descend(self.critic, self._target(rows), rows, batch, accumulate=accumulate)

    def _descend(
        self,
        critic: StackedMLP,
        target: torch.Tensor,
        rows: torch.Tensor,
        batch: int,
        *,
        accumulate: bool,
    ) -> None:
        value = self._value(critic, self._now(rows))
        of_value = (value - target).mul_(2 / batch)
        raw = self.critic_kind.raw_gradient(of_value, value)
        critic.backward(raw.unsqueeze(1), accumulate=accumulate)

    def _actor_gradient(self, rows: torch.Tensor, batch: int, *, accumulate: bool) -> None:
        """Ascends the mean over the batch of Q(s, pi(s, g), g), less the penalty on saturation.

        Where tanh is flat, Q gives the actor nothing to follow; the penalty on its argument does.
        """
        now = self._now(rows)
        output, before_tanh = self._act(self.actor, now)
        value = self._value(self.critic, now)
        ascent = torch.full_like(value, -1 / batch)
        raw = self.critic_kind.raw_gradient(ascent, value).unsqueeze(1)
        to_action = self.critic.backward(raw, parameters=False, inputs=self._layout.action_dim)
        assert to_action is not None
        pull = before_tanh * (2 * self._saturation_penalty / batch)
        gradient = to_action.mul_(1 - output * output).add_(pull)
        self.actor.backward(gradient, accumulate=accumulate)

    def diagnose(self, rows: torch.Tensor) -> dict[str, list[float]]:
        """Per seed: mean and least Q of the policy, share of Q at the bound, saturation.

        All as updates see them: in bf16, of rounded numbers.
        """
        block = self._now(rows)
        output, _ = self._act(self.actor, block)
        value = self._value(self.critic, block)
        return {
            "q_mean": value.mean(1).tolist(),
            "q_min": value.amin(1).tolist(),
            "q_at_bound": (value < -0.95 * self.critic_kind.bound).float().mean(1).tolist(),
            "saturation": (output.abs() > 0.99).float().mean((1, 2)).tolist(),
        }
