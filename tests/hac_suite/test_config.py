"""Configs: presets, defaults for T_i, and values that cannot be."""

import dataclasses

import pytest

from hac_suite.config import (
    PAPER,
    PRESETS,
    Config,
    HierarchyConfig,
    LearnerConfig,
    ScheduleConfig,
    completed,
    horizons,
)


def test_presets_differ_from_each_other():
    assert len(set(PRESETS.values())) == len(PRESETS) == 4


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("subgoal_test_rate", 1.5),
        ("random_action_rate", -0.1),
        ("action_noise", -1.0),
        ("batch_size", 0),
        ("batch_size", 2.5),
        ("hindsight_goals", 1.5),
        ("hindsight_goals", -1),
        ("learning_rate", 0.0),
        ("initial_q", 0.5),
        ("test_draw", "sometimes"),
        ("hindsight_relabels", "none"),
        ("hidden_sizes", ()),
        ("episodes_per_period", 301),
        ("learner", "td4"),
        ("target_noise", -0.1),
        ("target_noise_clip", float("inf")),
        ("policy_delay", 0),
    ],
)
def test_impossible_values_are_named(field, value):
    with pytest.raises(ValueError, match=field):
        dataclasses.replace(PAPER, **{field: value})


def test_an_unknown_learner_is_answered_by_the_closest():
    with pytest.raises(ValueError, match="did you mean 'td3'"):
        dataclasses.replace(PAPER, learner="td4")


def test_td3_needs_target_networks():
    with pytest.raises(ValueError, match=r"target_rate is 0.0; .* td3 has target networks"):
        dataclasses.replace(PAPER, learner="td3", target_rate=0.0)
    assert dataclasses.replace(PAPER, target_rate=0.0).learner == "ddpg"


def test_fields_come_part_by_part():
    names = [field.name for field in dataclasses.fields(Config)]
    parts = (HierarchyConfig, ScheduleConfig, LearnerConfig)
    assert names == [field.name for part in parts for field in dataclasses.fields(part)]


@pytest.mark.parametrize(
    ("max_steps", "layers", "expected"),
    [
        (300, 0, (300,)),
        (300, 1, (18, 18)),
        (300, 2, (7, 7, 7)),
        (400, 1, (20, 20)),
        (1, 2, (1, 1, 1)),
    ],
)
def test_default_horizons_span_the_episode(max_steps, layers, expected):
    assert horizons(max_steps, layers) == expected


def test_a_tasks_own_horizons_take_the_place_of_equal_ones():
    own = {1: (30, 10)}
    assert [horizons(300, layers, own) for layers in (0, 1)] == [(300,), (30, 10)]
    assert horizons(300, 2, own) == horizons(300, 2)


def test_negative_layers_are_refused():
    with pytest.raises(ValueError, match="subgoal_layers"):
        horizons(100, -1)


def test_a_field_that_was_not_there_yet_has_the_value_that_stood_for_it():
    old = {"random_action_rate": 0.7, "discount": 0.9}
    found = completed(old)
    assert found == old | {
        "random_subgoal_rate": 0.7,
        "critic_floor": "attempts",
        "learner": "ddpg",
        "precision": "fp32",
        "target_noise": 0.2,
        "target_noise_clip": 0.5,
        "policy_delay": 2,
        "upper_updates_per_episode": 0,
    }
    assert completed(found) == found
