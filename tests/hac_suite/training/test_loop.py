"""The whole loop on a tiny environment: it learns, and a seed is an experiment."""

import dataclasses
import functools

import numpy as np
import pytest
import torch

from analysis.reading import schema
from hac_suite.config import PAPER, horizons
from hac_suite.learning import learners
from hac_suite.policy import Policy
from hac_suite.training import loop
from hac_suite.training.callback import Callback
from tests.hac_suite.learning.level import needs_bf16
from tests.hac_suite.tiny_envs import PointEnv

SMALL = dataclasses.replace(
    PAPER,
    hidden_sizes=(32, 32),
    batch_size=64,
    updates_per_episode=10,
    episodes_per_period=80,
    test_episodes=32,
    replay_capacity=20_000,
)
FAST = dataclasses.replace(SMALL, episodes_per_period=8, updates_per_episode=2, test_episodes=4)
EVERY_LEARNER = pytest.mark.parametrize(
    ("learner", "precision"),
    [
        *((name, "fp32") for name in learners.LEARNERS),
        *(pytest.param(name, "bf16", marks=needs_bf16) for name in learners.LEARNERS),
    ],
)


def make_env(num_envs: int) -> PointEnv:
    return PointEnv(num_envs, max_steps=20)


def run(config, seeds, layers, periods) -> list[loop.PeriodResult]:
    return list(
        loop.train(
            make_env,
            config,
            seeds,
            subgoal_layers=layers,
            horizons=horizons(20, layers),
            periods=periods,
        )
    )


@pytest.mark.slow
@EVERY_LEARNER
@pytest.mark.parametrize("layers", [0, 1, 2])
def test_agents_learn_the_tiny_task(learner, precision, layers):
    config = dataclasses.replace(SMALL, learner=learner, precision=precision)
    results = run(config, [0, 1, 2], layers, periods=5)
    success = [np.mean([row["success_rate"] for row in result.rows]) for result in results]
    assert success[0] < 0.5
    assert success[-1] > 0.9, success


def same(left: Policy, right: Policy) -> bool:
    pairs = zip(left.networks, right.networks, strict=True)
    return all(torch.equal(a.parameters, b.parameters) for a, b in pairs)


def without_clock(row: dict) -> dict:
    return {name: value for name, value in row.items() if name not in schema.CLOCKS}


@pytest.mark.parametrize("layers", [0, 1, 2])
@EVERY_LEARNER
def test_a_seed_alone_equals_that_seed_in_a_population(learner, precision, layers):
    config = dataclasses.replace(FAST, learner=learner, precision=precision)
    seeds = [3, 1, 4, 15, 9, 2, 6, 5, 35, 8, 97]
    together = run(config, seeds, layers, periods=2)
    for position, seed in [(1, 1), (5, 2), (10, 97)]:  # the last one is in a part of its own
        alone = run(config, [seed], layers, periods=2)
        for ours, theirs in zip(alone, together, strict=True):
            expected = without_clock(theirs.rows[position])
            np.testing.assert_equal(without_clock(ours.rows[0]), expected)
            assert same(ours.policies[0], theirs.policies[position])


@pytest.mark.parametrize("batch_size", [37, 100])
@EVERY_LEARNER
def test_batches_that_do_not_fill_registers_keep_seeds_independent(learner, precision, batch_size):
    config = dataclasses.replace(FAST, learner=learner, precision=precision, batch_size=batch_size)
    (*_, together), (*_, alone) = run(config, [3, 1, 4], 1, 2), run(config, [1], 1, 2)
    assert same(alone.policies[0], together.policies[1])


def test_seeds_differ():
    (_, last) = run(FAST, [0, 1], 1, periods=1)
    assert not same(*last.policies)


def test_rows_say_what_happened():
    first, *_, last = run(FAST, [0, 7], 1, periods=2)
    assert [row["train_episodes"] for row in first.rows] == [0, 0]
    row = last.rows[1]
    assert (row["seed"], row["period"], row["subgoal_layers"]) == (7, 2, 1)
    assert (row["train_episodes"], row["test_episodes"]) == (16, 4)
    assert 16 <= row["train_steps"] <= 16 * 20
    names = {f"level{i}_{name}" for i in range(2) for name in loop.DIAGNOSTICS}
    assert names <= set(row)
    assert np.isnan(row["level0_achieved"])  # actions are not subgoals
    for name in ("achieved", "tested", "penalised"):
        assert 0 <= row[f"level1_{name}"] <= 1
    assert 0 <= row["level1_penalised"] <= row["level1_tested"]
    assert -5 <= row["level1_q_min"] <= row["level1_q_mean"] <= 0


