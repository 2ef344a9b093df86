"""Restarts a job whose machine died from its own checkpoints."""

from collections.abc import Callable, Mapping

from analysis.program import CommandError
from launch.folder.agents import Job
from launch.jobs import checkpointing
from launch.jobs.recorder import Recorder
from launch.jobs.worker import Plan

_NONE_LEFT = "all of its seeds had failed before: {reasons}"


def again(
    job: Job, *, recorder: Recorder, plans: Mapping[str, Plan], say: Callable[[str], None]
) -> Job:
    """The job as it is to begin again; rows that only its checkpoints have are recorded first.

    Its seeds begin together, where the last one's checkpoint stands: each keeps the one before.

    Raises:
      CommandError: each of its seeds has failed by itself, or a checkpoint is of another run.
    """
    task, subgoal_layers = job.agent
    plan = plans[task]
    setup = checkpointing.Setup(job.agent, plan.horizons[subgoal_layers], plan.config)
    folder = recorder.folders[task]
    seeds = recorder.unfailed(job)
    if not seeds:
        reasons = {recorder.failures[job._replace(seeds=(seed,))] for seed in job.seeds}
        raise CommandError(_NONE_LEFT.format(reasons="; ".join(sorted(reasons))))
    job = job._replace(seeds=seeds)
    found, warnings = checkpointing.interrupted(
        folder, setup, job.seeds, plan.periods, other_versions=True
    )
    for warning in warnings:
        say(warning)
    recorder.add(job, [row for seed in sorted(found) for row in found[seed].rows])
    if len(found) < len(job.seeds):
        return job._replace(start=0)
    return job._replace(start=min(point.train_episodes for point in found.values()))
