"""Multilayer perceptrons of many seeds as one stack, with a hand-written backward pass.

Every product is batched over seeds, so each seed's numbers are what it would get alone. Activations
are feature-major, [S, features, B]: a layer of few outputs is then few long rows, which the matrix
library multiplies several times faster than many short ones. Biases are the last column of each
weight matrix, and every layer's input has a last row of ones: one product then does the affine map,
and one product its gradient.
"""

import copy
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch.nn import functional

# A population of one with a single output takes another path through the matrix library, with
# other roundings: no layer is narrower than this.
_MIN_OUTPUTS = 2
# Slabs of parameters are padded to whole vector registers, so that element-wise updates treat the
# same parameter alike whatever the population.
_SLAB = 64
_REGISTERS = 32  # floats; a multiple of every vector width
# Rows of activations begin at multiples of so many bytes: products round as their operands are
# aligned, and a seed's must be aligned alike in every population.
_BYTES = 64
ALIGNED = _BYTES // 4  # floats


def in_whole_registers(
    function: Callable[[torch.Tensor], torch.Tensor], values: torch.Tensor
) -> torch.Tensor:
    """An element-wise function of [..., B], the same bits whatever the other dimensions.

    What is left over after whole vector registers goes through another tanh or sigmoid, with other
    roundings: rows are filled up, so that nothing is left over.
    """
    columns = values.shape[-1]
    filled = functional.pad(values, (0, -columns % _REGISTERS)) if columns % _REGISTERS else values
    return function(filled)[..., :columns]


def rows_of_columns(
    seeds: int,
    rows: int,
    columns: int,
    *,
    dtype: torch.dtype,
    device: torch.device | str = "cpu",
) -> torch.Tensor:
    """Zeros [seeds, rows, columns], whose rows begin at whole multiples of 64 bytes."""
    aligned = _BYTES // dtype.itemsize
    made = torch.zeros(seeds, rows, columns + -columns % aligned, dtype=dtype, device=device)
    return made[..., :columns]


