"""Every field of the config reaches something, and the presets are what their sources say."""

import dataclasses
import math

import pytest
import torch

import hac_suite
from analysis.reading import schema
from hac_suite.config import PAPER, PRESETS, Config, LearnerConfig
from hac_suite.training import loop
from hac_suite.training.callback import Callback
from tests.hac_suite.learning.level import needs_bf16
from tests.hac_suite.tiny_envs import PointEnv

# A training of a second that exercises everything: subgoal tests, end goals achieved, attempts and
# steps that run out, a replay buffer that fills.
TINY = dataclasses.replace(
    PAPER,
    episodes_per_period=16,
    test_episodes=8,
    batch_size=16,
    updates_per_episode=2,
    learning_rate=1e-2,
    hidden_sizes=(16, 16),
    replay_capacity=2_000,
    tested_actor_rate=0.05,
)
TINY_TD3 = dataclasses.replace(TINY, learner="td3")
CHANGES = {
    "subgoal_test_rate": 0.6,
    "test_draw": "each_level",
    "tested_subgoal_noise_free": False,
    "penalise_cut_short": True,
    "hindsight_actions": False,
    "hindsight_goals": 2,
    "hindsight_relabels": "segment",
    "hindsight_pick_last": True,
    "drop_held_hindsight": False,
    "random_action_rate": 0.3,
    "random_subgoal_rate": 0.3,
    "action_noise": 0.2,
    "saturation_penalty": 1.0,
    "subgoal_noise": 0.2,
    "continue_after_goal": True,
    "test_until_horizon": False,
    "episodes_per_period": 8,
    "test_episodes": 5,
    "episodes_per_round": 8,
    "discount": 0.9,
    "batch_size": 8,
    "updates_per_episode": 3,
    "upper_updates_per_episode": 1,
    "learning_rate": 1e-3,
    "hidden_sizes": (16, 8),
    "precision": "bf16",
    "replay_capacity": 200,
    "bounded_critic": False,
    "critic_floor": "returns",
    "initial_q": -0.5,
    "target_rate": 0.5,
    "tested_actor_rate": 0.0,
    "learner": "td3",
    "target_noise": 0.4,
    "target_noise_clip": 0.1,
    "policy_delay": 3,
}
TD3_ONLY = ("target_noise", "target_noise_clip", "policy_delay")
FIELDS = [field.name for field in dataclasses.fields(Config)]


