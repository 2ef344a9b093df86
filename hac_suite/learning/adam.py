"""Adam over stacked parameters: one fused pass, with a seed's state in a seed's rows."""

import copy

import torch

from hac_suite.learning.networks import StackedMLP

_BETAS = (0.9, 0.999)
_EPSILON = 1e-8


class Adam:
    """Adam (Kingma and Ba, 2015) as torch.optim.Adam has it, whose step costs more than the sums.

    Attributes:
        first, second: [S, P], running means of the gradient and of its square.
        steps: [S], updates made.
    """

    def __init__(self, network: StackedMLP, learning_rate: float):
        self._rate = learning_rate
        parameters = network.parameters
        self.first, self.second = torch.zeros_like(parameters), torch.zeros_like(parameters)
        self.steps = parameters.new_zeros(len(parameters))
        self._bind(network)

    def _bind(self, network: StackedMLP) -> None:
        tables = (network.parameters, network.gradient, self.first, self.second)
        self._tables = [list(table) for table in tables]  # a tensor per seed, the same memory
        self._counts = list(self.steps)

    def of_seeds(self, start: int, stop: int, network: StackedMLP) -> "Adam":
        """The optimiser of some of the seeds, whose networks are given: the same memory."""
        other = copy.copy(self)
        other.first, other.second = self.first[start:stop], self.second[start:stop]
        other.steps = self.steps[start:stop]
        other._bind(network)
        return other

    def tensors(self, index: int) -> dict[str, torch.Tensor]:
        """Views of one seed's state."""
        own = {"first": self.first, "second": self.second, "steps": self.steps}
        return {name: rows[index] for name, rows in own.items()}

    def step(self) -> None:
        """Updates the network's parameters by its gradient."""
        parameters, gradients, first, second = self._tables
        torch._foreach_add_(self._counts, 1)
        torch._fused_adam_(
            parameters,
            gradients,
            first,
            second,
            [],
            self._counts,
            lr=self._rate,
            beta1=_BETAS[0],
            beta2=_BETAS[1],
            weight_decay=0.0,
            eps=_EPSILON,
            amsgrad=False,
            maximize=False,
        )
