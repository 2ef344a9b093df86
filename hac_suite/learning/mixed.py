"""Networks that multiply in bfloat16 between their hidden layers, and the choice of a precision.

A processor with avx512_bf16 or AMX multiplies bfloat16 numbers about twice as fast as float32 ones,
and adds the products up in float32. The parameters stay float32, and so do the products of the
first layer, where small differences between states decide whether a goal is achieved, and those of
the last, a critic's value.
"""

from typing import NamedTuple

import torch

from hac_suite.learning.learner import Learner
from hac_suite.learning.networks import StackedMLP, rows_of_columns

_BF16 = torch.bfloat16


class MixedMLP(StackedMLP):
    """As `StackedMLP`, but products between hidden layers are of numbers rounded to bfloat16."""

    def _bind(self, parameters: torch.Tensor, gradient: torch.Tensor) -> None:
        super()._bind(parameters, gradient)
        middle = range(1, len(self.weights) - 1)
        # Each in one piece, which products take as it is.
        self._rounded = {i: torch.empty(self.weights[i].shape, dtype=_BF16) for i in middle}
        self._rounded_to_hidden = {
            i: weight[..., :-1].transpose(1, 2) for i, weight in self._rounded.items()
        }
        self._to_act_with: StackedMLP | None = None

    def to_act_with(self) -> StackedMLP:
        """Networks of the same parameters that round nothing: what is tested is what is saved."""
        if self._to_act_with is None:
            exact = StackedMLP(len(self.parameters), (*self.sizes[:-1], self.outputs))
            exact._bind(self.parameters, self.gradient)
            self._to_act_with = exact
        return self._to_act_with

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        space = self._workspace(inputs.shape[2])
        self._inputs = inputs
        torch.bmm(self.weights[0], inputs, out=space.first)
        space.hidden[0].copy_(space.first)
        _relu(space.bits[0])
        for layer, weight in self._rounded.items():
            weight.copy_(self.weights[layer])
            torch.bmm(weight, space.with_ones[layer - 1], out=space.hidden[layer])
            _relu(space.bits[layer])
        space.last.copy_(space.with_ones[-1])
        torch.bmm(self.weights[-1], space.last, out=space.output)
        return space.returned

    def backward(
        self,
        output_gradient: torch.Tensor,
        *,
        parameters: bool = True,
        accumulate: bool = False,
        inputs: int = 0,
    ) -> torch.Tensor | None:
        space = self._workspace(output_gradient.shape[2])
        beta = int(accumulate)
        space.returned_gradient.copy_(output_gradient)
        if parameters:
            self._weight_gradients[-1].baddbmm_(
                space.output_gradient, space.last_transposed, beta=beta
            )
        into = space.gradients[-1]
        torch.bmm(self._to_hidden[-1], space.output_gradient, out=space.last_gradient)
        into.copy_(space.last_gradient)
        for layer in reversed(self._rounded):
            gradient = _relu_backward(into, space.bits[layer])
            if parameters:
                product = space.products[layer]
                torch.bmm(gradient, space.transposed[layer - 1], out=product)
                total = self._weight_gradients[layer]
                if accumulate:
                    total.add_(product)
                else:
                    total.copy_(product)
            into = space.gradients[layer - 1]
            torch.bmm(self._rounded_to_hidden[layer], gradient, out=into)
        space.first.copy_(_relu_backward(into, space.bits[0]))
        if parameters:
            self._weight_gradients[0].baddbmm_(space.first, self._inputs.transpose(1, 2), beta=beta)
        return self._to_inputs(space.first, space.input_gradient, inputs)

    def _new_workspace(self, columns: int) -> "_MixedWorkspace":
        return _MixedWorkspace(self, columns)


def _relu(bits: torch.Tensor) -> None:
    """ReLU of bfloat16 numbers by their bits as int16, which is five times as fast.

    Both have the sign in the first bit, so what is negative as one is negative as the other. NaN
    becomes 0: its first bit is set.
    """
    bits.clamp_min_(0)


def _relu_backward(gradient: torch.Tensor, bits: torch.Tensor) -> torch.Tensor:
    """Zeroes the gradient where the ReLU's output was zero: as int16, see `_relu`."""
    own = gradient.view(torch.int16)
    torch.ops.aten.threshold_backward.grad_input(own, bits, 0, grad_input=own)
    return gradient


class _MixedWorkspace:
    """Buffers for one batch size; `first` and `last` are float32, and so is all that is outside."""

    def __init__(self, network: MixedMLP, columns: int):
        seeds, sizes = len(network.parameters), network.sizes
        hidden = sizes[1:-1]

        def new(rows: int, dtype: torch.dtype = torch.float32) -> torch.Tensor:
            return rows_of_columns(seeds, rows, columns, dtype=dtype)

        self.with_ones = [new(width + 1, _BF16) for width in hidden]
        for buffer in self.with_ones:
            buffer[:, -1] = 1
        self.hidden = [buffer[:, :-1] for buffer in self.with_ones]
        self.bits = [h.view(torch.int16) for h in self.hidden]
        self.transposed = [buffer.transpose(1, 2) for buffer in self.with_ones]
        # Two buffers in turn serve all layers: a gradient is done with once the next is known.
        turns = [new(max(hidden), _BF16) for _ in range(2)]
        self.gradients = [turns[i % 2][:, :width] for i, width in enumerate(hidden)]
        self.products = {i: torch.empty_like(w) for i, w in network._rounded.items()}
        self.first, self.last = new(hidden[0]), new(hidden[-1] + 1)
        self.last_transposed = self.last.transpose(1, 2)
        self.last_gradient = new(hidden[-1])
        self.output, self.output_gradient = new(sizes[-1]), new(sizes[-1])
        self.input_gradient = new(sizes[0])
        self.returned = self.output[:, : network.outputs]
        self.returned_gradient = self.output_gradient[:, : network.outputs]


class Precision(NamedTuple):
    """What a population's updates compute with on a CPU."""

    networks: type[StackedMLP]
    # Seeds that are updated together, and rows of a pass, so that their data fits in the cache. In
    # bfloat16 it is smaller, and calls cost more.
    seeds_at_a_time: int
    rows_at_a_time: int


PRECISIONS = {"fp32": Precision(StackedMLP, 5, 256), "bf16": Precision(MixedMLP, 10, 1024)}


def check(word: str, device: torch.device | str, learner: type[Learner]) -> None:
    """Checks that a learner can have a precision on this machine.

    Raises:
        ValueError: the precision is bf16, and the learner does not have it, or the processor lacks
            its instructions, or the device is a GPU.
    """
    if word == "fp32":
        return
    if not getattr(learner, "in_bf16", False):
        raise ValueError(
            f"precision is 'bf16', but the learner {learner.__name__} does not say "
            "`in_bf16 = True`; leave it out."
        )
    if torch.device(device).type != "cpu":
        raise ValueError(f"precision is 'bf16', which is for CPUs, not for {device}; leave it out.")
    if not has_bf16():
        raise ValueError(
            "precision is 'bf16', but this processor has neither avx512_bf16 nor amx_bf16, and "
            "multiplies such numbers slower than float32; leave it out."
        )


def has_bf16() -> bool:
    """Whether the processor multiplies bfloat16 numbers."""
    able = torch.cpu.get_capabilities()
    return bool(able.get("avx512_bf16") or able.get("amx_bf16"))
