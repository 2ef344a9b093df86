"""The example of docs/your_own_learner.md learns, resumes exactly, and keeps seeds apart."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
import torch

import hac_suite
from hac_suite.config import PAPER
from launch.asking import request
from tests.cases import some_slow
from tests.hac_suite.tiny_envs import PointEnv

PAGE = Path(__file__).resolve().parent.parent / "docs" / "your_own_learner.md"
CONFIG = dataclasses.replace(
    PAPER,
    hidden_sizes=(32, 32),
    batch_size=64,
    updates_per_episode=10,
    episodes_per_period=80,
    test_episodes=32,
    replay_capacity=20_000,
)


@pytest.fixture(scope="module")
def learner(tmp_path_factory) -> str:
    """The page's example in a file, as the word that asks for it."""
    (example,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE)
    file = tmp_path_factory.mktemp("mine") / "crr.py"
    file.write_text(example)
    return f"{file}:CRR"


def train(learner: str, seeds: list[int], periods: int, layers: int = 1, **others):
    small = {name: others.pop(name) for name in ("episodes_per_period",) if name in others}
    return hac_suite.train(
        lambda num_envs: PointEnv(num_envs, max_steps=20),
        dataclasses.replace(CONFIG, learner=learner, **small),
        seeds,
        subgoal_layers=layers,
        horizons=hac_suite.horizons(20, layers),
        periods=periods,
        **others,
    )


@pytest.mark.parametrize("layers", some_slow((0, 1), 1))
def test_it_learns(learner, layers):
    results = train(learner, [0, 1, 2], 5, layers)
    success = [np.mean([row["success_rate"] for row in result.rows]) for result in results]
    assert success[0] < 0.5
    assert success[-1] > 0.9, success


def weights(result: hac_suite.PeriodResult, index: int) -> list[torch.Tensor]:
    return [network.parameters for network in result.policies[index].networks]


def assert_same(ours: list[torch.Tensor], theirs: list[torch.Tensor]) -> None:
    assert len(ours) == len(theirs)
    for one, other in zip(ours, theirs, strict=True):
        assert torch.equal(one, other)


def test_a_seed_alone_equals_that_seed_in_a_population(learner):
    *_, together = train(learner, [3, 1, 4, 15, 9, 2], 1, episodes_per_period=12)
    for position, seed in [(1, 1), (5, 2)]:
        *_, alone = train(learner, [seed], 1, episodes_per_period=12)
        assert_same(weights(alone, 0), weights(together, position))


def test_resumed_equals_uninterrupted(learner):
    left = []

    class Keeping(hac_suite.Callback):
        def on_boundary(self, boundary: hac_suite.Boundary) -> None:
            if boundary.train_episodes == 8:
                for state in boundary.states():
                    tensors = {name: tensor.clone() for name, tensor in state.tensors.items()}
                    left.append(state._replace(tensors=tensors))

    *_, whole = train(learner, [3, 1], 1, episodes_per_period=16, callback=Keeping())
    (resumed,) = train(learner, [3, 1], 1, episodes_per_period=16, start=left)
    for index in range(2):
        assert_same(weights(resumed, index), weights(whole, index))


def test_a_command_asks_for_it(learner):
    assert request.parse(["launch/run.py", f"--config.learner={learner}"]).config.learner == learner
