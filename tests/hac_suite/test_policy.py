"""Policies as files, whole, small and nothing that runs; and how they act, step by step."""

import itertools
import json
import os
import pickle

import numpy as np
import pytest
import safetensors.torch
import torch

import tasks
from hac_suite.algorithm.hierarchy import StepView
from hac_suite.learning.networks import StackedMLP
from hac_suite.policy import Policy
from hac_suite.training.evaluation import run_episodes
from hac_suite.types import level_specs
from tests.cases import published
from tests.hac_suite.tiny_envs import PointEnv, Step

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


def test_a_saved_policy_can_be_read_by_whom_the_umask_lets(policy, tmp_path):
    before = os.umask(0o022)
    try:
        policy.save(tmp_path / "p", {"task": "point", "seed": 1})
    finally:
        os.umask(before)
    modes = {path.name: path.stat().st_mode & 0o777 for path in tmp_path.iterdir()}
    assert modes == {"p.json": 0o644, "p.safetensors": 0o644}


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


@pytest.mark.parametrize("kind", [torch.float64, torch.float16, torch.int64, torch.bool])
def test_weights_of_another_kind_are_refused(policy, tmp_path, kind):
    policy.save(tmp_path / "p", {})
    tensors = safetensors.torch.load_file(tmp_path / "p.safetensors")
    changed = {name: tensor.to(kind) for name, tensor in tensors.items()}
    safetensors.torch.save_file(changed, tmp_path / "p.safetensors")
    message = f"weights of level 0 are {str(kind).removeprefix('torch.')}, not float32"
    with pytest.raises(ValueError, match=message):
        Policy.load(tmp_path / "p")


@pytest.mark.parametrize("attempts", [10**12, 10**400, 0, -1, True, 2.0, None])
def test_attempts_that_nobody_means_are_refused(policy, tmp_path, attempts):
    policy.save(tmp_path / "p", {})
    described = json.loads((tmp_path / "p.json").read_text())
    (tmp_path / "p.json").write_text(json.dumps({**described, "horizons": [attempts, 4]}))
    with pytest.raises(ValueError, match=r"p\.json: horizons is \["):
        Policy.load(tmp_path / "p")


def test_a_missing_policy_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"nowhere\.json"):
        Policy.load(tmp_path / "nowhere")


def test_metadata_is_plain_json(policy, tmp_path):
    policy.save(tmp_path / "p", {"success_rate": 0.5})
    assert json.loads((tmp_path / "p.json").read_text())["success_rate"] == 0.5


def agent(layers: int) -> Policy:
    """An untrained agent of the point, whose subgoals are often missed and sometimes achieved."""
    sizes = [(6, 8, 2)] * layers + [(5, 8, 2)]
    networks = [StackedMLP(1, size) for size in sizes]
    for level, network in enumerate(networks):
        network.initialise(0, torch.Generator().manual_seed(level), last=2.0)
    return Policy(networks, (3, 2, 2)[: layers + 1])


def far_point() -> PointEnv:
    return PointEnv(1, max_steps=30, goal_threshold=1e-4)


def played(policy: Policy, env, seed: int) -> tuple[list, list, list]:
    """Actions and subgoals of a test episode as `run_episodes` plays it, and its states."""
    actions, subgoals, steps = [], [], []
    step = env.step

    def watched(chosen: np.ndarray, mask: np.ndarray) -> Step:
        actions.append(chosen[0].copy())
        return step(chosen, mask)

    def on_step(view: StepView) -> None:
        subgoals.append([goal[0].copy() for goal in view.subgoals])
        steps.append(view.env_step)

    env.step = watched
    run_episodes(env, policy, np.array([seed]), on_step=on_step)
    return actions, subgoals, steps


@pytest.mark.parametrize("layers", [0, 1, 2])
@pytest.mark.parametrize("seed", range(4))
def test_acting_step_by_step_is_what_tests_play(layers, seed):
    policy = agent(layers)
    actions, subgoals, steps = played(policy, far_point(), seed)
    assert len(actions) == 30  # its goal is too small to be achieved
    for _ in range(2):  # what an episode leaves behind is gone at the next
        policy.reset(PointEnv(1))
        for expected, step in zip(actions, steps, strict=False):
            action = policy.act(step.observation[0], step.desired_goal[0], step.achieved_subgoal[0])
            np.testing.assert_array_equal(action, expected)
    changes = [np.any(a[0] != b[0]) for a, b in itertools.pairwise(subgoals) if layers]
    assert not layers or 0 < sum(changes) < len(changes)


