"""Stacked networks against one-seed torch modules and autograd."""

import pytest
import torch

from hac_suite.learning.networks import StackedMLP

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
            rows = network.outputs if index == len(network.weights) - 1 else weight.shape[1]
            linear = torch.nn.Linear(weight.shape[2] - 1, rows, dtype=torch.float64)
            linear.weight.data = weight[seed, :rows, :-1].clone()
            linear.bias.data = weight[seed, :rows, -1].clone()
            layers += [linear, torch.nn.ReLU()]
        modules.append(torch.nn.Sequential(*layers[:-1]))
    return modules


def inputs() -> tuple[torch.Tensor, torch.Tensor]:
    """[S, B, inputs] for the modules, and the same feature-major with its row of ones."""
    drawn = torch.randn(SEEDS, ROWS, SIZES[0], dtype=torch.float64, requires_grad=True)
    with_ones = torch.cat([drawn.detach(), torch.ones(SEEDS, ROWS, 1)], dim=-1)
    return drawn, with_ones.transpose(1, 2)


def test_forward_and_backward_match_autograd(network):
    plain, with_ones = inputs()
    output = network.forward(with_ones)
    expected = torch.stack([m(plain[i]) for i, m in enumerate(as_modules(network))])
    torch.testing.assert_close(output.transpose(1, 2), expected)
    upstream = torch.randn_like(expected)
    (of_inputs,) = torch.autograd.grad(expected, plain, upstream, retain_graph=True)
    found = network.backward(upstream.transpose(1, 2), inputs=3)
    assert found is not None
    torch.testing.assert_close(found.transpose(1, 2), of_inputs[..., :3])
    modules = as_modules(network)
    torch.stack([m(plain[i]) for i, m in enumerate(modules)]).backward(upstream)
    gradients = network._views(network.gradient)
    for seed, module in enumerate(modules):
        linears = [layer for layer in module if isinstance(layer, torch.nn.Linear)]
        for linear, gradient in zip(linears, gradients, strict=True):
            rows = linear.out_features
            torch.testing.assert_close(gradient[seed, :rows, :-1], linear.weight.grad)
            torch.testing.assert_close(gradient[seed, :rows, -1], linear.bias.grad)
            assert not gradient[seed, rows:].any()  # padding learns nothing


def test_gradients_of_a_batch_in_pieces_add_up(network):
    _, with_ones = inputs()
    upstream = torch.randn(SEEDS, network.outputs, ROWS, dtype=torch.float64)
    network.forward(with_ones)
    network.backward(upstream)
    whole = network.gradient.clone()
    for piece in (slice(0, 3), slice(3, ROWS)):
        network.forward(with_ones[..., piece])
        network.backward(upstream[..., piece], accumulate=piece.start > 0)
    torch.testing.assert_close(network.gradient, whole)


def test_networks_of_some_seeds_are_the_same_memory(network):
    _, with_ones = inputs()
    part = network.of_seeds(1, 3)
    output = network.forward(with_ones).clone()
    torch.testing.assert_close(part.forward(with_ones[1:3]), output[1:3])
    part.backward(torch.ones_like(output[1:3]))
    assert not network.gradient[0].any() and network.gradient[1:].any()
    part.parameters.zero_()
    assert network.parameters[0].any() and not network.parameters[1:].any()


def test_a_twin_has_parameters_of_its_own(network):
    twin, before = network.twin(), network.parameters.clone()
    assert torch.equal(twin.parameters, before)
    twin.parameters.zero_()
    assert torch.equal(network.parameters, before)


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
        stacked = torch.stack(data).transpose(2, 3)
        output = network.forward(stacked[:, 0]).clone()
        to_input = network.backward(stacked[:, 1, :1], inputs=1)
        assert to_input is not None
        return [output, network.gradient, to_input]

    together = run(range(10))
    for seed in (0, 3, 9):
        for alone, population in zip(run(range(seed, seed + 1)), together, strict=True):
            assert torch.equal(alone[0], population[seed])
    for pair, population in zip(run(range(4, 6)), together, strict=True):
        assert torch.equal(pair, population[4:6])
