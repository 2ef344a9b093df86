"""Estimates the memory and disk that a training needs, and compares them with the machine's."""

import dataclasses
import functools
import heapq
import itertools
import os
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

import hac_suite
from analysis.program import CommandError
from hac_suite.learning import learners
from hac_suite.types import LevelSpec, Spaces, level_specs
from launch.folder.agents import Job
from launch.folder.layout import RunFolder
from tasks.goal_space import GoalSpace

PROCESS = 400_000_000  # bytes that a worker takes whatever it trains: Python, torch, MuJoCo
_TABLES = 13  # what TD3 has; where a learner cannot say how many it has
_WIDTH = 64  # of the layers of a learner that is made to count its tables
_NUMBER = 4  # bytes
_NO_MEMORY = (
    "{who}: one seed needs {need} of memory, and this machine has {total}; make "
    "--config.replay_capacity, --config.hidden_sizes or --config.test_episodes smaller"
)
_NO_DISK = (
    "{who}: the checkpoints of one seed need {need} of disk, and {out} has {free} free; free some "
    "space, give another --out, or make --config.replay_capacity smaller"
)
_LITTLE_MEMORY = (
    "warning: this run may need {need} of memory, and {free} are free; fewer --workers need less"
)
_LITTLE_DISK = (
    "warning: checkpoints may need {need} of disk, and {out} has {free} free; checkpoints that do "
    "not fit are not saved: free some space, or give another --out; --keep_final=false needs less"
)
_MEMORY_LIMITS = (
    ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
    ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
)


class Size(NamedTuple):
    """Bytes that one seed takes."""

    state: int  # in memory and in a checkpoint; see `of_seed`
    copies: int = 0  # in memory only: the environments that it is trained and tested in


class Need(NamedTuple):
    """Bytes that a launch takes at most."""

    memory: int  # of all workers at a time
    disk: int  # of its checkpoints


def of_seed(
    spaces: Spaces,
    horizons: tuple[int, ...],
    config: hac_suite.Config,
    *,
    max_steps: int,
    episodes: int,
) -> int:
    """Bytes of one seed's state after these episodes: in memory, and in a checkpoint.

    An upper bound: a replay buffer holds no more than its capacity, and no more than every control
    step would give it were each an attempt.
    """
    most = episodes * max_steps * (2 + config.hindsight_goals)
    rows, size, count = min(config.replay_capacity, most), 0, tables(config)
    for level in level_specs(spaces, horizons):
        networks = count * _network(level, config)
        size += _NUMBER * (rows * 2 * (_block(level) + 1) + networks)
    return size


@functools.cache
def tables(config: hac_suite.Config) -> int:
    """How many tables of a network's size the learner keeps for each seed and level.

    They are networks, their targets, averages and Adam's moments. They are counted in a learner of
    narrow layers, since one of the real width may not fit into memory.
    """
    four = np.ones(4)
    space = GoalSpace(tuple("abcd"), ("",) * 4, -four, four, four)
    level = LevelSpec(np.ones(8), space, action_dim=4, attempts=10)
    narrow = dataclasses.replace(config, hidden_sizes=(_WIDTH,) * len(config.hidden_sizes))
    try:
        learner = learners.find(config.learner)(level, narrow, [torch.Generator()])
        found = [tensor.numel() for tensor in learner.tensors(0).values()]
    except Exception:  # a learner of one's own: the training will say what is wrong with it
        return _TABLES
    network = _network(level, narrow)
    return sum(max(1, round(numbers / network)) for numbers in found if numbers > 1)


def _block(level: LevelSpec) -> int:
    """Numbers of an observation, a goal and an action, with the bias."""
    return level.action_dim + level.observation_dim + level.goal_space.dim + 1


def _network(level: LevelSpec, config: hac_suite.Config) -> int:
    """Numbers of a network, at most: with the critic's inputs and the actor's outputs."""
    layers = itertools.pairwise((_block(level), *config.hidden_sizes, level.action_dim))
    return sum((inputs + 1) * outputs for inputs, outputs in layers)


