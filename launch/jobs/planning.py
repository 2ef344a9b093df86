"""Plans the jobs, and the order in which workers take them."""

import heapq
import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from launch.folder.agents import Agent, Job

_MOST_JOBS_PER_WORKER = 3
_FINE = 64  # up to twice as many workers get plans that differ by a single piece
_NEARLY = 1.15  # a plan with fewer jobs may end this many times later than the earliest


class Group(NamedTuple):
    """Where some seeds of an agent stand: only those at the same episode train side by side."""

    agent: Agent
    train_episodes: int = 0


def plan(missing: Mapping[Group, tuple[int, ...]], workers: int, episodes: int = 1) -> list[Job]:
    """Jobs for the missing seeds of each group, longest first.

    `episodes` is how many each seed is to have been trained for in the end.

    A group's seeds stay together as far as that keeps all workers busy, since a population shares
    its matrix products: of the plans made by cutting the group of the longest job into one piece
    more, again and again, the one of fewest jobs that ends nearly as early as any. A seed's results
    do not depend on the seeds it is trained with, so that any grouping gives the same experiment.
    """
    pieces = {group: 1 for group, seeds in missing.items() if seeds}
    step = max(1, workers // _FINE)  # of a thousand workers, one piece more makes no difference
    plans = [_jobs(missing, pieces, episodes)]
    while len(plans[-1]) < _MOST_JOBS_PER_WORKER * workers:
        longest = max((job for job in plans[-1] if len(job.seeds) > 1), key=_cost, default=None)
        if longest is None:
            break
        group = Group(longest.agent, longest.start)
        pieces[group] = min(pieces[group] + step, len(missing[group]))
        plans.append(_jobs(missing, pieces, episodes))
    busy = [jobs for jobs in plans if len(jobs) >= workers] or plans[-1:]
    ends = [makespan([job.cost for job in jobs], workers) for jobs in busy]
    good = (jobs for jobs, end in zip(busy, ends, strict=True) if end <= _NEARLY * min(ends))
    return next(good)


def _jobs(
    missing: Mapping[Group, tuple[int, ...]], pieces: Mapping[Group, int], episodes: int
) -> list[Job]:
    """Each group's seeds in so many pieces of about the same size; the longest job first."""
    jobs = []
    for group, count in pieces.items():
        seeds = tuple(missing[group])
        ends = [-(-len(seeds) * piece // count) for piece in range(count + 1)]
        jobs += [
            Job(group.agent, seeds[start:end], group.train_episodes, episodes)
            for start, end in itertools.pairwise(ends)
        ]
    return sorted(jobs, key=_cost, reverse=True)


def makespan(costs: Sequence[float], workers: int) -> float:
    """When the last worker ends, in the unit of the costs: whoever is free takes the next job."""
    ends = [0.0] * workers
    for cost in costs:
        heapq.heappush(ends, heapq.heappop(ends) + cost)
    return max(ends)


def _cost(job: Job) -> float:
    return job.cost