class StackedMLP:
    """ReLU networks with a linear output: [S, inputs + 1, B] -> [S, outputs, B].

    Attributes:
        parameters: [S, P], every seed's parameters as one row.
        gradient: [S, P], written by `backward`.
        weights: per layer a view [S, out, in + 1] into `parameters`.
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
        self._shapes = [(o, i + 1) for i, o in zip(self.sizes[:-1], self.sizes[1:], strict=True)]
        count = sum(o * i for o, i in self._shapes)
        count += -count % _SLAB
        parameters = torch.zeros(seeds, count, dtype=dtype, device=device)
        self._workspaces: dict[tuple[int, int], Any] = {}
        self._bind(parameters, torch.zeros_like(parameters))

    def _bind(self, parameters: torch.Tensor, gradient: torch.Tensor) -> None:
        self.parameters, self.gradient = parameters, gradient
        self.weights = self._views(parameters)
        self._weight_gradients = self._views(gradient)
        # What the products of a pass see of the weights, made once: views cost time, too.
        self._to_hidden = [w[..., :-1].transpose(1, 2) for w in self.weights]
        self._inputs = parameters

    def _views(self, flat: torch.Tensor) -> list[torch.Tensor]:
        views, offset = [], 0
        for rows, columns in self._shapes:
            part = flat[:, offset : offset + rows * columns]
            views.append(part.view(flat.shape[0], rows, columns))
            offset += rows * columns
        return views

    def of_seeds(self, start: int, stop: int) -> "StackedMLP":
        """The networks of some of the seeds: the same memory, and buffers shared with others."""
        return self._like(self.parameters[start:stop], self.gradient[start:stop])

    def twin(self) -> "StackedMLP":
        """A copy that uses the same buffers: neither can go backward after the other's forward."""
        return self._like(self.parameters.clone(), self.gradient)

    def to_act_with(self) -> "StackedMLP":
        """Itself, or where it is on a GPU a copy of now, for environments on a CPU."""
        if self.parameters.device.type == "cpu":
            return self
        here = StackedMLP(len(self.parameters), (*self.sizes[:-1], self.outputs))
        here.parameters.copy_(self.parameters)
        return here

    def _like(self, parameters: torch.Tensor, gradient: torch.Tensor) -> "StackedMLP":
        other = copy.copy(self)
        other._bind(parameters, gradient)
        return other

    def initialise(self, index: int, generator: torch.Generator, last: float = 3e-3) -> None:
        """Draws one row's parameters: fan-in uniform, the last layer uniform in +-`last`."""
        for layer, weight in enumerate(self.weights):
            final = layer == len(self.weights) - 1
            bound = last if final else (weight.shape[2] - 1) ** -0.5
            drawn = torch.rand(weight.shape[1:], generator=generator) * (2 * bound) - bound
            if final:
                drawn[self.outputs :] = 0
            weight[index] = drawn

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """[S, inputs + 1, B], the last row ones -> [S, outputs, B]; reuses its buffers."""
        space = self._workspace(inputs.shape[2])
        self._inputs = inputs
        below = inputs
        for weight, hidden, with_ones in zip(
            self.weights, space.hidden, space.with_ones, strict=False
        ):
            torch.bmm(weight, below, out=hidden)
            hidden.relu_()
            below = with_ones
        torch.bmm(self.weights[-1], below, out=space.output)
        return space.returned

    def backward(
        self,
        output_gradient: torch.Tensor,
        *,
        parameters: bool = True,
        accumulate: bool = False,
        inputs: int = 0,
    ) -> torch.Tensor | None:
        """Backpropagates through the last `forward`.

        Args:
            output_gradient: [S, outputs, B].
            parameters: whether to write `gradient`.
            accumulate: add to `gradient` what it would be.
            inputs: how many leading input rows to return the gradient of.

        Returns:
            [S, inputs, B] if `inputs`, else None.
        """
        space = self._workspace(output_gradient.shape[2])
        space.returned_gradient.copy_(output_gradient)
        gradient, beta = space.output_gradient, int(accumulate)
        for layer in range(len(self.weights) - 1, 0, -1):
            if parameters:
                self._weight_gradients[layer].baddbmm_(
                    gradient, space.transposed[layer - 1], beta=beta
                )
            hidden, into = space.hidden[layer - 1], space.gradients[layer - 1]
            torch.bmm(self._to_hidden[layer], gradient, out=into)
            torch.ops.aten.threshold_backward.grad_input(into, hidden, 0, grad_input=into)
            gradient = into
        if parameters:
            self._weight_gradients[0].baddbmm_(gradient, self._inputs.transpose(1, 2), beta=beta)
        return self._to_inputs(gradient, space.input_gradient, inputs)

    def _to_inputs(
        self, gradient: torch.Tensor, into: torch.Tensor, inputs: int
    ) -> torch.Tensor | None:
        """The gradient of so many leading input rows, from that of the first hidden layer."""
        if not inputs:
            return None
        rows = max(inputs, _MIN_OUTPUTS)
        into = into[:, :rows]
        torch.bmm(self.weights[0][..., :rows].transpose(1, 2), gradient, out=into)
        return into[:, :inputs]

    def _workspace(self, columns: int) -> Any:
        key = len(self.parameters), columns
        if key not in self._workspaces:
            self._workspaces[key] = self._new_workspace(columns)
        return self._workspaces[key]

    def _new_workspace(self, columns: int) -> Any:
        return _Workspace(self.parameters, columns, self.sizes, self.outputs)


class _Workspace:
    """Buffers for one batch size: activations with their row of ones, and their gradients."""

    def __init__(self, like: torch.Tensor, columns: int, sizes: Sequence[int], outputs: int):
        def new(rows: int) -> torch.Tensor:
            return rows_of_columns(len(like), rows, columns, dtype=like.dtype, device=like.device)

        self.with_ones = [new(width + 1) for width in sizes[1:-1]]
        for buffer in self.with_ones:
            buffer[:, -1] = 1
        self.hidden = [buffer[:, :-1] for buffer in self.with_ones]
        self.transposed = [buffer.transpose(1, 2) for buffer in self.with_ones]
        # Two buffers in turn serve all layers: a gradient is done with once the next is known.
        turns = [new(max(sizes[1:-1])), new(max(sizes[1:-1]))]
        self.gradients = [turns[i % 2][:, :width] for i, width in enumerate(sizes[1:-1])]
        self.output, self.output_gradient = new(sizes[-1]), new(sizes[-1])
        self.input_gradient = new(sizes[0])
        self.returned = self.output[:, :outputs]
        self.returned_gradient = self.output_gradient[:, :outputs]
