"""Work for worker processes that takes no time: stands in for training in the launcher's tests."""

import math
import os
import signal
import time
from pathlib import Path

import hac_suite
from analysis.reading.schema import LEVEL_FIELDS, level_column
from hac_suite import policy_files
from launch.folder.agents import Job
from launch.folder.layout import RunFolder
from launch.jobs.messages import Tested, Warned


def report_seeds(job: Job, send) -> None:
    send(job.seeds)


def fail_by_name(job: Job, send) -> None:
    """Ends as the job's task says."""
    print("a line that the worker printed", flush=True)
    send("started")
    if job.agent.task == "raises":
        raise RuntimeError("the reason\nand more of it")
    if job.agent.task == "segfaults":
        os.kill(os.getpid(), signal.SIGSEGV)
    if job.agent.task == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if job.agent.task == "exits":
        os._exit(3)
    if job.agent.task == "hangs":
        time.sleep(600)


def deaf_to_signals(job: Job, send) -> None:
    """Like a worker in a long test period."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    send("training")
    time.sleep(30)


def row(job: Job, seed: int, period: int) -> dict:
    """A row of results with all columns that training gives it."""
    levels = range(job.agent.subgoal_layers + 1)
    diagnostics = {
        level_column(level, field): math.nan for level in levels for field in LEVEL_FIELDS
    }
    return {
        "task": job.agent.task,
        "subgoal_layers": job.agent.subgoal_layers,
        "seed": seed,
        "period": period,
        "train_episodes": 4 * period,
        "train_steps": 40 * period,
        "test_episodes": 8,
        "success_rate": min(1.0, 0.25 * period),
        "mean_steps_to_goal": 30.0,
        "wall_seconds": 1.5,
        "core_seconds": 0.5,
        "diverged_episodes": 0,
        **diagnostics,
    }


def train(job: Job, send, *, plans) -> None:
    """Sends what training sends and leaves policies without weights; fails where it is told to.

    A file `fail` in --out holds the number of subgoal layers of the agent that is to fail; a file
    `kill` the period after whose rows the worker is killed.
    """
    plan = plans[job.agent.task]
    folder = RunFolder(plan.out, job.agent.task)
    fail, kill = Path(plan.out) / "fail", Path(plan.out) / "kill"
    for period in range(plan.periods + 1):
        if period == plan.periods:
            if fail.exists() and fail.read_text() == str(job.agent.subgoal_layers):
                raise RuntimeError("told to fail")
            for seed in job.seeds:
                _leave_policy(folder, job, seed, period)
        send(Tested(period, [row(job, seed, period) for seed in job.seeds]))
        if kill.exists() and kill.read_text() == str(period):
            os.kill(os.getpid(), signal.SIGKILL)
        send(hac_suite.Progress(4 * period, 0.25))


def train_for_ever(job: Job, send, *, plans) -> None:
    send(Tested(0, [row(job, seed, 0) for seed in job.seeds]))
    time.sleep(600)


def _leave_policy(folder: RunFolder, job: Job, seed: int, period: int) -> None:
    stem = folder.policy(job.agent.subgoal_layers, seed)
    description = {**job.agent._asdict(), "seed": seed, "period": period, "success_rate": 0.5}
    policy_files.write(stem, {}, description)


def save_when_told(job: Job, send) -> None:
    """Trains until SIGTERM, and then saves into the file that the job's task names."""

    def save(*_):
        time.sleep(1.0)
        Path(job.agent.task).write_text("all of it")
        os._exit(0)

    signal.signal(signal.SIGTERM, save)
    send("training")
    time.sleep(600)


def warn_when_told(job: Job, send) -> None:
    """Trains until SIGTERM; then says more than a pipe holds, and that it could not save."""

    def warn(*_):
        for _ in range(2000):
            send(hac_suite.Progress(4, 0.25))
            send(Warned("x" * 100))
        send(Warned("could not save"))
        os._exit(0)

    signal.signal(signal.SIGTERM, warn)
    send("training")
    time.sleep(600)


def kill_ray_process_at_start(job: Job, send) -> None:
    """Takes the Ray process that watches it with it: each time, or where it begins with 0."""
    send(job.start)
    time.sleep(0.5)
    if job.agent.task == "always" or not job.start:
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(600)


def save_for_ever(job: Job, send) -> None:
    """Is not done with saving within any grace."""
    signal.signal(signal.SIGTERM, lambda *_: time.sleep(600))
    send("training")
    time.sleep(600)
