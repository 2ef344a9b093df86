"""Claims of section 4 about how fast and how well agents learn, judged from results.csv."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np
import pandas as pd
import scipy

from analysis.reading import paper, schema
from analysis.statistics import comparison
from analysis.statistics.seeds import SOLVED, bootstrap, last_rows
from analysis.verdicts import evidence
from analysis.verdicts.evidence import NOT_SUPPORTED, SUPPORTED, UNDECIDED, Claim, Evidence
from analysis.verdicts.speed_claims import Flats, Grid, beats_flat, deeper_is_faster, rivals

CONSISTENT = 0.9
"""A seed solves its task above this success; an agent does so consistently if as many seeds do."""
STEPS_BAND = (0.75, 1.25)
"""Steps to goal count as the paper's within a quarter of them."""
_LATE_PERIODS = 3
_LEVELS = ((1, 1), (2, 1), (2, 2))  # subgoal layers of an agent, level that proposes

_CONSISTENT = f"seeds above {CONSISTENT:.0%} at the end"
_STEPS = "median steps to goal / paper's"
_MISSED = "fall in missed subgoals, first period to last three"
_STILL_MISSED = "subgoals missed in training, last three periods"
_MISSED_IN_TESTS = "subgoals missed in noise-free tests, last three periods"


def judge_learning(grid: Grid, flats: Flats) -> list[Claim]:
    """Claims (a) to (e)."""
    return [
        beats_flat(grid, flats),
        _flat_is_inconsistent(grid, flats),
        deeper_is_faster(grid),
        _steps_are_efficient(grid),
        _misses_get_rarer(grid),
    ]


def _flat_is_inconsistent(grid: Grid, flats: Flats) -> Claim:
    """Claim (b), of the strongest agent without subgoal layers on each task."""
    items, solved = [], {}
    for task, (name, results, _) in rivals(grid, flats).items():
        last = last_rows(results[results["subgoal_layers"] == 0])["success_rate"].to_numpy()
        if len(last):
            solved[task] = (last > CONSISTENT).astype(float)
            items.append(_share_of_seeds(task, f"0 ({name})" if name else "0", solved[task]))
    adjusted = comparison.holm([item.p for item in items])
    items = [_judge_share(replace(e, p_holm=p)) for e, p in zip(items, adjusted, strict=True)]
    judged = [item.verdict for item in items]
    many = len(paper.TITLES) // 2 + 1
    found = [v for v in (SUPPORTED, NOT_SUPPORTED) if judged.count(v) >= many]
    samples = list(solved.values())
    headline = Evidence(
        evidence.named(solved), "0", f"mean share of {_CONSISTENT}", "share",
        (sum(map(len, samples)),),
        *comparison.contrast(samples, [1 / len(samples)] * len(samples)),
    ) if samples else None  # fmt: skip
    return Claim(
        "b",
        f"On many tasks (at least {many} of {len(paper.TITLES)}), agents without subgoal layers do "
        "not consistently solve the task.",
        found[0] if found else UNDECIDED,
        evidence.count(items, [task for task in paper.TITLES if task not in _names(items)]),
        headline,
        tuple(items),
    )


def _names(items: Iterable[Evidence]) -> set[str]:
    return {item.task for item in items}


def _share_of_seeds(task: str, agent: str, of_seeds: np.ndarray) -> Evidence:
    solved, n = int(of_seeds.sum()), len(of_seeds)
    p = float(scipy.stats.binomtest(solved, n, CONSISTENT, alternative="less").pvalue)
    bounds = comparison.share_bounds(solved, n)
    return Evidence(task, agent, _CONSISTENT, "share", (n,), solved / n, *bounds, p)


def _judge_share(item: Evidence) -> Evidence:
    """Inconsistent if the share is surely below `CONSISTENT`; consistent if it reaches it."""
    if item.seeds[0] < evidence.LEAST_SEEDS:
        return replace(item, verdict=UNDECIDED)
    if item.p_holm < evidence.ALPHA:
        return replace(item, verdict=SUPPORTED)
    return replace(item, verdict=NOT_SUPPORTED if item.value >= CONSISTENT else UNDECIDED)


def _steps_are_efficient(grid: Grid) -> Claim:
    ratios = {task: _step_ratios(task, results) for task, results in grid.items()}
    ratios = {task: own for task, own in ratios.items() if len(own)}
    items = [
        evidence.judge_within(
            Evidence(
                task, "any, converged", _STEPS, "ratio", (len(own),),
                float(np.median(own)), *bootstrap([own], np.median),
            ),
            *STEPS_BAND,
        )
        for task, own in ratios.items()
    ]  # fmt: skip
    absent = [task for task in paper.TITLES if task not in ratios]
    samples = list(ratios.values())
    headline = Evidence(
        evidence.named(ratios), "any, converged", f"mean of {_STEPS}", "ratio",
        (sum(map(len, samples)),),
        float(_mean_of_medians(*samples)), *bootstrap(samples, _mean_of_medians),
    ) if samples else None  # fmt: skip
    return Claim(
        "d",
        "Agents that have learnt take about as many steps as the paper's efficient policies.",
        evidence.overall((item.verdict for item in items), absent),
        evidence.count(items, absent),
        headline,
        tuple(items),
    )