def of_jobs(
    jobs: Sequence[Job],
    workers: int,
    size_of: Callable[[Job], Size],
    *,
    keep_final: bool,
) -> Need:
    """What jobs need that so many workers take at a time.

    While one is written there are three checkpoints of a seed in training.

    Args:
      size_of: a job's size for each of its seeds, at its end.
    """
    sizes = [(len(job.seeds), *size_of(job)) for job in jobs]
    # Of a seed that is saved there is a copy in memory.
    memory = _most(workers, (PROCESS + (n + 1) * state + n * copies for n, state, copies in sizes))
    states = [n * state for n, state, _ in sizes]
    training = _most(workers, states)
    kept = sum(states) if keep_final else training
    return Need(memory, kept + 2 * training)


def replaced(jobs: Iterable[Job], folders: Mapping[str, RunFolder]) -> int:
    """Bytes of the checkpoints that the jobs' seeds have in their tasks' folders already."""
    own = (
        folders[job.agent.task].checkpoints_of(job.agent.subgoal_layers, seed)
        for job in jobs
        for seed in job.seeds
    )
    return sum(file.stat().st_size for of in own for file in of.glob("*") if file.is_file())


def doubts(
    jobs: Sequence[Job],
    workers: int,
    size_of: Callable[[Job], Size],
    out: Path,
    *,
    kept: int,
    keep_final: bool,
    here: bool,
) -> list[str]:
    """What a person should know before jobs begin: that they may need more than there is.

    Args:
      size_of: as in `of_jobs`.
      kept: bytes of checkpoints that are there already, and are `replaced`.
      here: whether they are trained on this machine.

    Raises:
      CommandError: there is not enough for one seed.
    """
    if not jobs:
        return []
    need = of_jobs(jobs, workers, size_of, keep_final=keep_final)
    largest = max(jobs, key=size_of)
    (one, copies), (total, free), disk = size_of(largest), memory(), free_disk(out) + kept
    least = PROCESS + 2 * one + copies
    if here and least > total:
        raise CommandError(
            _NO_MEMORY.format(who=largest.agent, need=told(least), total=told(total))
        )
    if 2 * one > disk:
        raise CommandError(
            _NO_DISK.format(who=largest.agent, need=told(2 * one), out=out, free=told(disk))
        )
    lines = []
    if here and need.memory > free:
        lines.append(_LITTLE_MEMORY.format(need=told(need.memory), free=told(free)))
    if need.disk > disk:
        lines.append(_LITTLE_DISK.format(need=told(need.disk), out=out, free=told(disk)))
    return lines


def _most(count: int, sizes: Iterable[int]) -> int:
    return sum(heapq.nlargest(count, sizes))


def free_disk(path: Path) -> int:
    """Bytes that can be written at a path, of which only the first folders may be there."""
    there = next(
        folder for folder in (path.absolute(), *path.absolute().parents) if folder.exists()
    )
    return shutil.disk_usage(there).free


def memory() -> tuple[int, int]:
    """Bytes of memory that this machine has, and that are free; a container may have less."""
    page = os.sysconf("SC_PAGE_SIZE")
    total = page * os.sysconf("SC_PHYS_PAGES")
    free = page * os.sysconf("SC_AVPHYS_PAGES") if "SC_AVPHYS_PAGES" in os.sysconf_names else total
    for line in _text("/proc/meminfo").splitlines():
        if line.startswith("MemAvailable:"):  # that is what is free and what can be freed
            free = 1024 * int(line.split()[1])
    for limit_file, used_file in _MEMORY_LIMITS:
        limit, used = _text(limit_file).strip(), _text(used_file).strip()
        if limit.isdigit() and used.isdigit() and int(limit) < total:
            total, free = int(limit), min(free, int(limit) - int(used))
    return total, free


def _text(file: str) -> str:
    try:
        return Path(file).read_text(encoding="utf-8")
    except OSError:
        return ""


def told(size: float) -> str:
    """As in `1.2 GB`, `34 MB` or `5 kB`."""
    if size >= 1e9:
        return f"{size / 1e9:,.1f} GB"
    return f"{size / 1e6:.0f} MB" if size >= 1e6 else f"{size / 1e3:.0f} kB"