def cases(fields):
    """As parameters: a field that this processor lacks is skipped."""
    lacking = {"precision": needs_bf16}
    return [pytest.param(f, id=f, marks=lacking.get(f, ())) for f in fields]


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    """Networks this small only lose by threads, most of all where other processes run."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def outcome(config):
    """All that a training leaves behind: rows without their times, and the tested weights."""
    results = hac_suite.train(
        lambda num_envs: PointEnv(num_envs, max_steps=17),
        config,
        seeds=[4, 5],
        subgoal_layers=2,
        horizons=(2, 1, 2),
        periods=1,
    )
    rows, weights = [], []
    for result in results:
        for row, policy in zip(result.rows, result.policies, strict=True):
            # Nor how many test episodes there were, which says nothing of what they showed.
            drop = {*schema.CLOCKS, "test_episodes"}
            kept = (value for column, value in row.items() if column not in drop)
            rows.append(tuple(None if math.isnan(value) else value for value in kept))
            weights.append([network.parameters.clone() for network in policy.networks])
    return rows, weights


def same_weights(left, right):
    return all(
        torch.equal(a, b)
        for networks in zip(left, right, strict=True)
        for a, b in zip(*networks, strict=True)
    )


def same_outcome(left, right):
    return left[0] == right[0] and same_weights(left[1], right[1])


@pytest.fixture(scope="module")
def unchanged():
    return outcome(TINY)


@pytest.fixture(scope="module")
def unchanged_td3():
    return outcome(TINY_TD3)


def test_the_same_config_has_the_same_outcome(unchanged, unchanged_td3):
    assert same_outcome(outcome(TINY), unchanged)
    assert same_outcome(outcome(TINY_TD3), unchanged_td3)


@pytest.mark.parametrize("field", cases(field for field in FIELDS if field not in TD3_ONLY))
def test_every_field_has_an_effect(field, unchanged):
    changed = dataclasses.replace(TINY, **{field: CHANGES[field]})
    assert not same_outcome(outcome(changed), unchanged)


LEARNING = [field.name for field in dataclasses.fields(LearnerConfig)]


@pytest.mark.parametrize("field", cases(field for field in LEARNING if field != "learner"))
def test_every_field_of_learning_has_an_effect_on_td3(field, unchanged_td3):
    changed = dataclasses.replace(TINY_TD3, **{field: CHANGES[field]})
    assert not same_outcome(outcome(changed), unchanged_td3)


@pytest.mark.parametrize("field", TD3_ONLY)
def test_what_is_of_td3_leaves_ddpg_alone(field, unchanged):
    changed = dataclasses.replace(TINY, **{field: CHANGES[field]})
    assert same_outcome(outcome(changed), unchanged)


def test_hindsight_goals_of_the_future_have_an_effect(unchanged):
    changed = dataclasses.replace(TINY, hindsight_relabels="future")
    assert not same_outcome(outcome(changed), unchanged)


# What only governs test periods must leave the learning alone.
@pytest.mark.parametrize("field", ["test_until_horizon", "test_episodes"])
def test_what_governs_tests_does_not_touch_learning(field, unchanged):
    changed = dataclasses.replace(TINY, **{field: CHANGES[field]})
    assert same_weights(outcome(changed)[1], unchanged[1])


SOURCES = {
    "suite": {  # what was tuned
        "hindsight_relabels": "future",
        "hindsight_goals": 2,
        "critic_floor": "returns",
        "test_draw": "each_level",
        "subgoal_noise": 0.03,
        "random_subgoal_rate": 0.1,
        "learning_rate": 0.002,
        "replay_capacity": 100_000,
    },
    "paper": {
        "hindsight_goals": 3,
        "subgoal_test_rate": 0.3,
        "test_draw": "top",
        "tested_subgoal_noise_free": True,
        "hindsight_relabels": "preceding",
        "continue_after_goal": False,
    },
    "release_2018": {
        "subgoal_test_rate": 0.2,
        "test_draw": "each_level",
        "tested_subgoal_noise_free": False,
        "bounded_critic": False,
        "target_rate": 0.05,
        "tested_actor_rate": 0.05,
        "continue_after_goal": True,
        "test_until_horizon": True,
    },
    "release_2020": {
        "subgoal_test_rate": 0.3,
        "test_draw": "each_level",
        "tested_subgoal_noise_free": False,
        "hindsight_relabels": "segment",
        "bounded_critic": True,
        "initial_q": pytest.approx(-0.07, abs=0.01),
        "target_rate": 0.0,
        "continue_after_goal": False,
        "test_until_horizon": True,
    },
}


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_what_their_sources_say(name):
    values = dataclasses.asdict(PRESETS[name])
    assert values | SOURCES[name] == values
    assert values["random_action_rate"] == 0.2
    assert name == "suite" or values["hindsight_goals"] == 3


@pytest.mark.parametrize("name", PRESETS)
def test_presets_train(name):
    small = {name: getattr(TINY, name) for name in ("test_episodes", "hidden_sizes", "batch_size")}
    config = dataclasses.replace(PRESETS[name], episodes_per_period=4, **small)
    rows, weights = outcome(config)
    assert len(rows) == 4
    assert not same_weights(weights[:2], weights[2:])
    assert all(torch.isfinite(w).all() for networks in weights for w in networks)


def test_upper_levels_have_the_updates_that_they_are_given():
    config = dataclasses.replace(TINY, updates_per_episode=4, upper_updates_per_episode=1)
    training = loop.Training(
        lambda num_envs: PointEnv(num_envs, max_steps=17), config, (4,), (2, 1, 2), "cpu"
    )
    with torch.no_grad():
        list(training.run(1, Callback()))
    population, episodes = training.population, TINY.episodes_per_period
    assert [population.updates(0, level) for level in range(3)] == [
        4 * episodes,
        episodes,
        episodes,
    ]
