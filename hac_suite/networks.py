"""Multilayer perceptrons of many seeds as one stack, with a hand-written backward pass.

Every product is batched over seeds, so each seed's numbers are what it would get alone. Biases are
the last row of each weight matrix, and every layer's input carries a last column of ones: one
product then does the affine map, and one product its gradient.
"""

from collections.abc import Sequence

import torch

# A population of one with a single output column takes another path through the matrix library,
# with other roundings: no layer is narrower than this.
_MIN_OUTPUTS = 2
# Slabs of parameters are padded to whole vector registers, so that element-wise updates treat the
# same parameter alike whatever the population.
_SLAB = 64


class StackedMLP:
    """ReLU networks with a linear output: [S, B, inputs + 1] -> [S, B, outputs].

    Attributes:
        parameters: [S, P], every seed's parameters as one row.
        gradient: [S, P], written by `backward`.
        weights: per layer a view [S, in + 1, out] into `parameters`.
    """

    def __init__(
        self,
        seeds: int,
        sizes: Sequence[int],
        *,
        dtype: torch.dtype = torch.float32,
        device: torch.device | str = "cpu",
    ):
        self.sizes = (*sizes[:-1], max(sizes[-1], _MIN_OUTPUTS))
        self.outputs = sizes[-1]
        self._shapes = [(i + 1, o) for i, o in zip(self.sizes[:-1], self.sizes[1:], strict=True)]
        count = sum(i * o for i, o in self._shapes)
        count += -count % _SLAB
        self.parameters = torch.zeros(seeds, count, dtype=dtype, device=device)
        self.gradient = torch.zeros_like(self.parameters)
        self.weights = self._views(self.parameters)
        self._weight_gradients = self._views(self.gradient)
        self._workspaces: dict[int, _Workspace] = {}
        self._inputs = torch.empty(0)

    def _views(self, flat: torch.Tensor) -> list[torch.Tensor]:
        views, offset = [], 0
        for rows, columns in self._shapes:
            part = flat[:, offset : offset + rows * columns]
            views.append(part.view(flat.shape[0], rows, columns))
            offset += rows * columns
        return views

    def initialise(self, seed: int, generator: torch.Generator, last: float = 3e-3) -> None:
        """Draws one seed's parameters: fan-in uniform, the last layer uniform in +-`last`."""
        for layer, weight in enumerate(self.weights):
            final = layer == len(self.weights) - 1
            bound = last if final else (weight.shape[1] - 1) ** -0.5
            drawn = torch.rand(weight.shape[1:], generator=generator) * (2 * bound) - bound
            if final:
                drawn[:, self.outputs :] = 0
            weight[seed] = drawn

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """[S, B, inputs + 1], the last column ones -> [S, B, outputs]; reuses its buffers."""
        space = self._workspace(inputs.shape[1])
        self._inputs = inputs
        below = inputs
        for weight, hidden, with_ones in zip(
            self.weights[:-1], space.hidden, space.with_ones, strict=True
        ):
            torch.bmm(below, weight, out=hidden)
            hidden.relu_()
            below = with_ones
        torch.bmm(below, self.weights[-1], out=space.output)
        return space.output[..., : self.outputs]

    def backward(
        self, output_gradient: torch.Tensor, *, parameters: bool = True, inputs: int = 0
    ) -> torch.Tensor | None:
        """Backpropagates through the last `forward`.

        Args:
            output_gradient: [S, B, outputs].
            parameters: whether to write `gradient`.
            inputs: how many leading input columns to return the gradient of.

        Returns:
            [S, B, inputs] if `inputs`, else None.
        """
        space = self._workspace(output_gradient.shape[1])
        gradient = space.output_gradient
        gradient[..., : self.outputs] = output_gradient
        for layer in range(len(self.weights) - 1, 0, -1):
            below = space.with_ones[layer - 1]
            if parameters:
                torch.bmm(below.transpose(1, 2), gradient, out=self._weight_gradients[layer])
            hidden, into = space.hidden[layer - 1], space.gradients[layer - 1]
            torch.bmm(gradient, self.weights[layer][:, :-1].transpose(1, 2), out=into)
            torch.ops.aten.threshold_backward.grad_input(into, hidden, 0, grad_input=into)
            gradient = into
        if parameters:
            torch.bmm(self._inputs.transpose(1, 2), gradient, out=self._weight_gradients[0])
        if not inputs:
            return None
        columns = max(inputs, _MIN_OUTPUTS)
        return torch.bmm(gradient, self.weights[0][:, :columns].transpose(1, 2))[..., :inputs]

    def _workspace(self, rows: int) -> "_Workspace":
        if rows not in self._workspaces:
            self._workspaces[rows] = _Workspace(self.parameters, rows, self.sizes)
        return self._workspaces[rows]


class _Workspace:
    """Buffers for one batch size: activations with their column of ones, and their gradients."""

    def __init__(self, like: torch.Tensor, rows: int, sizes: Sequence[int]):
        seeds = like.shape[0]

        def new(width: int) -> torch.Tensor:
            return torch.zeros(seeds, rows, width, dtype=like.dtype, device=like.device)

        # Rows padded to 16 floats keep every row aligned.
        padded = [new(width + 16 - width % 16) for width in sizes[1:-1]]
        for buffer, width in zip(padded, sizes[1:-1], strict=True):
            buffer[..., width] = 1
        self.hidden = [b[..., :w] for b, w in zip(padded, sizes[1:-1], strict=True)]
        self.with_ones = [b[..., : w + 1] for b, w in zip(padded, sizes[1:-1], strict=True)]
        self.gradients = [new(width) for width in sizes[1:-1]]
        self.output = new(sizes[-1])
        self.output_gradient = new(sizes[-1])
