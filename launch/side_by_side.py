"""Renders agents side by side: `python launch/side_by_side.py --task=ur5_reacher`."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from absl import flags

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

    from launch.asking import start

    start.without_display()

import numpy as np

import hac_suite
import tasks
from analysis import program
from analysis.program import CommandError
from analysis.reading import names, paper
from launch.asking import lists, looks
from launch.folder import manifest, policies
from launch.pictures import choosing, video

_SUFFIXES = (".webp", ".gif", ".mp4")
_SIZE = "960x420"
_HELP = """Renders a task's agents from the same start, side by side, in one animated picture.

  python launch/side_by_side.py --task=ur5_reacher --output=agents.webp
  python launch/run.py --task=ur5_reacher --seeds=1 --subgoal_layers=2 --keep_policies=0,1,3,10
  python launch/side_by_side.py --task=ur5_reacher --training --output=training.webp

The first command shows agents with 0, 1 and 2 subgoal layers. The last shows one agent at the test
periods whose policies were kept. All begin from the first test start from which the last of them
reaches the goal; --episode chooses another start. A .webp or .gif repeats endlessly.

Flags:
{flags}

Exit status: 0 the file is written; 1 rendering failed; 2 the command was wrong."""


class Column(NamedTuple):
    """A policy, and what it is called."""

    policy: policies.Found
    name: str


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = _flags()
    return program.carry_out(program.Program(_HELP, values), argv, lambda _: _film(values))


def _flags() -> flags.FlagValues:
    values = flags.FlagValues()
    lists.define_task(values, "ur5_reacher", lists.ANY_TASK)
    lists.define_run(values)
    flags.DEFINE_boolean("training", False, "show one agent at several stages of training", values)
    program.define_count(
        values,
        "subgoal_layers",
        2,
        "number of subgoal layers of the agent, with --training",
        least=0,
    )
    program.define_count(
        values, "seed", None, "seed of the agents; default: each agent's median seed", least=0
    )
    program.define_count(
        values,
        "episode",
        None,
        "seed of the test start; default: chosen as above",
        least=0,
        most=choosing.MOST_SEED,
    )
    flags.DEFINE_string("output", "side_by_side.webp", "a .webp, .gif or .mp4", values)
    flags.DEFINE_float(
        "megabytes",
        3.0,
        "largest size of a .webp or .gif, in megabytes",
        lower_bound=0.01,
        flag_values=values,
    )
    looks.define(values, _SIZE)
    return values


def _film(values: flags.FlagValues) -> int:
    task = lists.task(lists.task_word(values))
    output = Path(values.output)
    if output.suffix not in _SUFFIXES:
        raise CommandError(f"flag --output={output}: give a name that ends in .webp, .gif or .mp4")
    look = video.Look(values.speed, values.camera, looks.size(values.size))
    columns = _stages(values, task) if values.training else _agents(values, task)
    last = columns[-1].policy
    word = tasks.find(lists.task(last.task)).word
    try:
        with looks.telling() as tell:
            notes = video.render_side_by_side(
                [column.policy.path for column in columns],
                [column.name for column in columns],
                output,
                seed=_start_of(last) if values.episode is None else values.episode,
                said=paper.agent_name(last.subgoal_layers) if values.training else "",
                most_bytes=round(values.megabytes * 1e6),
                look=look,
                task=word,
                tell=tell,
            )
    except video.RenderingError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(*notes, output, sep="\n")
    return 0


def _agents(values: flags.FlagValues, task: str) -> list[Column]:
    """A column for each agent that there is."""
    found, where = _found(values, task)
    layers = sorted({policy.subgoal_layers for policy in found})
    chosen = [policies.choose(found, where, agent, values.seed)[0] for agent in layers]
    return [Column(policy, paper.agent_name(policy.subgoal_layers)) for policy in chosen]


def _found(values: flags.FlagValues, task: str) -> tuple[list[policies.Found], Path]:
    run = None if values.run is None else Path(values.run)
    found, where = policies.of_task(task, run, typed=bool(values["task"].present))
    if not found:
        raise CommandError(policies.lacking(where, task))
    return found, where


def _stages(values: flags.FlagValues, task: str) -> list[Column]:
    """A column for each test period of one seed whose policy was kept."""
    run = Path("runs", task) if values.run is None else Path(values.run)
    found = policies.find(run / names.STAGES)
    if not found:
        raise CommandError(
            f"{policies.lacking(run / names.STAGES)}; `python launch/run.py --keep_policies=0,1,3` "
            "keeps the policies of these test periods"
        )
    trained = found[0].task
    if trained != task and (values.run is None or values["task"].present):
        raise CommandError(f"flag --task={task}: {run} holds policies of {trained}")
    manifest.check_same_task(run / names.MANIFEST, tasks.find(lists.task(trained)))
    by_training = sorted(found, key=lambda policy: policy.train_episodes)
    last = {(policy.subgoal_layers, policy.seed): policy for policy in by_training}
    where = run / names.STAGES
    seed = policies.choose([*last.values()], where, values.subgoal_layers, values.seed)[0].seed
    own = [
        policy
        for policy in by_training
        if (policy.subgoal_layers, policy.seed) == (values.subgoal_layers, seed)
    ]
    return [Column(policy, _when(policy.train_episodes)) for policy in own]


def _when(train_episodes: int) -> str:
    return f"after {train_episodes} episodes" if train_episodes else "untrained"


def _start_of(found: policies.Found) -> int:
    """The first test start from which the policy reaches the goal; if there is none, the first.

    Raises:
      CommandError: it cannot be loaded or run.
    """
    try:
        policy = hac_suite.Policy.load(found.path)
        seeds = choosing.seeds_of_tests(policy)
        won = np.flatnonzero(choosing.succeeds(policy, seeds))
    except (KeyError, TypeError, ValueError) as error:
        what = f"lacks the entry {error}" if isinstance(error, KeyError) else str(error)
        raise CommandError(f"policy {found.path}: {what}") from error
    return int(seeds[won[0] if len(won) else 0])


if __name__ == "__main__":
    sys.exit(main(sys.argv))
