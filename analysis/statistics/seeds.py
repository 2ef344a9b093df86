"""Statistics over seeds: success per test period with intervals, final success, episodes, steps.

The seed is the unit throughout: a seed's success rate over its test episodes is one observation.
"""

import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy

from analysis.reading import schema

CONFIDENCE = 0.95
RESAMPLES = 9999
Bounds = tuple[float, float]
NO_BOUNDS = (float("nan"), float("nan"))
_SAME_JOB_SECONDS = 0.2
"""Seeds trained side by side are tested at the same time, to this accuracy."""
SOLVED = 0.8
"""Success rate from which a seed counts as having learnt its task."""

_AGENT = ["task", "subgoal_layers"]
_UNEQUAL_TRAINING = (
    "{task}, {layers} subgoal layers, period {period}: seeds were tested after different numbers"
    " of training episodes ({episodes}); they cannot be averaged"
)

FEW_SEEDS = 5
"""With fewer seeds, a bootstrap interval is little more than their range."""


class Interval(NamedTuple):
    """A mean over seeds and the interval that holds it with 95% confidence."""

    mean: float
    low: float
    high: float


def bootstrap(
    samples: Sequence[np.ndarray], statistic: Callable[..., np.ndarray], random_state: int = 0
) -> Bounds:
    """95% interval of a statistic of one or several strata, each resampled on its own.

    BCa, or percentiles where BCa is undefined. Where every resample gives the same value, both
    ends are that value. A stratum of one seed says nothing about the spread of seeds: NaN.

    Args:
      samples: a [n] for each stratum.
      statistic: as in scipy: takes the samples and `axis`, vectorised.
    """
    if not samples or min(map(len, samples)) < 2:
        return NO_BOUNDS
    for method in ("BCa", "percentile"):
        with warnings.catch_warnings(action="ignore"):  # BCa warns where it is undefined
            found = scipy.stats.bootstrap(
                tuple(samples),
                statistic,
                n_resamples=RESAMPLES,
                confidence_level=CONFIDENCE,
                method=method,
                vectorized=True,
                rng=np.random.default_rng(random_state),
            ).confidence_interval
        if np.isfinite(found).all():
            break
    return float(found.low), float(found.high)


def mean_interval(values: Iterable[float], random_state: int = 0) -> Interval:
    """Mean and 95% bootstrap interval (BCa, or percentile where BCa is undefined).

    Seeds that all tie (all 0%, all 100%) give that value as both ends. One seed says nothing about
    the spread of seeds: both ends are NaN then, and figures draw no band.

    Args:
      values: [n], one per seed, n >= 1, no NaN.
      random_state: seed of the resampling; each interval starts from it afresh, so that it does
        not depend on which others are computed.

    Raises:
      ValueError: no values, or some that are not finite.
    """
    sample = np.asarray(list(values), dtype=np.float64)
    if not len(sample) or not np.isfinite(sample).all():
        raise ValueError(f"a mean needs finite values, at least one; got {sample}")
    mean = float(sample.mean())
    if len(sample) == 1:
        return Interval(mean, np.nan, np.nan)
    if np.all(sample == sample[0]):
        return Interval(float(sample[0]), float(sample[0]), float(sample[0]))
    return Interval(mean, *bootstrap([sample], np.mean, random_state))


def success_per_period(results: pd.DataFrame, random_state: int = 0) -> pd.DataFrame:
    """Success rate per task, agent and test period: the numbers of Figure 5.

    Returns:
      `schema.FIGURE_COLUMNS`, sorted; `n` is the number of seeds that have the period, which may
      differ between periods while training goes on or where a seed failed.

    Raises:
      ValueError: seeds of one agent and period had different numbers of training episodes.
    """
    rows = []
    for (task, layers, period), group in results.groupby([*_AGENT, "period"]):
        episodes = sorted(group["train_episodes"].unique())
        if len(episodes) > 1:
            message = _UNEQUAL_TRAINING.format(
                task=task, layers=layers, period=period, episodes=", ".join(map(str, episodes))
            )
            raise ValueError(message)
        interval = mean_interval(group["success_rate"], random_state)
        rows.append((task, layers, period, episodes[0], len(group), *interval))
    return pd.DataFrame(rows, columns=list(schema.FIGURE_COLUMNS))


