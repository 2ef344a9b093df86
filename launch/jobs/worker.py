"""A worker's job: train a population, save its policies, send its rows."""

import functools
import math
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import torch

import hac_suite
import tasks
from analysis.reading.files import replacing
from hac_suite import policy_files
from launch.asking import settings
from launch.folder import manifest
from launch.folder.agents import Job
from launch.folder.layout import RunFolder
from launch.jobs import checkpointing
from launch.jobs.messages import SeedFailed, Send, Tested, Warned

_SECONDS_BETWEEN_MESSAGES = 1.0


class Plan(NamedTuple):
    """What the jobs of one task have in common."""

    word: str  # that finds the task
    out: Path
    config: hac_suite.Config
    horizons: Mapping[int, tuple[int, ...]]  # by number of subgoal layers
    periods: int
    device: str = "cpu"  # or "cuda"
    keep_final: bool = True  # the state that each seed ends with, for more periods later
    kept: tuple[int, ...] = ()  # test periods whose policies stay


def train_job(job: Job, send: Send, *, plans: Mapping[str, Plan]) -> None:
    """Trains the job's seeds on from where they stand.

    Sends Progress, Tested, Warned and SeedFailed messages.

    The last period's policies are on the disk before its rows are sent: a seed with all its rows
    has its policy. SIGTERM ends it at the next round, with a checkpoint.
    """
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    task, subgoal_layers = job.agent
    plan = plans[task]
    saver = checkpointing.Saver(
        RunFolder(plan.out, task),
        checkpointing.Setup(job.agent, plan.horizons[subgoal_layers], plan.config),
        job.seeds,
        job.start,
        warn=lambda text: send(Warned(text)),
        keep_final=plan.keep_final,
    )
    signal.signal(signal.SIGTERM, saver.stop)

    results = hac_suite.train(
        tasks.find(plan.word).load_vector,
        plan.config,
        job.seeds,
        subgoal_layers=subgoal_layers,
        horizons=plan.horizons[subgoal_layers],
        periods=plan.periods,
        device=plan.device,
        start=saver.states(),
        callback=_Reporter(saver, send),
    )
    for result in results:
        rows = [{"task": task, **row} for row in result.rows]
        folder = RunFolder(plan.out, task)
        if result.period in plan.kept:
            folder.stages.mkdir(exist_ok=True)
            path = functools.partial(folder.stage, subgoal_layers, period=result.period)
            _save(job, result.policies, rows, plan, path)
        if result.period == plan.periods:
            path = functools.partial(folder.policy, subgoal_layers)
            _save(job, result.policies, rows, plan, path)
        send(Tested(result.period, rows))


class _Reporter(hac_suite.Callback):
    """Passes on what the training tells: to the saver, and to the launch."""

    def __init__(self, saver: checkpointing.Saver, send: Send) -> None:
        self._saver, self._send = saver, send
        self._sent = -math.inf

    def on_progress(self, progress: hac_suite.Progress) -> None:
        """One a second at most: on a cluster, hundreds of jobs send to one place."""
        if time.monotonic() - self._sent >= _SECONDS_BETWEEN_MESSAGES:
            self._sent = time.monotonic()
            self._send(progress)

    def on_boundary(self, boundary: hac_suite.Boundary) -> None:
        self._saver.at_boundary(boundary)

    def on_lost(self, lost: hac_suite.LostSeed) -> None:
        self._saver.leave_out(lost.seed)
        self._send(SeedFailed(lost.seed, str(lost)))


def _save(
    job: Job,
    policies: Sequence[hac_suite.Policy],
    rows: list[dict],
    plan: Plan,
    path: Callable[[int], Path],
) -> None:
    """Saves a policy for each row; `path` says where, by seed."""
    for policy, row in zip(policies, rows, strict=True):
        seed = int(row["seed"])
        metadata = {
            "task": job.agent.task,
            "subgoal_layers": job.agent.subgoal_layers,
            "seed": seed,
            "period": int(row["period"]),
            "train_episodes": int(row["train_episodes"]),
            "success_rate": float(row["success_rate"]),
            "config": manifest.without_folders(settings.as_json(plan.config)),
        }
        save_policy(policy, path(seed), metadata)


def save_policy(policy: hac_suite.Policy, path: Path, metadata: dict) -> None:
    """Saves a policy so that a kill leaves what was under `path`'s name, or all of the new one."""
    with replacing(*policy_files.paths(path)) as (temporary, _):
        policy.save(temporary.with_suffix(""), metadata)
