"""Comparing agents over seeds: t intervals, exact permutation tests, Holm's correction.

Samples are [seeds]; the seed is the unit throughout. A stratum is the seeds of one agent on one
task. Sources: scipy.stats.
"""

from collections.abc import Callable, Sequence

import numpy as np
import scipy

from analysis.statistics.seeds import CONFIDENCE, NO_BOUNDS, Bounds

# Up to eight seeds against eight are permuted in every possible way, more at random.
_PERMUTATIONS = 20_000
_NO_SPREAD = 1e-24  # a variance of shares that is not zero for its roundings only
_DECIMALS = 12  # what differs only in later ones ties; scipy counts exact values


def contrast(samples: Sequence[np.ndarray], weights: Sequence[float]) -> tuple[float, float, float]:
    """The weighted sum of the strata's means, with its 95% t interval (Welch and Satterthwaite).

    Not a bootstrap interval: of ten seeds, those are too narrow. Where no stratum varies, both ends
    are the value. A stratum of one seed says nothing about the spread of seeds: NaN.
    """
    total = sum(w * part.mean() for w, part in zip(weights, samples, strict=True))
    value = round(float(total), _DECIMALS) + 0.0  # no -0.0
    if min(map(len, samples)) < 2:
        return value, *NO_BOUNDS
    sizes = np.array([len(part) for part in samples])
    variances = np.square(weights) * [part.var(ddof=1) for part in samples] / sizes
    if not variances.sum() > _NO_SPREAD:
        return value, value, value
    freedom = variances.sum() ** 2 / (variances**2 / (sizes - 1)).sum()
    low, high = scipy.stats.t.interval(CONFIDENCE, freedom, value, variances.sum() ** 0.5)
    return value, float(low), float(high)


def probability_of_improvement(new: np.ndarray, old: np.ndarray, axis: int = -1) -> np.ndarray:
    """P(new > old) + P(new = old) / 2 of two seeds drawn at random, from [..., n] and [..., m]."""
    new, old = np.moveaxis(new, axis, -1), np.moveaxis(old, axis, -1)
    gain = np.sign(new[..., :, None] - old[..., None, :])
    return (1 + gain.mean(axis=(-2, -1))) / 2


def rank_p(new: np.ndarray, old: np.ndarray) -> float:
    """Two-sided p of Mann and Whitney's test; 1 where all tie."""
    if np.ptp(np.concatenate([new, old])) == 0:
        return 1.0
    return float(scipy.stats.mannwhitneyu(new, old).pvalue)


def permutation_p(new: np.ndarray, old: np.ndarray) -> float:
    """Two-sided p of a difference in means between independent seeds; 1 where all tie."""

    def difference(x: np.ndarray, y: np.ndarray, axis: int = -1) -> np.ndarray:
        return np.round(x.mean(axis=axis) - y.mean(axis=axis), _DECIMALS)

    return _permuted((new, old), difference, "independent")


def sign_flip_p(changes: np.ndarray) -> float:
    """Two-sided p of a mean change within seeds, from flipping the signs of [n] changes."""
    return _permuted((changes, np.zeros_like(changes)), _mean_difference, "samples")


def _mean_difference(x: np.ndarray, y: np.ndarray, axis: int = -1) -> np.ndarray:
    return np.round((x - y).mean(axis=axis), _DECIMALS)


def _permuted(samples: tuple, statistic: Callable[..., np.ndarray], kind: str) -> float:
    if min(map(len, samples)) < 2 or np.ptp(np.concatenate(samples)) == 0:
        return 1.0
    found = scipy.stats.permutation_test(
        samples,
        statistic,
        permutation_type=kind,
        vectorized=True,
        n_resamples=_PERMUTATIONS,
        rng=np.random.default_rng(0),
    )
    return float(found.pvalue)


def log_rank_p(new: np.ndarray, old: np.ndarray, budget: float) -> float:
    """Two-sided log-rank p of times [n] and [m]; those beyond `budget` are censored there."""
    if (new > budget).all() and (old > budget).all():
        return 1.0
    with np.errstate(invalid="ignore"):  # 0 / 0 where all seeds tie
        found = scipy.stats.logrank(*(_censored(times, budget) for times in (new, old)))
    return 1.0 if np.isnan(found.pvalue) else float(found.pvalue)


def _censored(times: np.ndarray, budget: float) -> "scipy.stats.CensoredData":
    late = times > budget
    return scipy.stats.CensoredData(uncensored=times[~late], right=np.full(late.sum(), budget))


def share_bounds(successes: int, n: int) -> Bounds:
    """95% interval of a share, exact (Clopper and Pearson): 0 of 10 is not certainly 0."""
    found = scipy.stats.binomtest(successes, n).proportion_ci(CONFIDENCE, method="exact")
    return float(found.low), float(found.high)


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's adjusted p values: below alpha, they are so jointly for the whole family."""
    adjusted = np.zeros(len(p_values))
    highest = 0.0
    for rank, index in enumerate(np.argsort(p_values, kind="stable")):
        highest = max(highest, min(1.0, (len(p_values) - rank) * p_values[index]))
        adjusted[index] = highest
    return adjusted.tolist()
