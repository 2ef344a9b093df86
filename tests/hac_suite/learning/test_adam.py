"""The stacked optimiser against torch's own."""

import pytest
import torch

from hac_suite.learning.adam import Adam
from hac_suite.learning.networks import StackedMLP

SEEDS, SIZES = 3, (5, 8, 6, 4)


def networks() -> tuple[StackedMLP, list[torch.nn.Parameter]]:
    network = StackedMLP(SEEDS, SIZES)
    for seed in range(SEEDS):
        network.initialise(seed, torch.Generator().manual_seed(seed))
    return network, [torch.nn.Parameter(row.clone()) for row in network.parameters]


@pytest.mark.slow
def test_every_seed_steps_as_with_torch():
    network, alone = networks()
    optimiser = Adam(network, 1e-2)
    others = [torch.optim.Adam([parameter], lr=1e-2, fused=True) for parameter in alone]
    for _ in range(5):
        network.gradient.copy_(torch.randn(network.gradient.shape))
        optimiser.step()
        for parameter, gradient, other in zip(alone, network.gradient, others, strict=True):
            parameter.grad = gradient.clone()
            other.step()
    assert torch.equal(network.parameters, torch.stack([p.data for p in alone]))
    assert optimiser.steps.tolist() == [5] * SEEDS


def test_the_optimiser_of_some_seeds_steps_them_alone():
    network, _ = networks()
    before, optimiser = network.parameters.clone(), Adam(network, 1e-2)
    network.gradient.fill_(1.0)
    optimiser.of_seeds(1, 2, network.of_seeds(1, 2)).step()
    assert optimiser.steps.tolist() == [0, 1, 0]
    moved = (network.parameters != before).all(dim=1)
    assert moved.tolist() == [False, True, False]
    assert optimiser.first[1].any() and not optimiser.first[::2].any()
