"""A panel of Figure 5: how long it takes, on what, and in how much memory.

Its jobs are those that a launch with two workers plans. Each runs a few rounds and a test period
while another process runs the same, so that both cores are busy as in a launch, with replay buffers
as full as they are in the end; 3000 episodes and 11 test periods are extrapolated from that.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import Any, NamedTuple

import hac_suite
import tasks
from hac_suite.config import PrecisionName
from hac_suite.learning import mixed
from launch.folder.agents import Agent, Job
from launch.jobs.planning import Group, makespan, plan
from tests.bench.population import TASK, Training
from tests.bench.repeats import entry, rounded, summary
from tests.bench.team import Team, held_memory
from tests.bench.work import Work
from tests.bench.writing import Writing, Written, save_policies

WORKERS = 2
SEEDS = 10
PERIODS = 10
LAYERS = (0, 1, 2)
_ROUNDS = 2  # timed in each process
_HOW = (
    "extrapolated to 3000 episodes a seed and 11 test periods: start-up + 750 rounds + 11 tests of "
    "each job that a launch with 2 workers plans; rounds and tests timed with both cores busy, of "
    "young agents (their episodes are the longest) with replay buffers as after 3000 episodes"
)


class Sample(NamedTuple):
    """What one process measured of a job."""

    rounds: list[Work]
    test_seconds: float
    save_seconds: float
    gib: float
    rows: list[dict]  # of the test period


class Measured(NamedTuple):
    """A job of the panel as its processes measured it."""

    job: Job
    start_seconds: float
    samples: list[Sample]

    def estimates(self) -> list["Parts"]:
        """The job's seconds by part, once for each round that was timed."""
        test = 1 + PERIODS
        return [
            Parts(
                updates=_rounds() * work.update_seconds,
                physics=_rounds() * work.physics_seconds,
                bookkeeping=_rounds() * work.bookkeeping_seconds,
                acting=_rounds() * work.acting_seconds,
                testing=test * sample.test_seconds,
                writing=sample.save_seconds,
                starting=self.start_seconds,
            )
            for sample in self.samples
            for work in sample.rounds
        ]


class Parts(NamedTuple):
    """Seconds by what they are spent on. Testing includes its own physics and acting."""

    updates: float
    physics: float
    bookkeeping: float
    acting: float
    testing: float
    writing: float
    starting: float


class JobSample:
    """A worker that runs a little of a job."""

    def __init__(self, job: Job, precision: PrecisionName):
        config = dataclasses.replace(hac_suite.PRESETS["suite"], precision=precision)
        self._training = Training(job.agent.task, config, job.seeds, job.agent.subgoal_layers)

    def __call__(self, rounds: int) -> Sample:
        training = self._training
        training.fill_as_after(_episodes())
        works = [training.round() for _ in range(rounds)]
        seconds, result = training.test()
        saved = save_policies(result.policies)
        return Sample(works, seconds, saved, held_memory(), result.rows)


def panel(say: Callable[[str], None]) -> dict[str, Any]:
    """`panel_minutes` and the shares of every task, and the memory of pick-and-place."""
    measured = {task: _measured(task, "fp32", say) for task in tasks.ALL}
    say("panel: writing results, figures and the report")
    with Team(Writing, [(TASK,)]) as team:
        (written,) = team.work([m.samples[0].rows for m in measured[TASK]], 1 + PERIODS)[1]
    found = report(measured, written)
    if mixed.has_bf16():
        middle, interval = summary(minutes(_measured(TASK, "bf16", say), written))
        found["panel_minutes_bf16"] = {TASK: rounded(middle)}
        found["panel_minutes_bf16_ci"] = {TASK: [rounded(end) for end in interval]}
    return found


def _measured(task: str, precision: PrecisionName, say: Callable[[str], None]) -> list[Measured]:
    """The jobs of a task's panel."""
    groups = {Group(Agent(task, layers)): tuple(range(SEEDS)) for layers in LAYERS}
    found = []
    for job in plan(groups, WORKERS):
        say(f"panel: {job.agent}, {len(job.seeds)} seeds, {precision}")
        found.append(measure(job, precision))
    return found


def measure(job: Job, precision: PrecisionName, *, rounds: int = _ROUNDS) -> Measured:
    """Runs a little of the job in as many processes as there are workers."""
    with Team(JobSample, [(job, precision)] * WORKERS) as team:
        samples = team.work(rounds)[1]
        return Measured(job, team.start_seconds, samples)


def report(measured: Mapping[str, Sequence[Measured]], written: Written) -> dict[str, Any]:
    """The entries of the report."""
    middles, intervals, shares, rests = {}, {}, {}, {}
    for task, jobs in measured.items():
        middle, interval = summary(minutes(jobs, written))
        middles[task], intervals[task] = rounded(middle), [rounded(end) for end in interval]
        sums = [_sum(of_jobs, written.seconds) for of_jobs in _by_round(jobs)]
        shares[task] = {
            name: rounded(median(getattr(s, name) / sum(s) for s in sums)) for name in Parts._fields
        }
        rests[task] = [(s.bookkeeping + s.acting + s.testing) / sum(s) for s in sums]
    return {
        **entry("non_update_share", max(rests.values(), key=median)),
        "non_update_share_how": "bookkeeping, acting and testing, worst task; physics is apart",
        "panel_shares": shares,
        "panel_minutes": middles,
        "panel_minutes_ci": intervals,
        "panel_minutes_how": _HOW,
        **_memory(measured[TASK], written.gib),
    }


def minutes(jobs: Sequence[Measured], written: Written) -> list[float]:
    """How long the panel takes: one estimate of all jobs for each timed round."""
    ends = [makespan([sum(p) for p in of_jobs], WORKERS) for of_jobs in _by_round(jobs)]
    return [(seconds + written.seconds / WORKERS) / 60 for seconds in ends]


def _by_round(jobs: Sequence[Measured]) -> list[tuple["Parts", ...]]:
    return list(zip(*(job.estimates() for job in jobs), strict=True))


def _sum(jobs: Sequence[Parts], written: float) -> Parts:
    both = Parts(*(sum(column) for column in zip(*jobs, strict=True)))
    return both._replace(writing=both.writing + written)


def _memory(jobs: Sequence[Measured], parent: float) -> dict[str, Any]:
    """The most that a launch holds: its own, and that of the largest jobs that meet."""
    peaks = [max(sample.gib for sample in job.samples) for job in jobs]
    return {
        "peak_memory_gib": rounded(sum(sorted(peaks)[-WORKERS:]) + parent),
        "peak_memory_gib_how": f"{TASK}: launcher and the {WORKERS} largest jobs, at their end; "
        "what processes share counts once",
        "peak_memory_gib_parts": {
            "launcher": rounded(parent),
            **{m.job.name: rounded(peak) for m, peak in zip(jobs, peaks, strict=True)},
        },
    }


def _episodes() -> int:
    return PERIODS * hac_suite.PRESETS["suite"].episodes_per_period


def _rounds() -> int:
    return _episodes() // hac_suite.PRESETS["suite"].episodes_per_round
