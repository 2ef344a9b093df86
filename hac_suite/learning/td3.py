"""TD3 (Fujimoto et al. 2018): DDPG with twin critics, a smoothed target and a delayed actor.

The target is the lesser of two critics' values at the target actor's action plus noise. The actor
takes one step per several steps of the critics, and follows only the first critic.
"""

from collections.abc import Sequence
from typing import Self

import torch

from hac_suite.config import Config
from hac_suite.learning.adam import Adam
from hac_suite.learning.ddpg import DDPG
from hac_suite.types import LevelSpec

_BASES = 2**31  # where seeds' noise begins; plus a count of updates it is still below 2**32


class TD3(DDPG):
    """Actor, two critics, their targets, averages and optimisers of one level for S seeds.

    An update depends on the count of updates and draws noise on the CPU, so it cannot be captured
    as a CUDA graph.
    """

    on_gpu = False

    def __init__(
        self,
        spec: LevelSpec,
        config: Config,
        generators: list[torch.Generator],
        device: torch.device | str = "cpu",
    ):
        if not config.target_rate:
            raise ValueError("target_rate must be above 0: TD3 has target networks")
        super().__init__(spec, config, generators, device)
        self._noise = config.target_noise
        self._noise_clip = config.target_noise_clip
        self._delay = config.policy_delay
        sizes = (*self.critic.sizes[:-1], self.critic.outputs)
        self.second_critic = type(self.critic)(len(generators), sizes, device=device)
        for index, generator in enumerate(generators):
            self.second_critic.initialise(index, generator)
        self.target_second = self.second_critic.twin()
        self.second_optimiser = Adam(self.second_critic, config.learning_rate)
        self._bases = [int(torch.randint(_BASES, (), generator=each)) for each in generators]

    def of_seeds(self, start: int, stop: int) -> Self:
        part = super().of_seeds(start, stop)
        part.second_critic = self.second_critic.of_seeds(start, stop)
        part.target_second = self.target_second.of_seeds(start, stop)
        part.second_optimiser = self.second_optimiser.of_seeds(start, stop, part.second_critic)
        part._bases = self._bases[start:stop]
        return part

    def tensors(self, index: int) -> dict[str, torch.Tensor]:
        optimiser = self.second_optimiser.tensors(index)
        return {
            **super().tensors(index),
            "second_critic": self.second_critic.parameters[index],
            "target_second_critic": self.target_second.parameters[index],
            **{f"second_critic.{part}": of for part, of in optimiser.items()},
        }

    def parameters(self) -> list[torch.Tensor]:
        return [*super().parameters(), self.second_critic.parameters]

    def update(self, rows: torch.Tensor) -> None:
        """A step of the critics, and with each `policy_delay`-th one of the actor and targets."""
        counts = [int(count) for count in self.updates().tolist()]
        self._write_noise(rows, counts)
        batch, pieces = rows.shape[1], self._pieces(rows)
        self._critic_step(pieces, batch)
        # Seeds that are trained together have had as many updates as each other.
        if (counts[0] + 1) % self._delay == 0:
            self._actor_step(pieces, batch)

    def _write_noise(self, rows: torch.Tensor, counts: Sequence[int]) -> None:
        """Leaves the smoothing noise where the next action will be."""
        first, actions, clip = self._layout.block, self._layout.action_dim, self._noise_clip
        for own, base, count in zip(rows, self._bases, counts, strict=True):
            noise = smoothing_noise(base, count, (len(own), actions))
            own[:, first : first + actions] = noise.mul_(self._noise).clamp_(-clip, clip)

    def _next_value(self, after: torch.Tensor) -> torch.Tensor:
        """The lesser of the two critics' values, of the target actor's action and the noise."""
        action = after[:, : self._layout.action_dim]
        noise = action.clone()
        self._act(self.target_actor, after)
        action.add_(noise).clamp_(-1, 1)
        first = self._value(self.target_critic, after)
        return torch.minimum(first, self._value(self.target_second, after))

    def _critic_step(self, pieces: Sequence[torch.Tensor], batch: int) -> None:
        super()._critic_step(pieces, batch)
        self.second_optimiser.step()

    def _critic_gradient(self, rows: torch.Tensor, batch: int, *, accumulate: bool) -> None:
        """Descends the loss of each critic: they share the target, and nothing else."""
        target = self._target(rows)
        self._descend(self.critic, target, rows, batch, accumulate=accumulate)
        self._descend(self.second_critic, target, rows, batch, accumulate=accumulate)

    def _actor_step(self, pieces: Sequence[torch.Tensor], batch: int) -> None:
        super()._actor_step(pieces, batch)
        self.target_second.parameters.lerp_(self.second_critic.parameters, self._target_rate)


def smoothing_noise(base: int, count: int, shape: tuple[int, ...]) -> torch.Tensor:
    """Gaussian noise for a seed's update number `count`, independent of earlier draws.

    A running stream would have to be saved, and would shift if an update drew more from it.
    """
    return torch.randn(shape, generator=torch.Generator().manual_seed(base + count))
