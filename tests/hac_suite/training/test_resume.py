"""Interrupted and resumed equals uninterrupted, bit for bit, at every boundary between rounds."""

import dataclasses
import functools
import math

import numpy as np
import pytest
import torch

import hac_suite
import tasks
from analysis.reading import schema
from hac_suite import checkpoint
from hac_suite.config import PAPER, horizons
from hac_suite.state import SeedState
from hac_suite.training import loop
from hac_suite.training.callback import Boundary, Callback
from tests.cases import some_slow
from tests.hac_suite.learning.level import needs_bf16
from tests.hac_suite.tiny_envs import PointEnv

# Small rings, so that they are full and turning when a training is interrupted.
TINY = dataclasses.replace(
    PAPER,
    hidden_sizes=(8, 8),
    batch_size=16,
    updates_per_episode=1,
    episodes_per_period=12,
    test_episodes=3,
    replay_capacity=100,
)
TD3 = dataclasses.replace(TINY, learner="td3", policy_delay=3)  # rounds end in mid-delay
MIXED = dataclasses.replace(TINY, precision="bf16")
EVERY_CONFIG = pytest.mark.parametrize(
    "config",
    [
        pytest.param(TINY, id="ddpg"),
        pytest.param(TD3, id="td3"),
        pytest.param(MIXED, id="ddpg in bf16", marks=needs_bf16),
    ],
)
SEEDS = (3, 1, 4)


def make_env(num_envs: int) -> PointEnv:
    # The first seed loses an episode each round: what is counted must be gone on with as well.
    return PointEnv(num_envs, max_steps=20, diverge_at={0: 3})


class Stopped(Exception):
    """Thrown at a boundary, as a kill would come."""


def train(layers, periods=2, seeds=SEEDS, make_env=make_env, config=TINY, max_steps=20, **others):
    """Every row of a training, and the state it ended with."""
    attempts = horizons(max_steps, layers)
    with torch.no_grad():
        work = loop.Training(make_env, config, tuple(seeds), attempts, "cpu")
        if others.get("start"):
            work.restore(others["start"])
        results = list(work.run(periods, others.get("callback", Callback())))
    return results, [kept(state) for state in work.states()]


def kept(state: SeedState) -> SeedState:
    """The state as it is now."""
    tensors = {name: tensor.clone() for name, tensor in state.tensors.items()}
    return SeedState(tensors, {**state.numbers})


def through_files(states, folder) -> list[SeedState]:
    """What a checkpoint of these states gives back."""
    states = list(states)
    folders = [folder / str(state.numbers["seed"]) for state in states]
    checkpoint.Writer(folders, [{} for _ in folders]).save(states)
    return [checkpoint.load(of, states[0].numbers["train_episodes"]) for of in folders]


def stopped_at(number: int, folder, layers, **others) -> list[SeedState]:
    """The checkpoints that a training leaves at its boundary of that number, where it is killed."""
    killing = Killing(number, folder)
    with pytest.raises(Stopped):
        train(layers, callback=killing, **others)
    return killing.left


class Killing(Callback):
    """Leaves checkpoints at the boundary of a number, and kills the training there."""

    def __init__(self, number: int, folder):
        self.seen, self.left = 0, []
        self._number, self._folder = number, folder

    def on_boundary(self, boundary: Boundary) -> None:
        self.seen += 1
        if self.seen > self._number:
            self.left = through_files(boundary.states(), self._folder)
            raise Stopped


class Boundaries(Callback):
    """Keeps every boundary."""

    def __init__(self):
        self.seen: list[Boundary] = []

    def on_boundary(self, boundary: Boundary) -> None:
        self.seen.append(boundary)


def assert_same_states(ours: SeedState, theirs: SeedState) -> None:
    assert ours.tensors.keys() == theirs.tensors.keys()
    for name, tensor in theirs.tensors.items():
        assert torch.equal(ours.tensors[name], tensor), name
    np.testing.assert_equal(without_clock(ours.numbers), without_clock(theirs.numbers))


