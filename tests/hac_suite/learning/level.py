"""A small level to learn: its sizes, a batch of rows, and its networks as autograd sees them."""

import dataclasses
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import pytest
import torch

from hac_suite.config import PAPER, Config
from hac_suite.learning import mixed
from hac_suite.learning.learner import Learner
from hac_suite.learning.networks import StackedMLP
from hac_suite.learning.replay import RowLayout
from hac_suite.types import LevelSpec
from tasks.goal_space import GoalSpace

L = TypeVar("L", bound=Learner)

GOALS = GoalSpace(("x",), ("m",), np.array([-2.0]), np.array([2.0]), np.array([0.1]))
SPEC = LevelSpec(observation_scale=np.ones(2), goal_space=GOALS, action_dim=2, attempts=10)
LAYOUT = RowLayout.of(SPEC)
ROWS = 16
needs_bf16 = pytest.mark.skipif(
    not mixed.has_bf16(), reason="this processor has neither avx512_bf16 nor amx_bf16"
)


def a_batch(seeds: int = 2, dtype: torch.dtype = torch.float32) -> torch.Tensor:
    generator = torch.Generator().manual_seed(7)
    rows = torch.randn(seeds, ROWS, LAYOUT.width, generator=generator)
    rows[..., LAYOUT.block - 1] = rows[..., 2 * LAYOUT.block - 1] = 1
    rows[..., -2] = -1
    rows[..., -1] = torch.tensor([0.98, 0.0] * (ROWS // 2))
    return rows.to(dtype)


def in_bf16(kind: type[L]) -> Callable[..., L]:
    """The learner as a config with `precision="bf16"` makes it."""

    def make(spec: LevelSpec, config: Config, generators: list[torch.Generator]) -> L:
        return kind(spec, dataclasses.replace(config, precision="bf16"), generators)

    return make


def a_learner(kind: Callable[..., L], seeds: int = 2, **changes) -> L:
    config = dataclasses.replace(PAPER, **changes)
    return kind(SPEC, config, [torch.Generator().manual_seed(s) for s in range(seeds)])


def shake(learner: Learner) -> None:
    """Gives every network weights of its own, as a training would have."""
    generator = torch.Generator().manual_seed(11)
    for network in vars(learner).values():
        if isinstance(network, StackedMLP):
            drawn = torch.randn(network.parameters.shape, generator=generator) * 0.3
            network.parameters.copy_(drawn)


def autograd_forward(network: StackedMLP, flat: torch.Tensor, block: torch.Tensor) -> torch.Tensor:
    """What the network with these parameters says, by ordinary products."""
    hidden = block
    for index, weight in enumerate(network._views(flat)):
        if index:
            hidden = torch.cat([hidden.relu(), torch.ones_like(hidden[..., :1])], dim=-1)
        hidden = hidden @ weight.transpose(1, 2)
    return hidden[..., : network.outputs]


def parameters_of(network: StackedMLP) -> torch.Tensor:
    return network.parameters.detach().clone().requires_grad_()


def in_float64(learner: L) -> L:
    """The learner with networks of twice the digits, so that a gradient is right or wrong."""
    for name, network in list(vars(learner).items()):
        if isinstance(network, StackedMLP):
            sizes = (*network.sizes[:-1], network.outputs)
            wide = StackedMLP(len(network.parameters), sizes, dtype=torch.float64)
            wide.parameters.copy_(network.parameters)
            setattr(learner, name, wide)
    return learner
