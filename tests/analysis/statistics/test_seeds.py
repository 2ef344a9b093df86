"""Statistics over seeds against values worked out by hand."""

import numpy as np
import pandas as pd
import pytest

from analysis.reading import schema
from analysis.statistics.seeds import (
    core_minutes,
    core_seconds,
    episodes_to,
    final_success,
    last_rows,
    mean_interval,
    n_label,
    success_per_period,
)


@pytest.mark.parametrize("value", [0.0, 1.0, 0.3])
@pytest.mark.parametrize("seeds", [2, 3, 10])
def test_seeds_that_tie_have_an_interval_of_no_width(value, seeds):
    assert mean_interval([value] * seeds) == (value, value, value)


def test_one_seed_has_a_mean_but_no_interval():
    interval = mean_interval([0.75])
    assert interval.mean == 0.75
    assert np.isnan(interval.low) and np.isnan(interval.high)


@pytest.mark.parametrize("values", [[], [0.5, np.nan], [0.5, np.inf]])
def test_no_values_or_broken_ones_raise(values):
    with pytest.raises(ValueError, match="finite values"):
        mean_interval(values)


def test_two_seeds_give_the_pair_as_interval():
    # Resampled means are 0, 0.5, 1 with probability 1/4, 1/2, 1/4: the 2.5% tails are the ends.
    assert mean_interval([0.0, 1.0]) == (0.5, 0.0, 1.0)


def test_values_apart_by_rounding_alone_do_not_give_nan():
    # BCa has no answer here: every resampled mean is at one end of the sample or rounds to it.
    almost = np.nextafter(1.0, 0.0)
    assert mean_interval([1.0] * 9 + [almost]) == pytest.approx((1.0, 1.0, 1.0))


def test_interval_is_near_the_normal_one_for_symmetric_values():
    values = np.linspace(0.4, 0.6, 21)
    half = 1.96 * values.std() / np.sqrt(21)
    interval = mean_interval(values)
    assert interval.mean == pytest.approx(0.5)
    assert interval.low == pytest.approx(0.5 - half, abs=0.003)
    assert interval.high == pytest.approx(0.5 + half, abs=0.003)


@pytest.mark.parametrize("seeds", [2, 3, 5, 10])
@pytest.mark.parametrize("common", [0.0, 1.0])
def test_one_seed_unlike_the_others_never_gives_nan(seeds, common):
    interval = mean_interval([1.0 - common] + [common] * (seeds - 1))
    assert 0.0 <= interval.low <= interval.mean <= interval.high <= 1.0
    assert interval.low < interval.high


def test_interval_covers_the_true_mean_about_as_often_as_it_says():
    rng = np.random.default_rng(0)
    covered = 0
    for sample in rng.normal(0.5, 0.1, size=(120, 10)):
        interval = mean_interval(sample)
        covered += interval.low <= 0.5 <= interval.high
    assert 0.83 <= covered / 120 <= 0.99


def test_random_state_decides_the_interval():
    values = np.random.default_rng(3).uniform(size=12)
    assert mean_interval(values, random_state=1) == mean_interval(values, random_state=1)
    assert mean_interval(values, random_state=1) != mean_interval(values, random_state=2)


def test_success_per_period_by_hand(make_results):
    results = make_results({0: [[0.0, 0.0], [0.0, 0.5]], 2: [[0.0, 1.0], [0.0, 1.0], [0.0, None]]})
    summary = success_per_period(results)
    assert list(summary.columns) == list(schema.FIGURE_COLUMNS)
    assert summary.to_numpy().tolist() == [
        ["pick_place", 0, 0, 0, 2, 0.0, 0.0, 0.0],
        ["pick_place", 0, 1, 300, 2, 0.25, 0.0, 0.5],
        ["pick_place", 2, 0, 0, 3, 0.0, 0.0, 0.0],
        ["pick_place", 2, 1, 300, 2, 1.0, 1.0, 1.0],
    ]


def test_a_point_does_not_depend_on_the_others(make_results):
    one = {1: [[0.1, 0.6], [0.2, 0.7], [0.0, 0.9]]}
    alone = success_per_period(make_results(one))
    together = success_per_period(make_results({0: [[0.0, 0.1], [0.1, 0.2]], **one}))
    pd.testing.assert_frame_equal(
        together[together["subgoal_layers"] == 1].reset_index(drop=True), alone
    )


def test_unequal_training_is_not_averaged(make_results):
    results = make_results({1: [[0.0, 0.5], [0.0, 0.7]]})
    results.loc[3, "train_episodes"] = 200
    with pytest.raises(ValueError, match=r"1 subgoal layers, period 1.*\(200, 300\)"):
        success_per_period(results)


def test_episodes_to_80_percent_by_hand(make_results):
    results = make_results(
        {
            0: [[0.0, 0.5, 0.79], [0.0, 0.1, 0.8]],
            1: [[0.0, 0.8, 0.1], [0.0, 0.0, 0.9], [0.0, 0.9, 1.0]],
        }
    )
    flat, layered = episodes_to(results).itertuples()
    # Half of the flat agent's seeds never got there: no median.
    assert (flat.reached, flat.seeds) == (1, 2)
    assert np.isnan(flat.median_episodes)
    assert (layered.reached, layered.seeds, layered.median_episodes) == (3, 3, 300)


def test_final_success_by_hand(make_results):
    results = make_results(
        {
            0: [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
            1: [[0.0, 0.5, 1.0], [0.0, 0.9, 0.5], [0.0, 0.9, None]],
        }
    )
    flat, layered = final_success(results).itertuples()
    assert (flat.period, flat.n, flat.seeds, flat.mean, flat.low, flat.high) == (2, 2, 2, 0, 0, 0)
    assert np.isnan(flat.median_steps) and flat.reached_80 == 0
    assert (layered.period, layered.train_episodes) == (2, 600)
    # The third seed lacks the last period: it is in `seeds`, not in `n`.
    assert (layered.n, layered.seeds) == (2, 3)
    assert (layered.mean, layered.low, layered.high) == (0.75, 0.5, 1.0)
    assert layered.median_steps == 110.5
    assert (layered.reached_80, layered.episodes_to_80) == (3, 300)


def test_last_rows_are_each_seeds_own(make_results):
    rows = last_rows(make_results({1: [[0.0, 0.5, 1.0], [0.0, 0.9, None]]}))
    assert rows[["seed", "period", "success_rate"]].to_numpy().tolist() == [
        [0, 2, 1.0],
        [1, 1, 0.9],
    ]


def test_n_label():
    assert n_label([10, 10]) == "n=10"
    assert n_label(pd.Series([8, 10, 9])) == "n=8-10"


def test_seeds_that_were_trained_side_by_side_count_once(make_results):
    results = make_results({0: [[0, 0]] * 4, 1: [[0, 0]]})
    results["wall_seconds"] = [1, 60, 1, 60.05, 1, 90, 1, 120, 1, 30]  # three jobs, and one
    assert core_minutes(results).tolist() == pytest.approx([(60.025 + 90 + 120) / 60, 0.5])


def test_cpu_time_counts_where_it_is_known(make_results):
    results = make_results({1: [[0, 0, 0]] * 2})
    results["wall_seconds"] = [2, 60, 90, 2, 60, 90]
    results["core_seconds"] = [1, 20, 33, 1, 20, None]
    assert core_seconds(results).tolist() == [1, 20, 33, 1, 20, 45]
    assert core_minutes(results).tolist() == pytest.approx([78 / 60])
