"""What repeats of a measurement say: their median, and how sure it is."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import stats

REPEATS = 5
_RESAMPLES = 9999


def summary(samples: Sequence[float]) -> tuple[float, list[float]]:
    """The median of the samples and its 95% bootstrap interval [low, high].

    Raises:
      ValueError: there are no samples.
    """
    values = np.asarray(samples, dtype=np.float64)
    if not len(values):
        raise ValueError("nothing was measured")
    if np.ptp(values) == 0:  # nothing to resample
        return float(values[0]), [float(values[0])] * 2
    found = stats.bootstrap(
        (values,),
        np.median,
        n_resamples=_RESAMPLES,
        vectorized=True,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return float(np.median(values)), [float(found.low), float(found.high)]


def entry(key: str, samples: Sequence[float]) -> dict[str, Any]:
    """A report's entries for a figure: `key`, the median, and `<key>_ci` beside it."""
    middle, interval = summary(samples)
    return {key: rounded(middle), f"{key}_ci": [rounded(end) for end in interval]}


def rounded(value: float) -> float:
    """Four significant digits, more than any measurement here has."""
    return float(f"{value:.4g}")
