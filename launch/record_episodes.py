"""Records episodes that explain policies: `python launch/record_episodes.py --task=TASK`."""

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
from launch.recording import tables, values
from launch.recording.anatomy import anatomy

_EPISODES = 32  # of each policy
_GALLERY = 4  # failures of each agent that are kept whole
_HELP = """Replays test episodes of a run's policies and records data for explaining pictures.

  python launch/record_episodes.py --task=ur5_reacher
  python -m analysis.explain runs/ur5_reacher

writes into the run folder: starts.csv, the start, goal and outcome of every episode; failures.json,
whole episodes that failed; maps.csv, every subgoal, also of policies that --keep_policies kept; and
values.json, Q over the goals of each level. Without a run folder, give --output: the published
policies are then replayed.

Flags:
{flags}

Exit status: 0 the files are written; 2 the command was wrong."""


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = _flags()
    return program.carry_out(program.Program(_HELP, values), argv, lambda _: _record(values))


def _flags() -> flags.FlagValues:
    values = flags.FlagValues()
    lists.define_task(values, "pick_place", lists.ANY_TASK)
    lists.define_run(values)
    flags.DEFINE_string("output", None, "folder for the files; default: the run folder", values)
    program.define_count(values, "episodes", _EPISODES, "test episodes of each policy", least=1)
    return values


def _record(values: flags.FlagValues) -> None:
    task = lists.task(lists.task_word(values))
    run = None if values.run is None else Path(values.run)
    found, where = policies.of_task(task, run, typed=bool(values["task"].present))
    if not found:
        raise CommandError(policies.lacking(where, task))
    stages = policies.find(where / names.STAGES)
    if where == policies.PUBLISHED and not values.output:
        # In runs/TASK they would be taken for records of what is trained there later.
        raise CommandError(
            f"{policies.lacking(Path('runs', task))}; give the run folder as --run, or a folder "
            "as --output for records of the published policies"
        )
    output = Path(values.output) if values.output else where
    for path in record(found, stages, output, values.episodes):
        print(path)


def record(
    found: Sequence[policies.Found],
    stages: Sequence[policies.Found],
    output: Path,
    episodes: int,
) -> list[Path]:
    """Replays policies of one task and writes the files into `output`; returns their paths.

    Args:
      stages: policies of the same agents in the course of training.

    Raises:
      CommandError: a policy cannot be loaded or run.
    """
    replays = [(policy, tables.replayed(policy.path, episodes)) for policy in found]
    earlier = [(policy, tables.replayed(policy.path, episodes)) for policy in stages]
    paths = [
        output / name for name in (names.STARTS, names.MAPS, names.FAILED_EPISODES, names.VALUES)
    ]
    output.mkdir(parents=True, exist_ok=True)
    spec = tasks.spec(found[0].task)
    goals, subgoals = spec.goal_space.names, spec.subgoal_space.names
    head = ["task", "subgoal_layers", "seed", "train_episodes", "episode"]
    of_goal = tables.points(goals, "goal")
    starts = [*head, "success", "steps", *tables.points(subgoals, "start"), *of_goal]
    tables.write(paths[0], starts, itertools.chain.from_iterable(map(_starts, replays)))
    maps = [*head, "level", "step", "outcome", *tables.points(subgoals, "subgoal"), *of_goal]
    kept = [_key(policy) for policy in stages]
    mapped = [*earlier, *(played for played in replays if _key(played[0]) not in kept)]
    tables.write(paths[1], maps, itertools.chain.from_iterable(map(_maps, mapped)))
    failed = list(_failures([played for _, played in replays]))
    write_text(paths[2], json.dumps(anatomy(failed, found[0].task)) + "\n")
    write_text(paths[3], json.dumps(values.of_agents(found)) + "\n")
    return paths


def _starts(replayed: tuple[policies.Found, Replayed]) -> Iterator[list[Any]]:
    """A row for each episode."""
    policy, played = replayed
    for episode, (success, steps) in enumerate(
        zip(played.stats.success, played.stats.steps, strict=True)
    ):
        points = [*played.path[0, episode], *played.goal[episode]]
        yield [*_key(policy), episode, int(success), int(steps), *tables.rounded(points)]


def _maps(replayed: tuple[policies.Found, Replayed]) -> Iterator[list[Any]]:
    """A row for each subgoal of every level."""
    policy, played = replayed
    for s in sorted(played.subgoals, key=lambda s: (s.episode, s.level, s.step)):
        points = [*s.subgoal, *played.goal[s.episode]]
        yield [*_key(policy), s.episode, s.level, s.step, s.outcome, *tables.rounded(points)]


def _key(policy: policies.Found) -> list[Any]:
    return [policy.task, policy.subgoal_layers, policy.seed, policy.train_episodes]


def _failures(replays: Sequence[Replayed]) -> Iterator[tuple[Replayed, int]]:
    """Some failures of each agent: the first of each seed, then the second of each, ..."""
    for layers in sorted({played.policy.subgoal_layers for played in replays}):
        own = [played for played in replays if played.policy.subgoal_layers == layers]
        lost = [[(played, int(i)) for i in np.flatnonzero(~played.stats.success)] for played in own]
        by_turns = itertools.chain.from_iterable(itertools.zip_longest(*lost))
        yield from itertools.islice(filter(None, by_turns), _GALLERY)


if __name__ == "__main__":
    sys.exit(main(sys.argv))