def test_a_published_agent_acts_in_its_task_as_in_tests():
    policy = Policy.load(published("pick_place", 2))
    for seed in (0, 1):
        actions, _, steps = played(policy, tasks.load_vector("pick_place", 1), seed)
        assert len(actions) > 30
        policy.reset(tasks.spec("pick_place"))
        for expected, step in zip(actions, steps, strict=False):
            action = policy.act(step.observation[0], step.desired_goal[0], step.achieved_subgoal[0])
            np.testing.assert_array_equal(action, expected)


def test_a_flat_agent_needs_no_achieved_subgoal():
    policy = agent(0)
    (first, *_), _, (start, *_) = played(policy, far_point(), 1)
    policy.reset(PointEnv(1))
    np.testing.assert_array_equal(policy.act(start.observation[0], start.desired_goal[0]), first)


def test_the_end_goal_may_move_within_an_episode():
    policy = agent(0)
    policy.reset(PointEnv(1))
    moved = [policy.act(np.zeros(4), np.array([goal])) for goal in (-0.5, 0.5, -0.5)]
    assert (moved[0] != moved[1]).any()
    np.testing.assert_array_equal(moved[0], moved[2])


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ((np.zeros(3), np.zeros(1), np.zeros(2)), "observation must be 4 finite numbers"),
        ((np.zeros((1, 4)), np.zeros(1), np.zeros(2)), "observation must be 4"),
        ((np.full(4, np.nan), np.zeros(1), np.zeros(2)), "observation must be 4"),
        ((np.zeros(4), np.zeros(2), np.zeros(2)), "goal must be 1"),
        ((np.zeros(4), np.zeros(1), np.zeros(1)), "achieved_subgoal must be 2"),
        ((np.zeros(4), np.zeros(1)), "needs achieved_subgoal"),
    ],
)
def test_what_an_agent_cannot_act_on_is_refused(arguments, problem):
    policy = agent(1)
    policy.reset(PointEnv(1))
    with pytest.raises(ValueError, match=problem):
        policy.act(*arguments)


def test_acting_before_an_episode_has_begun_is_refused():
    with pytest.raises(ValueError, match="call reset"):
        agent(1).act(np.zeros(4), np.zeros(1), np.zeros(2))


def test_the_spec_of_another_task_is_refused(policy):
    env = PointEnv(1)
    env.observation_scale = np.ones(7)
    with pytest.raises(ValueError, match="it was trained on another task"):
        policy.reset(env)


def test_a_kill_between_the_two_files_leaves_what_the_weights_say(policy, tmp_path):
    policy.save(tmp_path / "new", {"period": 4})
    policy.save(tmp_path / "p", {"period": 2})
    policy.networks[0].parameters.mul_(2)
    policy.save(tmp_path / "new", {"period": 4})
    os.replace(tmp_path / "new.safetensors", tmp_path / "p.safetensors")
    assert json.loads((tmp_path / "p.json").read_text())["period"] == 2
    loaded = Policy.load(tmp_path / "p")
    assert loaded.metadata["period"] == 4
    assert torch.equal(loaded.networks[0].parameters, policy.networks[0].parameters)
    os.replace(tmp_path / "new.json", tmp_path / "p.json")
    assert Policy.load(tmp_path / "p").metadata["period"] == 4


def test_weights_that_say_nothing_of_themselves_are_described_by_the_file_beside_them(
    policy, tmp_path
):
    policy.save(tmp_path / "p", {"period": 2})
    tensors = safetensors.torch.load_file(tmp_path / "p.safetensors")
    safetensors.torch.save_file(tensors, tmp_path / "p.safetensors")  # as earlier versions did
    assert Policy.load(tmp_path / "p").metadata["period"] == 2


def test_metadata_cannot_pose_as_what_the_policy_is(policy, tmp_path):
    policy.save(tmp_path / "p", {"horizons": [18, 18], "format": "another", "task": "point"})
    assert Policy.load(tmp_path / "p").horizons == HORIZONS
