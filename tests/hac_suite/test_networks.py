"""Stacked networks against one-seed torch modules and autograd."""

import pytest
import torch

from hac_suite.networks import StackedMLP

SEEDS, ROWS, SIZES = 3, 7, (5, 8, 6, 4)


@pytest.fixture(params=[1, 4], ids=["one output", "four outputs"])
def network(request) -> StackedMLP:
    made = StackedMLP(SEEDS, (*SIZES[:-1], request.param), dtype=torch.float64)
    for seed in range(SEEDS):
        made.initialise(seed, torch.Generator().manual_seed(seed), last=0.5)
    return made


def as_modules(network: StackedMLP) -> list[torch.nn.Sequential]:
    """The same networks as ordinary modules, one per seed."""
    modules = []
    for seed in range(SEEDS):
        layers: list[torch.nn.Module] = []
        for index, weight in enumerate(network.weights):
            columns = network.outputs if index == len(network.weights) - 1 else weight.shape[2]
            linear = torch.nn.Linear(weight.shape[1] - 1, columns, dtype=torch.float64)
            linear.weight.data = weight[seed, :-1, :columns].T.clone()
            linear.bias.data = weight[seed, -1, :columns].clone()
            layers += [linear, torch.nn.ReLU()]
        modules.append(torch.nn.Sequential(*layers[:-1]))
    return modules


def inputs() -> tuple[torch.Tensor, torch.Tensor]:
    drawn = torch.randn(SEEDS, ROWS, SIZES[0], dtype=torch.float64, requires_grad=True)
    return drawn, torch.cat([drawn.detach(), torch.ones(SEEDS, ROWS, 1)], dim=-1)


def test_forward_and_backward_match_autograd(network):
    plain, with_ones = inputs()
    output = network.forward(with_ones)
    expected = torch.stack([m(plain[i]) for i, m in enumerate(as_modules(network))])
    torch.testing.assert_close(output, expected)
    upstream = torch.randn_like(expected)
    (of_inputs,) = torch.autograd.grad(expected, plain, upstream, retain_graph=True)
    found = network.backward(upstream, inputs=3)
    torch.testing.assert_close(found, of_inputs[..., :3])
    modules = as_modules(network)
    torch.stack([m(plain[i]) for i, m in enumerate(modules)]).backward(upstream)
    gradients = network._views(network.gradient)
    for seed, module in enumerate(modules):
        linears = [layer for layer in module if isinstance(layer, torch.nn.Linear)]
        for linear, gradient in zip(linears, gradients, strict=True):
            columns = linear.out_features
            torch.testing.assert_close(gradient[seed, :-1, :columns], linear.weight.grad.T)
            torch.testing.assert_close(gradient[seed, -1, :columns], linear.bias.grad)
            assert not gradient[seed, :, columns:].any()  # padding learns nothing


def test_initialisation_is_fan_in_uniform_with_a_small_last_layer():
    network = StackedMLP(1, (100, 64, 64, 3))
    network.initialise(0, torch.Generator().manual_seed(0))
    first, second, last = network.weights
    assert 0.95 * 100**-0.5 < first.abs().max() <= 100**-0.5
    assert 0.95 * 64**-0.5 < second.abs().max() <= 64**-0.5
    assert 0.9 * 3e-3 < last.abs().max() <= 3e-3


@pytest.mark.parametrize("rows", [4, 64, 256])
def test_a_seed_computes_the_same_bits_in_any_population(rows):
    """Forward, weight gradient and input gradient of 1, 2 and 10 seeds."""

    def run(seeds: range) -> list[torch.Tensor]:
        network = StackedMLP(len(seeds), (18, 64, 64, 64, 1))
        data = []
        for i, seed in enumerate(seeds):
            generator = torch.Generator().manual_seed(seed)
            network.initialise(i, generator, last=0.5)
            data.append(torch.randn(2, rows, 19, generator=generator))
        stacked = torch.stack(data)
        output = network.forward(stacked[:, 0]).clone()
        to_input = network.backward(stacked[:, 1, :, :1], inputs=1)
        assert to_input is not None
        return [output, network.gradient, to_input]

    together = run(range(10))
    for seed in (0, 3, 9):
        for alone, population in zip(run(range(seed, seed + 1)), together, strict=True):
            assert torch.equal(alone[0], population[seed])
    for pair, population in zip(run(range(4, 6)), together, strict=True):
        assert torch.equal(pair, population[4:6])