def without_clock(numbers: dict) -> dict:
    rows = [{k: v for k, v in row.items() if k not in schema.CLOCKS} for row in numbers["rows"]]
    return {**numbers, "rows": rows, "seconds": None, "core_seconds": None}


@pytest.mark.parametrize("layers", some_slow((0, 1, 2), 0, 2))
@EVERY_CONFIG
def test_resumed_at_any_boundary_equals_uninterrupted(config, layers, tmp_path):
    """Networks, optimisers, replay, streams, counts and rows; the last policies with the rows."""
    kept_boundaries = Boundaries()
    whole, last = train(layers, config=config, callback=kept_boundaries)
    boundaries = kept_boundaries.seen
    assert [(b.train_episodes, b.tested) for b in boundaries] == [
        (0, True), (4, False), (8, False), (12, True), (16, False), (20, False), (24, True)
    ]  # fmt: skip
    assert [b.last for b in boundaries] == 6 * [False] + [True]
    for number in range(len(boundaries)):
        start = stopped_at(number, tmp_path / str(number), layers, config=config)
        results, states = train(layers, config=config, start=start)
        for ours, theirs in zip(states, last, strict=True):
            assert_same_states(ours, theirs)
        for ours, theirs in zip(results[-1].policies, whole[-1].policies, strict=True):
            for one, other in zip(ours.networks, theirs.networks, strict=True):
                assert torch.equal(one.parameters, other.parameters)
    assert any(tensor.any() for name, tensor in last[0].tensors.items() if "actor.first" in name)
    assert last[0].numbers["added"][0] > TINY.replay_capacity  # the ring had turned
    assert last[0].numbers["rows"][-1]["diverged_episodes"] > 0


@EVERY_CONFIG
def test_seeds_go_on_in_any_grouping(config, tmp_path):
    _, last = train(1, config=config)
    start = stopped_at(4, tmp_path, 1, config=config)
    for group in ([2], [1, 0]):
        seeds = [SEEDS[i] for i in group]

        def env_of(num_envs, group=group):
            diverging = {TINY.episodes_per_round * group.index(0): 3} if 0 in group else {}
            return PointEnv(num_envs, max_steps=20, diverge_at=diverging)

        going_on = [start[i] for i in group]
        _, states = train(1, seeds=seeds, start=going_on, make_env=env_of, config=config)
        for index, ours in zip(group, states, strict=True):
            ours_rows = [row["train_steps"] for row in ours.numbers["rows"]]
            assert ours_rows == [row["train_steps"] for row in last[index].numbers["rows"]]
            for name, tensor in last[index].tensors.items():
                assert torch.equal(ours.tensors[name], tensor), (index, name)


@EVERY_CONFIG
def test_interrupted_again_and_again(config, tmp_path):
    _, (last,) = train(2, seeds=[5], periods=2, config=config)
    states: list[SeedState] = []
    for life in range(6):  # a round each
        states = stopped_at(0, tmp_path / str(life), 2, seeds=[5], start=states, config=config)
    _, (ours,) = train(2, seeds=[5], start=states, config=config)
    assert_same_states(ours, last)


def test_the_clock_goes_on(tmp_path):
    (state,) = stopped_at(3, tmp_path, 0, seeds=[0])
    state.numbers.update(seconds=1000.0, core_seconds=500.0)
    results, (after,) = train(0, seeds=[0], start=[state])
    assert [result.period for result in results] == [2]
    assert 1000 < results[0].rows[0]["wall_seconds"] <= after.numbers["seconds"] < 1100
    assert 500 < results[0].rows[0]["core_seconds"] <= after.numbers["core_seconds"] < 600


def test_seeds_share_the_cpu_time(monkeypatch):
    clock = iter(range(0, 1000, 6))
    monkeypatch.setattr(loop.time, "process_time", lambda: next(clock))
    (untrained, trained), _ = train(0, seeds=[0, 1], periods=1)
    assert [row["core_seconds"] for row in untrained.rows] == [3, 3]  # 6 s, over 2 seeds
    assert [row["core_seconds"] for row in trained.rows] == [6, 6]


