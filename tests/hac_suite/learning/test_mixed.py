"""Networks that multiply in bfloat16, against float32 products of the rounded numbers."""

import pytest
import torch

from hac_suite.learning import mixed
from hac_suite.learning.ddpg import DDPG
from hac_suite.learning.learner import Learner
from hac_suite.learning.mixed import MixedMLP
from hac_suite.learning.networks import StackedMLP
from hac_suite.learning.td3 import TD3

SIZES = (18, 64, 64, 64, 1)


def a_network(kind: type[StackedMLP], seeds: range) -> StackedMLP:
    network = kind(len(seeds), SIZES)
    for index, seed in enumerate(seeds):
        network.initialise(index, torch.Generator().manual_seed(seed), last=0.5)
    return network


def inputs(seeds: range, rows: int) -> torch.Tensor:
    """[S, 19, B], the last row ones."""
    drawn = [torch.randn(rows, 19, generator=torch.Generator().manual_seed(s)) for s in seeds]
    stacked = torch.stack(drawn).transpose(1, 2)
    stacked[:, -1] = 1
    return stacked


def rounded(values: torch.Tensor) -> torch.Tensor:
    return values.bfloat16().float()


class Reference(torch.autograd.Function):
    """Rounds on the way forward and on the way back."""

    @staticmethod
    def forward(_, values):
        return rounded(values)

    @staticmethod
    def backward(_, gradient):
        return rounded(gradient)


def reference(network: StackedMLP, parameters: torch.Tensor, block: torch.Tensor) -> torch.Tensor:
    """The network's output, with what is between hidden layers rounded."""
    hidden, (first, *middle, last) = block, network._views(parameters)
    hidden = (first @ hidden).relu()
    for weight in middle:
        below = Reference.apply(hidden)
        ones = torch.ones_like(below[:, :1])
        hidden = (Reference.apply(weight) @ torch.cat([below, ones], 1)).relu()
    below = Reference.apply(hidden)
    output = last @ torch.cat([below, torch.ones_like(below[:, :1])], 1)
    return output[:, : network.outputs]


def test_forward_and_backward_are_those_of_rounded_products():
    seeds = range(3)
    network, block = a_network(MixedMLP, seeds), inputs(seeds, 256)
    parameters = network.parameters.clone().requires_grad_()
    leaf = block.clone().requires_grad_()
    expected = reference(network, parameters, leaf)
    upstream = torch.randn(expected.shape, generator=torch.Generator().manual_seed(5))
    of_parameters, of_inputs = torch.autograd.grad(expected, (parameters, leaf), upstream)
    output = network.forward(block).clone()
    found = network.backward(upstream, inputs=3)
    assert found is not None
    for ours, theirs in (
        (output, expected),
        (found, of_inputs[:, :3]),
        (network.gradient, of_parameters),
    ):
        assert (ours - theirs).norm() < 4e-3 * theirs.norm()  # a last bit of bfloat16 is 8e-3


def test_it_is_near_what_float32_computes_and_not_the_same():
    seeds = range(2)
    exact, ours, block = a_network(StackedMLP, seeds), a_network(MixedMLP, seeds), inputs(seeds, 64)
    output, found = exact.forward(block), ours.forward(block)
    assert not torch.equal(found, output)
    assert (found - output).norm() < 0.02 * output.norm()


@pytest.mark.parametrize("rows", [4, 64, 256, 1024])
def test_a_seed_computes_the_same_bits_in_any_population(rows):
    def run(seeds: range) -> list[torch.Tensor]:
        network, block = a_network(MixedMLP, seeds), inputs(seeds, rows)
        output = network.forward(block).clone()
        to_input = network.backward(block[:, :1], inputs=1)
        assert to_input is not None
        return [output, network.gradient.clone(), to_input.clone()]

    together = run(range(10))
    for stop in (1, 2, 5):
        for alone, population in zip(run(range(stop)), together, strict=True):
            assert torch.equal(alone, population[:stop])


def test_gradients_of_a_batch_in_pieces_add_up():
    seeds = range(2)
    network, block = a_network(MixedMLP, seeds), inputs(seeds, 32)
    network.forward(block)
    network.backward(block[:, :1])
    whole = network.gradient.clone()
    for piece in (slice(0, 12), slice(12, 32)):
        network.forward(block[..., piece])
        network.backward(block[:, :1, piece], accumulate=piece.start > 0)
    assert (network.gradient - whole).norm() < 0.01 * whole.norm()


def test_to_act_with_is_exact_and_follows_what_is_learnt():
    seeds = range(2)
    network, block = a_network(MixedMLP, seeds), inputs(seeds, 8)
    acting = network.to_act_with()
    for _ in range(2):
        exact = StackedMLP(len(seeds), SIZES)
        exact.parameters.copy_(network.parameters)
        assert torch.equal(acting.forward(block), exact.forward(block))
        network.parameters.mul_(0.9)
    assert network.to_act_with() is acting


def test_the_relu_of_bits_is_that_of_the_numbers():
    bits = torch.arange(-(2**15), 2**15, dtype=torch.int32).to(torch.int16)
    numbers = bits.view(torch.bfloat16)
    finite = ~numbers.isnan()
    expected, ours = numbers[finite].relu(), bits.clone()
    mixed._relu(ours)
    assert torch.equal(ours.view(torch.bfloat16)[finite], expected)
    gradient = torch.ones_like(numbers)
    mixed._relu_backward(gradient, ours)
    assert torch.equal(gradient[finite] != 0, expected > 0)


def test_a_processor_without_it_and_a_gpu_are_refused(monkeypatch):
    mixed.check("fp32", "cuda", DDPG)
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx512_f": True})
    with pytest.raises(ValueError, match="neither avx512_bf16 nor amx_bf16"):
        mixed.check("bf16", "cpu", DDPG)
    for name in ("avx512_bf16", "amx_bf16"):
        monkeypatch.setattr(torch.cpu, "get_capabilities", lambda name=name: {name: True})
        mixed.check("bf16", "cpu", TD3)
    with pytest.raises(ValueError, match="not for cuda"):
        mixed.check("bf16", "cuda", DDPG)


def test_a_learner_that_does_not_say_so_is_refused():
    class Own(Learner):
        pass

    with pytest.raises(ValueError, match="the learner Own does not say `in_bf16 = True`"):
        mixed.check("bf16", "cpu", Own)