def test_diverged_episodes_are_counted_and_failed():
    def diverging(num_envs: int) -> PointEnv:
        return PointEnv(num_envs, max_steps=20, diverge_at=dict.fromkeys(range(num_envs), 0))

    first, last = loop.train(diverging, FAST, [0], subgoal_layers=1, horizons=(5, 4), periods=1)
    assert first.rows[0]["success_rate"] == 0
    assert first.rows[0]["diverged_episodes"] == 4
    assert last.rows[0]["diverged_episodes"] == 4 + 8
    assert np.isnan(last.rows[0]["level0_replay_fill"])


class SpoiltEnv(PointEnv):
    """What an episode of the fifth environment sees last is no number, if it takes all steps."""

    def step(self, actions, mask=None):
        seen = super().step(actions, mask)
        late = (self._steps == self.max_steps) & (np.arange(self.num_envs) == 4)
        seen.observation[late] = np.nan
        return seen


@EVERY_LEARNER
def test_a_seed_that_saw_what_is_no_number_is_lost_and_the_others_go_on(learner, precision):
    lost = []

    class Recording(Callback):
        def on_lost(self, lost_seed):
            lost.append((lost_seed.seed, lost_seed.level))

    config = dataclasses.replace(FAST, learner=learner, precision=precision)
    arguments = dict(subgoal_layers=1, horizons=horizons(5, 1), periods=2)
    make = functools.partial(SpoiltEnv, max_steps=5)
    found = list(loop.train(make, config, [3, 1, 4], callback=Recording(), **arguments))
    assert lost[0] == (1, 0)
    assert found[-1].rows[0]["seed"] == 3 and 1 not in {row["seed"] for row in found[-1].rows}


def test_a_seed_without_experience_is_blank_whatever_its_neighbours_have():
    def diverging(num_envs: int) -> PointEnv:
        first_seed = dict.fromkeys(range(FAST.episodes_per_round), 0)
        return PointEnv(num_envs, max_steps=20, diverge_at=first_seed)

    arguments = dict(subgoal_layers=1, horizons=(5, 4), periods=1)
    (_, last) = loop.train(diverging, FAST, [0, 1], **arguments)
    blank, whole = last.rows
    for name in ("q_mean", "replay_fill"):
        assert np.isnan(blank[f"level0_{name}"])
        assert np.isfinite(whole[f"level0_{name}"])


def test_every_agent_and_period_of_a_seed_is_tested_on_the_same_episodes():
    resets = []

    class Watched(PointEnv):
        def reset(self, seeds=None, *, mask=None, test=False):
            resets.append((test, tuple(seeds)))
            return super().reset(seeds, mask=mask, test=test)

    for layers in (0, 1):
        attempts = horizons(20, layers)
        arguments = dict(subgoal_layers=layers, horizons=attempts, periods=2)
        list(loop.train(lambda n: Watched(n, max_steps=20), FAST, [5], **arguments))
    tested = [seeds for test, seeds in resets if test]
    assert len(tested) == 6 and len(set(tested)) == 1
    assert len(set(tested[0])) == FAST.test_episodes
    trained = [seeds for test, seeds in resets if not test]
    assert len(set(trained)) == len(trained) / 2  # fresh ones each round, the same for both agents


def test_progress_is_reported_each_round():
    seen = []

    class Watching(Callback):
        def on_progress(self, progress):
            seen.append(progress)

    arguments = dict(subgoal_layers=0, horizons=(20,), periods=2)
    for result in loop.train(make_env, FAST, [0], callback=Watching(), **arguments):
        last = result.rows[0]["success_rate"]
        assert {p.success_rate for p in seen[2 * result.period :]} <= {last}
    assert [p.train_episodes for p in seen] == [4, 8, 12, 16]


def test_a_learner_that_no_gpu_can_take_is_refused_there():
    config = dataclasses.replace(FAST, learner="td3")
    arguments = dict(subgoal_layers=1, horizons=(5, 4), periods=1)
    with pytest.raises(ValueError, match="learner td3 learns on CPUs only, not on cuda"):
        loop.train(make_env, config, [0], device="cuda", **arguments)


@pytest.mark.parametrize(
    ("seeds", "attempts", "message"),
    [
        ([], (5, 4), "different seeds"),
        ([1, 1], (5, 4), "different seeds"),
        ([1], {1: (5, 4)}, "need 2 horizons"),
        ([1], (5,), "need 2 horizons"),
    ],
)
def test_wrong_arguments_are_named_before_anything_runs(seeds, attempts, message):
    with pytest.raises(ValueError, match=message):
        loop.train(make_env, FAST, seeds, subgoal_layers=1, horizons=attempts, periods=1)


def test_an_environment_in_place_of_what_makes_them_is_named():
    arguments = {"subgoal_layers": 0, "horizons": (5,), "periods": 1}
    with pytest.raises(ValueError, match=r"such as .*env\.copies, not a PointEnv"):
        loop.train(make_env(1), FAST, [0], **arguments)
