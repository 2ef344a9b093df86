"""Policies as files: whole, small, and nothing that runs."""

import json
import pickle

import numpy as np
import pytest
import safetensors.torch
import torch

from hac_suite.learning.networks import StackedMLP
from hac_suite.policy import Policy
from hac_suite.types import level_specs
from tests.hac_suite.tiny_envs import PointEnv

HORIZONS = (4, 3)


@pytest.fixture
def policy() -> Policy:
    networks = [StackedMLP(3, (6, 8, 8, 2)), StackedMLP(3, (5, 8, 8, 2))]
    for network in networks:
        for seed in range(3):
            network.initialise(seed, torch.Generator().manual_seed(seed), last=0.5)
    return Policy.of_seed(networks, 1, HORIZONS)


def act(policy: Policy) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    specs = level_specs(PointEnv(5), HORIZONS)
    goals = [rng.normal(size=(5, spec.goal_space.dim)) for spec in specs]
    observation = rng.normal(size=(5, 4))
    actors = policy.actors(specs)
    return [actor(observation, goal).copy() for actor, goal in zip(actors, goals, strict=True)]


def test_a_saved_policy_acts_the_same(policy, tmp_path):
    policy.save(tmp_path / "p", {"task": "point", "seed": 1})
    loaded = Policy.load(tmp_path / "p")
    assert loaded.horizons == HORIZONS
    assert loaded.metadata["task"] == "point"
    for ours, theirs in zip(act(policy), act(loaded), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert {path.suffix for path in tmp_path.iterdir()} == {".safetensors", ".json"}


def test_a_policy_of_another_task_is_refused(policy):
    with pytest.raises(ValueError, match="level 0 maps 6 numbers to 2"):
        policy.actors(level_specs(PointEnv(1), HORIZONS)[::-1])


class _Bomb:
    def __reduce__(self):
        return (exec, ("raise SystemExit('a policy file was executed')",))


def test_a_pickle_posing_as_a_policy_is_refused_unexecuted(policy, tmp_path):
    policy.save(tmp_path / "p", {})
    (tmp_path / "p.safetensors").write_bytes(pickle.dumps(_Bomb()))
    with pytest.raises(ValueError, match=r"p\.safetensors is not a safetensors policy"):
        Policy.load(tmp_path / "p")


@pytest.mark.parametrize(
    ("description", "message"),
    [
        ("not json", "does not describe a policy"),
        ('{"format": "something else"}', "its format is not"),
        ("[]", "its format is not"),
        ('{"format": "hac_suite.policy/2", "horizons": "ten"}', "horizons is 'ten'"),
        ('{"format": "hac_suite.policy/2", "horizons": [4, 3, 2]}', "network for level 2"),
    ],
)
def test_a_damaged_description_is_named(policy, tmp_path, description, message):
    policy.save(tmp_path / "p", {})
    (tmp_path / "p.json").write_text(description)
    with pytest.raises(ValueError, match=message):
        Policy.load(tmp_path / "p")


def test_weights_that_are_not_finite_are_refused(policy, tmp_path):
    policy.networks[1].parameters[0, 3] = float("nan")
    policy.save(tmp_path / "p", {})
    with pytest.raises(ValueError, match="weights of level 1"):
        Policy.load(tmp_path / "p")


def test_tensors_of_the_wrong_shape_are_refused(policy, tmp_path):
    policy.save(tmp_path / "p", {})
    vectors = {"level0.layer0": torch.zeros(3), "level0.layer1": torch.zeros(4)}
    safetensors.torch.save_file(vectors, tmp_path / "p.safetensors")
    with pytest.raises(ValueError, match="whole network for level 0"):
        Policy.load(tmp_path / "p")


def test_a_missing_policy_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"nowhere\.json"):
        Policy.load(tmp_path / "nowhere")


def test_metadata_is_plain_json(policy, tmp_path):
    policy.save(tmp_path / "p", {"success_rate": 0.5})
    assert json.loads((tmp_path / "p.json").read_text())["success_rate"] == 0.5