def with_cost(summary: pd.DataFrame, results: pd.DataFrame) -> pd.DataFrame:
    """A summary of `success_per_period` with what had been spent by then, means over seeds.

    Returns:
      Its rows and columns, and `train_steps` and `core_minutes`, those of one seed.
    """
    cost = results.assign(core_minutes=core_seconds(results) / 60)
    means = cost.groupby([*_AGENT, "period"])[["train_steps", "core_minutes"]].mean()
    return summary.join(means, on=[*_AGENT, "period"])


def final_success(results: pd.DataFrame, random_state: int = 0) -> pd.DataFrame:
    """Where each agent stands at the last test period that any of its seeds has.

    Returns:
      A row per task and agent: `schema.FIGURE_COLUMNS` of that period; `seeds`, all that the agent
      has (more than `n` where some lack the period); `median_steps`, the median over seeds of the
      mean steps to goal of their successful tests (NaN without a success); `episodes_to_80` and
      `reached_80` as in `episodes_to`.
    """
    summary = success_per_period(results, random_state)
    final = summary.loc[summary.groupby(_AGENT)["period"].idxmax()]
    last = results.merge(final[[*_AGENT, "period"]])
    columns = [
        results.groupby(_AGENT)["seed"].nunique().rename("seeds"),
        last.groupby(_AGENT)["mean_steps_to_goal"].median().rename("median_steps"),
    ]
    for column in columns:
        final = final.join(column, on=_AGENT)
    final = final.merge(episodes_to(results).drop(columns="seeds"), on=_AGENT)
    return final.rename(columns={"median_episodes": "episodes_to_80", "reached": "reached_80"})


def episodes_to(results: pd.DataFrame, success_rate: float = SOLVED) -> pd.DataFrame:
    """Training episodes until a seed's test success first reaches `success_rate`.

    Returns:
      A row per task and agent: `reached`, seeds that did; `seeds`, all; `median_episodes`, the
      median over all seeds where one that never did counts as infinite: NaN when that is it.
    """
    first = (
        results[results["success_rate"] >= success_rate]
        .groupby([*_AGENT, "seed"])["train_episodes"]
        .min()
    )
    everyone = pd.MultiIndex.from_frame(results[[*_AGENT, "seed"]].drop_duplicates())
    grouped = first.reindex(everyone).fillna(np.inf).groupby(level=_AGENT)
    table = pd.DataFrame(
        {
            "reached": grouped.agg(lambda episodes: int(np.isfinite(episodes).sum())).astype(int),
            "seeds": grouped.size(),
            "median_episodes": grouped.agg(np.median).replace(np.inf, np.nan),
        }
    )
    return table.reset_index()


def last_rows(results: pd.DataFrame) -> pd.DataFrame:
    """The last test period of each task, agent and seed, whichever that is."""
    return results.loc[results.groupby([*_AGENT, "seed"])["period"].idxmax()]


def core_minutes(results: pd.DataFrame) -> pd.Series:
    """Minutes of a core that all seeds took together, by task and subgoal layers."""
    complete = results.assign(core_seconds=core_seconds(results).to_numpy())
    last = last_rows(complete.reset_index(drop=True))
    return last.groupby(_AGENT)["core_seconds"].sum() / 60


def core_seconds(results: pd.DataFrame) -> pd.Series:
    """Seconds of a core that each row's seed had taken until then, [rows].

    It is the column of that name. Rows of earlier versions lack it: seeds whose last tests ended
    within a moment of each other were trained in one process, whose time they share equally.
    """
    index, results = results.index, results.reset_index(drop=True)  # which may repeat itself
    last = last_rows(results).sort_values("wall_seconds")
    apart = last.groupby(_AGENT)["wall_seconds"].diff().fillna(np.inf) > _SAME_JOB_SECONDS
    job = apart.groupby([last[column] for column in _AGENT]).cumsum()
    size = last.groupby([*_AGENT, job])["seed"].transform("size").rename("size")
    sizes = results[[*_AGENT, "seed"]].merge(last[[*_AGENT, "seed"]].join(size), how="left")["size"]
    found = results["wall_seconds"] / sizes
    if "core_seconds" in results:
        found = results["core_seconds"].fillna(found)
    return found.set_axis(index)


def n_label(counts: Iterable[int]) -> str:
    """How many seeds stand behind a curve: "n=10", or "n=8-10" where periods differ."""
    low, high = min(counts), max(counts)
    return f"n={low}" if low == high else f"n={low}-{high}"