def test_what_a_state_of_an_earlier_version_does_not_say_stays_unknown(tmp_path):
    (state,) = stopped_at(3, tmp_path, 0, seeds=[0])
    del state.numbers["core_seconds"]
    results, _ = train(0, seeds=[0], start=[state])
    assert math.isnan(results[0].rows[0]["core_seconds"])


def test_seeds_of_one_checkpoint_stand_at_one_time(tmp_path):
    """Statistics tell by it which seeds were trained side by side."""
    states = stopped_at(3, tmp_path, 1)
    assert len({state.numbers["seconds"] for state in states}) == 1 < len(states)


@EVERY_CONFIG
def test_restoring_leaves_all_memory_in_place(config, tmp_path):
    """Views of some of the seeds, and captured graphs, point at it."""
    start = stopped_at(3, tmp_path, 1, config=config)
    work = loop.Training(make_env, config, SEEDS, horizons(20, 1), "cpu")

    def addresses():
        return [t.data_ptr() for i in range(3) for t in work.population._tensors(i).values()]

    before = addresses()
    work.restore(start)
    assert addresses() == before


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(seeds=[3, 1]), "longer"),
        (dict(seeds=[3, 1, 4, 5]), "shorter"),
        (dict(seeds=[1, 3, 4]), "state belongs to seed 3, not to seed 1"),
        (dict(config=dataclasses.replace(TINY, hidden_sizes=(8, 4))), "level0.actor is"),
        (dict(config=dataclasses.replace(TINY, replay_capacity=500)), "replay is"),
        (dict(config=TD3), "not a state of this training"),
        (dict(layers=2), "not a state of this training"),
        (dict(layers=0), "is .* in the state"),
    ],
)
def test_a_state_of_something_else_is_refused(tmp_path, change, message):
    arguments = dict(layers=1, start=stopped_at(4, tmp_path, 1)) | change
    with pytest.raises(ValueError, match=message):
        train(**arguments)


def test_seeds_that_stand_at_different_episodes_are_refused(tmp_path):
    early, late = (stopped_at(n, tmp_path / str(n), 0) for n in (1, 2))
    with pytest.raises(ValueError, match=r"episodes: \[4, 8\]"):
        train(0, start=[early[0], late[1], late[2]])


SHORT = dataclasses.replace(TINY, episodes_per_period=8, test_episodes=2, batch_size=32)


def _resumed_equals_uninterrupted(task, layers, folder, seeds, learner="ddpg"):
    arguments = dict(
        make_env=functools.partial(tasks.load_vector, task),
        max_steps=tasks.load_vector(task, 1).max_steps,
        config=dataclasses.replace(SHORT, learner=learner),
        seeds=seeds,
    )
    _, last = train(layers, **arguments)
    for number in (1, 2, 3):  # in mid-period, after a test period, and in the next one
        start = stopped_at(number, folder / str(number), layers, **arguments)
        _, states = train(layers, start=start, **arguments)
        for ours, theirs in zip(states, last, strict=True):
            assert_same_states(ours, theirs)


def test_a_real_task_resumed_equals_uninterrupted(tmp_path):
    _resumed_equals_uninterrupted("ur5_reacher", 1, tmp_path, seeds=[2])


@pytest.mark.slow
@pytest.mark.parametrize("learner", ["ddpg", "td3"])
@pytest.mark.parametrize("layers", [0, 1, 2])
@pytest.mark.parametrize("task", tasks.ALL)
def test_every_task_resumed_equals_uninterrupted(task, layers, learner, tmp_path):
    _resumed_equals_uninterrupted(task, layers, tmp_path, seeds=[2, 7], learner=learner)


def test_a_state_beyond_the_end_that_is_asked_for_is_refused(tmp_path):
    start = stopped_at(4, tmp_path, 1)  # within the second period
    given = dict(subgoal_layers=1, horizons=horizons(20, 1), start=start)
    with pytest.raises(ValueError, match="beyond the end of 1 periods, which is episode 12"):
        hac_suite.train(make_env, TINY, np.array(SEEDS), periods=1, **given)
    *_, last = hac_suite.train(make_env, TINY, np.array(SEEDS), periods=2, **given)
    assert last.period == 2