def _step_ratios(task: str, results: pd.DataFrame) -> np.ndarray:
    """Steps to goal against the paper's, [seeds of any agent that end at 80% or more]."""
    last = last_rows(results)
    steps = last.loc[last["success_rate"] >= SOLVED, "mean_steps_to_goal"]
    return steps.to_numpy() / paper.STEPS_TO_GOAL[task]


def _mean_of_medians(*samples: np.ndarray, axis: int = -1) -> np.ndarray:
    return np.mean([np.median(sample, axis=axis) for sample in samples], axis=0)


def _misses_get_rarer(grid: Grid) -> Claim:
    levels = [(task, layers, level) for task in paper.TITLES for layers, level in _LEVELS]
    falls = {
        key: fall
        for key in levels
        if key[0] in grid and len(fall := falls_in_missed(grid[key[0]], *key[1:]))
    }
    items = evidence.judge_gains(
        [
            Evidence(
                task, f"{layers}, level {level}", _MISSED, "points", (len(own),),
                *comparison.contrast([own.to_numpy()], [1]), comparison.sign_flip_p(own.to_numpy()),
            )
            for (task, layers, level), own in falls.items()
        ]
    )  # fmt: skip
    some = _names(items)
    absent = list(
        dict.fromkeys(
            f"{task} ({layers}, level {level})" if task in some else task
            for task, layers, level in levels
            if (task, layers, level) not in falls
        )
    )
    return Claim(
        "e",
        "Subgoal layers come to propose what the level below can achieve: on every task, for every "
        "level, missed subgoals get rarer over training.",
        evidence.overall((item.verdict for item in items), absent),
        evidence.count(items, absent),
        _pooled_fall(falls) if falls else None,
        (*items, *_still_missed(grid, falls)),
    )


def _still_missed(grid: Grid, levels: Iterable[tuple[str, int, int]]) -> Iterator[Evidence]:
    """What a fall alone does not say: how many subgoals are missed in the end."""
    for quantity, field in ((_STILL_MISSED, "achieved"), (_MISSED_IN_TESTS, "test_achieved")):
        for task, layers, level in levels:
            own = late_missed(grid[task], layers, level, field).to_numpy()
            if len(own):
                yield Evidence(
                    task, f"{layers}, level {level}", quantity, "share", (len(own),),
                    float(own.mean()), *bootstrap([own], np.mean),
                )  # fmt: skip


def _pooled_fall(falls: Mapping[tuple[str, int, int], pd.Series]) -> Evidence:
    """The mean over agents; the levels of an agent share its seeds, which are one stratum."""
    strata = [
        pd.concat([own for key, own in falls.items() if key[:2] == agent], axis=1).mean(axis=1)
        for agent in dict.fromkeys(key[:2] for key in falls)
    ]
    samples = [stratum.to_numpy() for stratum in strata]
    return Evidence(
        evidence.named(task for task, *_ in falls), "1, 2", f"mean {_MISSED}", "points",
        (sum(map(len, samples)),),
        *comparison.contrast(samples, [1 / len(samples)] * len(samples)),
    )  # fmt: skip


def falls_in_missed(results: pd.DataFrame, layers: int, level: int) -> pd.Series:
    """By how much the share of missed subgoals fell, by seed: first period minus last three.

    Of the subgoals that `level` proposed in training; seeds without two periods are left out.
    """
    falls = {
        seed: missed[0] - missed[max(1, len(missed) - _LATE_PERIODS) :].mean()
        for seed, missed in _missed(results, layers, level, "achieved").items()
        if len(missed) > 1
    }
    return pd.Series(falls, dtype=float)


def late_missed(results: pd.DataFrame, layers: int, level: int, field: str) -> pd.Series:
    """The share of subgoals that `level` missed in the last three periods, by seed.

    Args:
      field: "achieved": of those proposed in training, the share that was not; "test_achieved": the
        same of those in noise-free tests. Attempts that were cut short count as missed in both.
    """
    curves = _missed(results, layers, level, field)
    return pd.Series(
        {seed: own[-_LATE_PERIODS:].mean() for seed, own in curves.items()}, dtype=float
    )


def _missed(results: pd.DataFrame, layers: int, level: int, field: str) -> dict[int, np.ndarray]:
    """By seed, the share of a level's subgoals that were missed, period by period."""
    column = schema.level_column(level, field)
    if column not in results:
        return {}
    own = results[results["subgoal_layers"] == layers].dropna(subset=column)
    curves = {seed: curve[column].to_numpy() for seed, curve in own.groupby("seed")}
    return {seed: 1 - curve for seed, curve in curves.items()}
