"""Comparisons over seeds against values worked out by hand."""

import numpy as np
import pytest
import scipy

from analysis.statistics import comparison

ZEROS, ONES = np.zeros(10), np.ones(10)
INF = np.inf


def test_a_contrast_is_the_weighted_sum_of_means_with_its_interval():
    rng = np.random.default_rng(0)
    new, old = rng.normal(0.7, 0.1, 30), rng.normal(0.5, 0.1, 30)
    value, low, high = comparison.contrast([new, old], [1, -1])
    assert value == pytest.approx(new.mean() - old.mean())
    by_scipy = scipy.stats.ttest_ind(new, old, equal_var=False).confidence_interval()
    assert (low, high) == pytest.approx((by_scipy.low, by_scipy.high))
    value, low, high = comparison.contrast([new], [2])
    by_scipy = scipy.stats.ttest_1samp(2 * new, 0).confidence_interval()
    assert (low, high) == pytest.approx((by_scipy.low, by_scipy.high))


def test_strata_that_tie_leave_no_doubt():
    assert comparison.contrast([ONES, ZEROS], [1, -1]) == (1, 1, 1)
    assert comparison.contrast([ZEROS, ZEROS], [1, -1]) == (0, 0, 0)


def test_a_stratum_of_one_seed_gives_no_interval():
    value, low, high = comparison.contrast([np.array([0.9]), ZEROS], [1, -1])
    assert value == 0.9 and np.isnan([low, high]).all()


def test_probability_of_improvement_counts_ties_half():
    new, old = np.array([0.5, 1.0]), np.array([0.5, 0.0, 1.0])
    # Of 6 pairs: 0.5 > 0.0, 1.0 > 0.5, 1.0 > 0.0 and two ties.
    assert comparison.probability_of_improvement(new, old) == pytest.approx(4 / 6)
    assert comparison.probability_of_improvement(old, new) == pytest.approx(2 / 6)
    assert comparison.probability_of_improvement(ONES, ONES) == 0.5


def test_permutation_p_by_hand():
    # 2 of the 20 ways to part six values into threes are as extreme.
    p = comparison.permutation_p(np.array([4.0, 5.0, 6.0]), np.array([1.0, 2.0, 3.0]))
    assert p == pytest.approx(2 / 20)
    assert comparison.permutation_p(ONES, ZEROS) == pytest.approx(2 / 20_001)
    assert comparison.permutation_p(ONES, ONES) == 1


def test_permutations_that_tie_but_for_roundings_count():
    # The means are equal, but not the roundings of their sums.
    new, old = np.array([0.7, 0.5, 0.6, 0.8]), np.array([0.5, 0.8, 0.7, 0.6])
    assert comparison.permutation_p(new, old) == 1


def test_sign_flips_by_hand():
    assert comparison.sign_flip_p(np.array([0.1, 0.2, 0.3, 0.4])) == pytest.approx(2 / 16)
    assert comparison.sign_flip_p(ZEROS) == 1


def test_log_rank_censors_at_the_budget():
    soon, late = np.full(10, 300.0), np.full(10, INF)
    assert comparison.log_rank_p(soon, late, 3000) < 1e-4
    assert comparison.log_rank_p(late, late, 3000) == 1
    assert comparison.log_rank_p(soon, soon, 3000) == pytest.approx(1)
    # What lies beyond the budget is the same as never.
    beyond = np.full(10, 3300.0)
    assert comparison.log_rank_p(beyond, late, 3000) == 1


def test_no_seed_of_ten_is_not_certainly_none():
    low, high = comparison.share_bounds(0, 10)
    assert low == 0 and high == pytest.approx(1 - 0.025 ** (1 / 10))


def test_holm_by_hand():
    # Sorted 0.01, 0.03, 0.04: times 3, 2, 1, then never below the one before.
    assert comparison.holm([0.04, 0.01, 0.03]) == pytest.approx([0.06, 0.03, 0.06])
    assert comparison.holm([0.5, 0.9]) == pytest.approx([1, 1])
    assert comparison.holm([]) == []
