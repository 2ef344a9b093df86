"""The state of every run of a run folder, from its files alone: done, running, failed."""

import math
import re
import statistics
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from analysis.program import CommandError
from launch.folder import lock, manifest, results
from launch.folder.agents import Agent, Job
from launch.folder.layout import RunFolder

STATES = ("done", "running", "waiting", "stopped", "failed")


class RunState(NamedTuple):
    """One agent and seed."""

    subgoal_layers: int
    seed: int
    state: str  # of STATES; waiting: not begun; stopped: begun, and nobody is at work on it
    period: int | None  # the last test period; None before the first
    success_rate: float | None  # in it
    seconds: float  # of training until it
    periods: int  # to be tested
    episode: int  # of its newest checkpoint, 0 for none


class FolderState(NamedTuple):
    """A run folder as its files have it."""

    task: str
    manifest: manifest.Manifest  # of the latest launch
    holder: dict[str, Any] | None  # pid and start of the launch that is at work, {} if unknown
    runs: list[RunState]
    failures: list[tuple[Job, str]]  # of the latest launch, and why; it may have come good since
    seconds_left: float | None  # None if nothing tells


def read(path: Path) -> FolderState:
    """Reads the state of the run folder at `path`; changes nothing in it.

    Raises:
      CommandError: it is no run folder, or one of its files is damaged.
    """
    folder = RunFolder(path.absolute().parent, path.absolute().name)
    recorded = _manifest(path, folder)
    holder = lock.holder(folder.path)
    rows: dict[tuple[int, int], list[results.Row]] = {}
    for row in results.read(folder.results)[0]:
        rows.setdefault((int(row["subgoal_layers"]), int(row["seed"])), []).append(row)
    asked, periods = _asked(recorded)
    failures = _failures(folder.task, recorded)
    failed = {(job.agent.subgoal_layers, seed) for job, _ in failures for seed in job.seeds}
    jobs = manifest.planned(recorded)
    at_work = _at_work(folder, jobs) if holder is not None else set()
    agents = {Agent(folder.task, layers) for layers, _ in asked | rows.keys()}
    ended = {agent.subgoal_layers: folder.ended(agent) for agent in agents}
    runs = []
    for run in sorted(asked | rows.keys()):
        own = sorted(rows.get(run, []), key=lambda row: int(row["period"]))
        episode = _checkpointed(folder, run)
        least = periods if run in asked and periods is not None else _period(own) or 0
        if run[1] in ended[run[0]] and ended[run[0]][run[1]].period >= least:
            state = "done"
        elif run in failed:
            state = "failed"
        elif run in at_work:
            state = "running"
        else:
            state = "stopped" if holder is None and (own or episode) else "waiting"
        success, seconds = _measured(folder.results, own)
        runs.append(RunState(*run, state, _period(own), success, seconds, least, episode))
    left = _seconds_left(runs, jobs, recorded.get("workers"))
    return FolderState(folder.task, recorded, holder, runs, failures, left)


def _manifest(path: Path, folder: RunFolder) -> manifest.Manifest:
    if not path.is_dir():
        raise CommandError(f"there is no folder {path}; give one such as runs/pick_place")
    recorded = manifest.read(folder.manifest)
    if recorded is None:
        below = sorted(file.parent.name for file in path.glob(f"*/{folder.manifest.name}"))
        raise CommandError(
            f"{path} is not a run folder: it has no {folder.manifest.name}"
            + (f"; it holds the run folders {', '.join(below)}" if below else "")
        )
    if recorded["task"] != folder.task:
        raise CommandError(
            f"{path} holds runs of {recorded['task']!r}; name a run folder after its task"
        )
    return recorded


def _asked(recorded: Mapping[str, Any]) -> tuple[set[tuple[int, int]], int | None]:
    """Runs (subgoal_layers, seed) and periods that the latest launch is for, where it says so."""
    try:
        asked = dict(recorded["asked"])
        runs = {(int(k), int(seed)) for k in asked["subgoal_layers"] for seed in asked["seeds"]}
        return runs, int(asked["periods"])
    except (
        KeyError,
        OverflowError,
        TypeError,
        ValueError,
    ):  # written by hand, or by an earlier version
        return set(), None


