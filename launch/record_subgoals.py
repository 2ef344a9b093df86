"""Records policies' subgoals and outcomes: `python launch/record_subgoals.py --task=TASK`."""

import itertools
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from absl import flags

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

    from launch.asking import start

    start.without_display()

import numpy as np

import tasks
from analysis import program
from analysis.program import CommandError
from analysis.reading import names
from analysis.reading.files import write_text
from launch.asking import lists
from launch.folder import policies
from launch.pictures.subgoal_log import Replayed
from launch.recording import tables
from launch.recording.anatomy import anatomy

EPISODES = 32  # of each policy

_HIGH = 2  # levels from here on propose subgoals to a level that proposes subgoals itself
# Observed quantities that a claim about the task's subgoals needs beside positions.
_CONDITIONS = {"pick_place": ("attached",)}
_HELP = """Replays test episodes of trained policies and records their subgoals for the analysis.

  python launch/record_subgoals.py --task=ur5_reacher --output=analysis/data/grid/ur5_reacher

writes subgoals.csv, the high-level subgoals of every policy, for `python -m analysis.claims`, and
anatomy.json, one whole episode of each agent, for `python -m analysis.anatomy`.

Flags:
{flags}

Exit status: 0 the files are written; 2 the command was wrong."""


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = _flags()
    return program.carry_out(program.Program(_HELP, values), argv, lambda _: _record(values))


def _record(values: flags.FlagValues) -> None:
    task = lists.task(lists.task_word(values))
    run = Path("runs", task)
    folder = run / names.POLICIES if values.policies is None else Path(values.policies)
    found = [policy for policy in policies.find(folder) if policy.task == task]
    if not found:
        raise CommandError(policies.lacking(folder, task))
    output = run if values.output is None else Path(values.output)
    for path in record(found, output, values.episodes):
        print(path)


def _flags() -> flags.FlagValues:
    values = flags.FlagValues()
    lists.define_task(values, "pick_place", lists.ANY_TASK)
    flags.DEFINE_string(
        "policies", None, "folder of the policies; default: runs/TASK/policies", values
    )
    flags.DEFINE_string("output", None, "folder for the files; default: runs/TASK", values)
    program.define_count(values, "episodes", EPISODES, "test episodes of each policy", least=1)
    return values


def record(found: Sequence[policies.Found], output: Path, episodes: int) -> list[Path]:
    """Replays all these policies of one task and writes both files into `output`.

    Raises:
      CommandError: a policy cannot be loaded or run.
    """
    replays = [tables.replayed(policy.path, episodes) for policy in found]
    output.mkdir(parents=True, exist_ok=True)
    table, episodes_file = output / names.SUBGOALS, output / names.ANATOMY
    tables.write(table, _head(found[0].task), itertools.chain.from_iterable(map(_rows, replays)))
    episode_of_each_agent = [_typical(replays, layers) for layers in _agents(found)]
    described = anatomy(episode_of_each_agent, found[0].task)
    write_text(episodes_file, json.dumps(described) + "\n")
    return [table, episodes_file]


def _agents(found: Sequence[policies.Found]) -> list[int]:
    return sorted({policy.subgoal_layers for policy in found})


def _head(task: str) -> list[str]:
    """The columns of subgoals.csv."""
    spec = tasks.spec(task)
    return [
        *("task", "subgoal_layers", "seed", "episode", "level", "step", "end_step", "outcome"),
        *tables.points(spec.subgoal_space.names, "subgoal", "start", "end"),
        *tables.points(spec.goal_space.names, "goal"),
        *_condition_columns(task),
    ]


def _rows(played: Replayed) -> Iterator[list[Any]]:
    """A row for each high-level subgoal, in the order of time."""
    metadata, layers = played.policy.metadata, played.policy.subgoal_layers
    conditions = list(_condition_columns(metadata["task"]).values())
    high = [subgoal for subgoal in played.subgoals if subgoal.level >= _HIGH]
    for s in sorted(high, key=lambda s: (s.episode, s.level, s.step)):
        places = [*s.subgoal, *s.start, *s.end, *played.goal[s.episode], *s.observation[conditions]]
        yield [
            metadata["task"], layers, metadata["seed"],
            s.episode, s.level, s.step, s.end_step, s.outcome,
            *tables.rounded(places),
        ]  # fmt: skip


def _condition_columns(task: str) -> dict[str, int]:
    """Columns of the observation that hold the task's `_CONDITIONS`, by name."""
    names = _CONDITIONS.get(task, ())
    parts = tasks.spec(task).observation
    ends = dict(zip(parts, np.cumsum([len(part) for part in parts.values()]), strict=True))
    return {name: int(ends[name]) - 1 for name in names}


def _typical(replays: Sequence[Replayed], layers: int) -> tuple[Replayed, int]:
    """An agent's replay and episode to show: as `policies.typical`, a success where there is one.

    Of its episodes, one that takes a median number of steps.
    """
    own = [played for played in replays if played.policy.subgoal_layers == layers]
    by_success = sorted(own, key=lambda played: played.stats.success.mean())
    median = by_success.pop(len(by_success) // 2)
    for played in (median, *reversed(by_success)):
        won = np.flatnonzero(played.stats.success)
        if len(won):
            order = won[np.argsort(played.stats.steps[won], kind="stable")]
            return played, int(order[len(order) // 2])
    return median, 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
