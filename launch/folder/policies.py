"""The policies of a run folder, and which of them to show."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import tasks
from analysis.program import CommandError
from analysis.reading import names, paper
from hac_suite import policy_files
from launch.folder import manifest

PUBLISHED = Path(__file__).resolve().parents[2] / "assets" / "policies"
"""The best seed of each task and agent of the published grid."""


class Found(NamedTuple):
    """A policy's file, and what it says of itself."""

    path: Path  # without suffix
    task: str
    subgoal_layers: int
    seed: int
    success_rate: float  # in the last test period
    period: int | None = None  # that it was tested in; None: an earlier version's does not say
    train_episodes: int = 0


def find(directory: Path) -> list[Found]:
    """All whole policies of a `policies` folder, by agent and seed.

    Raises:
      CommandError: a description is damaged; the message names it.
    """
    found = [
        read(file)
        for file in directory.glob("[!.]*.json")
        if file.with_suffix(".safetensors").is_file()
    ]
    return sorted(found, key=lambda policy: (policy.subgoal_layers, policy.seed, policy.path))


def read(file: Path) -> Found:
    """What a policy says of itself, whose description is the file.

    Raises:
      CommandError: the description is damaged; the message names it.
    """
    try:
        description = policy_files.describe(file)
    except ValueError as error:
        raise CommandError(str(error)) from error
    try:
        return Found(
            file.with_suffix(""),
            task=_task(description),
            subgoal_layers=_entry(description, "subgoal_layers", int),
            seed=_entry(description, "seed", int),
            success_rate=float(_entry(description, "success_rate", int | float)),
            period=_entry(description, "period", int) if "period" in description else None,
            train_episodes=_entry({"train_episodes": 0, **description}, "train_episodes", int),
        )
    except (OverflowError, ValueError) as error:
        raise CommandError(f"{file} does not describe a policy: {error}") from error


def _task(description: Any) -> str:
    """The task's name: finding a path or a module runs it, and what a policy says runs nothing."""
    task = _entry(description, "task", str)
    if ":" in task or task.endswith(".py"):
        raise ValueError(f"its task is {task!r}, which is not a name")
    return task


def _entry(description: Any, name: str, wanted: Any) -> Any:
    value = description.get(name) if isinstance(description, dict) else None
    if not isinstance(value, wanted) or (isinstance(value, float) and math.isnan(value)):
        raise ValueError(f"its {name} is {value!r}")
    return value


def typical(own: Sequence[Found]) -> list[Found]:
    """An agent's policies in the order to show them.

    First the one of median test success, neither the agent's best nor its worst seed; then those
    that ever succeeded, the best first, in case the first one never does.
    """
    ranked = sorted(own, key=lambda policy: policy.success_rate)
    median = ranked.pop(len(ranked) // 2)
    return [median, *(policy for policy in reversed(ranked) if policy.success_rate > 0)]


def best(own: Sequence[Found]) -> Found:
    """The policy of the highest test success; of the first of such seeds."""
    return max(own, key=lambda policy: (policy.success_rate, -policy.seed))


def published(task: str) -> list[Found]:
    """The published policies of a task, by agent."""
    return [policy for policy in find(PUBLISHED) if policy.task == task]


def of_task(task: str, run: Path | None, *, typed: bool) -> tuple[list[Found], Path]:
    """A task's policies and where they are: of a run folder, else the published ones.

    Args:
      run: the run folder; None: runs/TASK, and where that holds none the published policies.
      typed: whether the person named the task, and not the run folder alone.

    Raises:
      CommandError: the run folder holds policies of another task, or of one that was edited since.
    """
    where = Path("runs", task) if run is None else run
    found = find(where / names.POLICIES)
    if run is None and not found and (of_grid := published(task)):
        return of_grid, PUBLISHED
    if found and (run is None or typed) and found[0].task != task:
        raise CommandError(f"flag --task={task}: {where} holds policies of {found[0].task}")
    if found and found[0].task == task:
        manifest.check_same_task(where / names.MANIFEST, tasks.find(task))
    return found, where


def lacking(where: Path, task: str | None = None) -> str:
    """Why no policies were found there, or none of a task: "runs/pick_place does not exist"."""
    if not where.exists():
        return f"{where} does not exist"
    return f"{where} holds no policies{f' of {task}' if task else ''}"


def choose(
    found: Sequence[Found], where: Path, subgoal_layers: int, seed: int | None
) -> list[Found]:
    """An agent's policies among those found, in the order to show them; of one seed if given.

    Args:
      where: they were found, for messages.

    Raises:
      CommandError: there is none, the message says what is.
    """
    if not found:
        raise CommandError(f"{lacking(where)}; train some with `python launch/run.py --task=TASK`")
    own = [
        policy
        for policy in found
        if policy.subgoal_layers == subgoal_layers and seed in (None, policy.seed)
    ]
    if not own:
        wanted = paper.agent_name(subgoal_layers) + ("" if seed is None else f", seed {seed}")
        there = f"--subgoal_layers={max(policy.subgoal_layers for policy in found)}"
        hint = (
            "" if any(own.subgoal_layers == subgoal_layers for own in found) else f"; add {there}"
        )
        raise CommandError(f"{where} has no policy of {wanted}; it has {_listed(found)}{hint}")
    return typical(own)


def _listed(found: Sequence[Found]) -> str:
    agents = sorted({policy.subgoal_layers for policy in found})
    return "; ".join(
        f"{paper.agent_name(layers)}: seeds "
        + ", ".join(str(policy.seed) for policy in found if policy.subgoal_layers == layers)
        for layers in agents
    )