def _failures(task: str, recorded: Mapping[str, Any]) -> list[tuple[Job, str]]:
    try:
        return [
            (
                Job(Agent(task, int(failure["subgoal_layers"])), tuple(map(int, failure["seeds"]))),
                str(failure["reason"]),
            )
            for failure in recorded.get("failures") or []
            if failure["seeds"]
        ]
    except (KeyError, OverflowError, TypeError, ValueError):
        return []


def _at_work(folder: RunFolder, jobs: Iterable[Job]) -> set[tuple[int, int]]:
    """Runs of the jobs that have a log, as those have that are at work.

    Where seeds of a job have failed, its log is named after the first and the last of the others.
    """
    named = re.compile(rf"\.{re.escape(folder.task)}_(\d+)layers_seeds(\d+)-(\d+)\.log")
    found = [named.fullmatch(file.name) for file in folder.path.glob(".*.log")]
    logs = [[int(number) for number in match.groups()] for match in found if match]
    return {
        (job.agent.subgoal_layers, seed)
        for job in jobs
        for layers, *ends in logs
        if layers == job.agent.subgoal_layers and set(ends) <= set(job.seeds)
        for seed in job.seeds
    }


def _checkpointed(folder: RunFolder, run: tuple[int, int]) -> int:
    stems = [file.stem for file in folder.checkpoints_of(*run).glob("[0-9]*.json")]
    return max((int(stem) for stem in stems if stem.isdecimal()), default=0)


def _period(own: Sequence[results.Row]) -> int | None:
    return int(own[-1]["period"]) if own else None


def _measured(file: Path, own: Sequence[results.Row]) -> tuple[float | None, float]:
    """Success rate and wall seconds in a run's last row."""
    if not own:
        return None, 0.0
    try:
        return float(own[-1]["success_rate"]), float(own[-1]["wall_seconds"])
    except ValueError as error:
        raise CommandError(f"{file} is damaged: {error}") from error


def _seconds_left(runs: Sequence[RunState], jobs: Sequence[Job], workers: Any) -> float | None:
    """Until all that is neither done nor failed is, with that many workers; None: nothing tells.

    A job that has tested takes as long for each period to come as for those behind it; seeds that
    have not are reckoned by what a seed took elsewhere, in proportion to the number of levels.
    """
    tested = _together([run for run in runs if run.period and run.seconds > 0], jobs)
    per_level = [
        job[0].seconds / job[0].period / len(job) / (job[0].subgoal_layers + 1)
        for job in tested
        if job[0].period
    ]
    due = [run for run in runs if run.state in ("running", "waiting", "stopped")]
    if not due:
        return 0.0
    if not per_level:
        return None
    left = [
        job[0].seconds / job[0].period * (job[0].periods - job[0].period)
        for job in _together([run for run in due if run.period and run.seconds > 0], jobs)
        if job[0].period
    ]
    new = [
        (run.subgoal_layers + 1) * run.periods * statistics.median(per_level)
        for run in due
        if not (run.period and run.seconds > 0)
    ]
    together = workers if isinstance(workers, int) and workers > 0 else 1
    longest = max([*left, (sum(left) + sum(new)) / together])
    return longest if math.isfinite(longest) else None


def _together(runs: Iterable[RunState], jobs: Sequence[Job]) -> list[list[RunState]]:
    """The runs by the job that trains or trained them; alone those of which no job is known."""
    of_job: dict[Any, list[RunState]] = {}
    for run in runs:
        layers, seed = run.subgoal_layers, run.seed
        known = (j for j in jobs if j.agent.subgoal_layers == layers and seed in j.seeds)
        of_job.setdefault((next(known, (layers, seed)), run.period), []).append(run)
    return list(of_job.values())


def by_agent(state: FolderState) -> dict[Agent, list[RunState]]:
    """The runs of each agent."""
    agents: dict[Agent, list[RunState]] = {}
    for run in state.runs:
        agents.setdefault(Agent(state.task, run.subgoal_layers), []).append(run)
    return agents
