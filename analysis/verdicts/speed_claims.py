"""Claims of section 4.2 about which agents learn faster, judged from results.csv."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from analysis.reading import paper
from analysis.statistics import comparison
from analysis.statistics.areas import areas, common_budget
from analysis.statistics.seeds import SOLVED, bootstrap
from analysis.verdicts import evidence
from analysis.verdicts.evidence import Claim, Evidence
from analysis.verdicts.rivals import Rival, strongest

Grid = Mapping[str, pd.DataFrame]  # results by task
Flats = Mapping[str, Grid]  # results of other agents without subgoal layers, by name

_AREA = "area under the success curve, gain"
_IMPROVEMENT = "probability of improvement"
_TO_SOLVED = f"episodes to {SOLVED:.0%}, saved"


def rivals(grid: Grid, flats: Flats) -> dict[str, Rival]:
    """By task, the strongest by area under the success curve against training episodes."""
    return {task: strongest(results, _of_task(flats, task)) for task, results in grid.items()}


def _of_task(flats: Flats, task: str) -> dict[str, pd.DataFrame]:
    return {name: own[task] for name, own in flats.items() if task in own}


def beats_flat(grid: Grid, flats: Flats) -> Claim:
    """Claim (a), against the strongest agent without subgoal layers; the weaker ones beside it."""
    pairs = [(task, layers, 0) for task in paper.TITLES for layers in (1, 2)]
    statement = "On every task, agents with 1 and with 2 subgoal layers learn faster than with 0."
    found = rivals(grid, flats)
    results = {task: rival.results for task, rival in found.items()}
    names = {task: rival.name for task, rival in found.items()}
    claim = _speed_claim("a", statement, results, pairs, flat_names=names)
    return replace(claim, evidence=(*claim.evidence, *_against_weaker(found)))


def _against_weaker(found: Mapping[str, Rival]) -> Iterator[Evidence]:
    for task, rival in found.items():
        for name, results in rival.weaker.items():
            for layers in sorted(_agents(results) - {0}):
                yield _compare(task, results, layers, 0, name)[0]


def deeper_is_faster(grid: Grid) -> Claim:
    """Claim (c)."""
    pairs = [(task, 2, 1) for task in paper.TITLES]
    statement = (
        "On every task but pick-and-place, agents with 2 subgoal layers learn faster than with 1."
    )
    return _speed_claim("c", statement, grid, pairs, exceptions=("pick_place",))


def _speed_claim(
    letter: str,
    statement: str,
    grid: Grid,
    pairs: Sequence[tuple[str, int, int]],
    exceptions: Sequence[str] = (),
    flat_names: Mapping[str, str] | None = None,
) -> Claim:
    """That the first of each pair of agents learns faster than the second.

    Args:
      flat_names: by task, what the agent without subgoal layers is called.
    """
    flat_names = flat_names or {}
    present = [
        (t, new, old) for t, new, old in pairs if t in grid and {new, old} <= _agents(grid[t])
    ]
    compared = [
        _compare(task, grid[task], new, old, flat_names.get(task, "")) for task, new, old in present
    ]
    gains = evidence.judge_gains([gain for gain, *_ in compared])
    listed = [e for gain, (_, *more) in zip(gains, compared, strict=True) for e in (gain, *more)]
    counted = [gain for gain in gains if gain.task not in exceptions]
    absent = _absent([pair for pair in pairs if pair[0] not in exceptions], present)
    pooled = [pair for pair in present if pair[0] not in exceptions]
    return Claim(
        letter,
        statement,
        evidence.overall((gain.verdict for gain in counted), absent),
        evidence.count(counted, absent) + _about_exceptions(gains, exceptions) + _about_cuts(grid),
        _pooled_gain(grid, pooled) if pooled else None,
        tuple(listed),
    )


def _absent(
    pairs: Sequence[tuple[str, int, int]], present: Sequence[tuple[str, int, int]]
) -> list[str]:
    """Names of the pairs without data; just the task where all of its pairs are."""
    some = {task for task, *_ in present}
    names = [
        f"{task} {new} against {old}" if task in some else task
        for task, new, old in pairs
        if (task, new, old) not in present
    ]
    return list(dict.fromkeys(names))


def _about_exceptions(gains: Iterable[Evidence], exceptions: Sequence[str]) -> str:
    parts = [f"; not counted: {g.task}, {g.verdict}" for g in gains if g.task in exceptions]
    return "".join(parts)


def _about_cuts(grid: Grid) -> str:
    """Names tasks in which a seed ended before the others, and with it what is compared."""
    parts = []
    for task, results in grid.items():
        budget, longest = common_budget(results), results["train_episodes"].max()
        if budget < longest:
            parts.append(
                f"; {task} compared over {budget:.0f} of {longest} episodes, a seed's last"
            )
    return "".join(parts)


def _compare(
    task: str, results: pd.DataFrame, new: int, old: int, flat_name: str = ""
) -> tuple[Evidence, ...]:
    """Area, probability of improvement and episodes to 80% of agent `new` against `old`."""
    pair = areas_of(results, new), areas_of(results, old)
    seeds = tuple(map(len, pair))
    agents = f"{new} against {old}" + (f" ({flat_name})" if flat_name else "")
    improvement = comparison.probability_of_improvement
    budget = common_budget(results)
    times = episodes_to_solved(results, new), episodes_to_solved(results, old)
    spent = [np.minimum(own, budget) for own in times]
    gain = comparison.contrast(pair, (1, -1))
    saved = comparison.contrast(spent, (-1, 1))
    return (
        Evidence(task, agents, _AREA, "points", seeds, *gain, comparison.permutation_p(*pair)),
        Evidence(
            task, agents, _IMPROVEMENT, "share", seeds,
            float(improvement(*pair)), *bootstrap(pair, improvement),
            comparison.rank_p(*pair),
        ),
        Evidence(
            task, agents, _TO_SOLVED, "episodes", seeds,
            *saved, comparison.log_rank_p(*times, budget),
        ),
    )  # fmt: skip


def _pooled_gain(grid: Grid, pairs: Sequence[tuple[str, int, int]]) -> Evidence:
    """The mean gain in area over pairs, resampled within each task and agent."""
    weights: dict[tuple[str, int], float] = {}
    for task, new, old in pairs:
        for layers, sign in ((new, 1), (old, -1)):
            weights[task, layers] = weights.get((task, layers), 0.0) + sign / len(pairs)
    samples = [areas_of(grid[task], layers) for task, layers in weights]
    agents = ", ".join(dict.fromkeys(f"{new} against {old}" for _, new, old in pairs))
    value = comparison.contrast(samples, list(weights.values()))
    return Evidence(
        evidence.named(task for task, *_ in pairs),
        agents, f"mean {_AREA}", "points", (sum(map(len, samples)),), *value,
    )  # fmt: skip


def areas_of(results: pd.DataFrame, layers: int) -> np.ndarray:
    """Area under each seed's success curve, [seeds], as a share of the largest one possible.

    Curves are cut where the task's first seed ends, so that all have had the same training.
    """
    own = results[results["subgoal_layers"] == layers]
    return areas(own, common_budget(results)).to_numpy()


def episodes_to_solved(results: pd.DataFrame, layers: int) -> np.ndarray:
    """Training episodes until each seed's tests first succeed to 80%, [seeds]; inf for never."""
    own = results[results["subgoal_layers"] == layers]
    solved = own["train_episodes"].where(own["success_rate"] >= SOLVED, np.inf)
    return solved.groupby(own["seed"]).min().to_numpy(dtype=float)


def _agents(results: pd.DataFrame) -> set[int]:
    """Agents whose training has begun, for every seed of the task."""
    return set(results["subgoal_layers"]) if common_budget(results) else set()
