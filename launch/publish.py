"""Publishes a finished run folder: `python launch/publish.py --task=pick_place`."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path

from absl import flags

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

    from launch.asking import start

    start.without_display()

from analysis import program
from analysis.figures.success import write_figure
from analysis.program import CommandError
from analysis.reading import files, grid
from hac_suite import policy_files
from launch import record_subgoals
from launch.asking import lists
from launch.folder import policies, states
from launch.folder.layout import RunFolder

_HELP = """Puts a finished run folder where the analysis and play.py look for published results.

  python launch/publish.py --task=pick_place

copies results.csv, figure.csv, figure.png and manifest.json to analysis/data/grid/TASK, replays the
policies to record their subgoals there, and copies the best seed's policy of each agent to
assets/policies. Each of the two folders is built beside and put in place in one rename: a kill
leaves it as it was. A run that has failed for good is shown by the manifest and by the smaller n.

Flags:
{flags}

Exit status: 0 done; 2 the command was wrong, or the folder's runs are not finished."""


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = _flags()
    return program.carry_out(program.Program(_HELP, values), argv, lambda _: _publish(values))


def _publish(values: flags.FlagValues) -> None:
    folder = RunFolder(Path(values.runs).absolute(), lists.task(values.task))
    for path in publish(folder, Path(values.data), Path(values.policies)):
        print(os.path.relpath(path))


def _flags() -> flags.FlagValues:
    values = flags.FlagValues()
    flags.DEFINE_string("task", "pick_place", "which task", values)
    flags.DEFINE_string("runs", "runs", "holds the task's run folder", values)
    flags.DEFINE_string("data", os.path.relpath(grid.FOLDER), "holds published results", values)
    flags.DEFINE_string(
        "policies", os.path.relpath(policies.PUBLISHED), "holds published policies", values
    )
    return values


def publish(folder: RunFolder, data: Path, chosen: Path) -> list[Path]:
    """Publishes a run folder; returns what was written.

    Raises:
      CommandError: some of its runs are neither done nor failed, or it is no run folder.
    """
    state = states.read(folder.path)
    open_runs = [run for run in state.runs if run.state not in ("done", "failed")]
    if open_runs or not state.runs:
        raise CommandError(
            f"{folder.path}: {len(open_runs)} of its {len(state.runs)} runs are not finished; "
            "the command that began them goes on with them"
        )
    found = policies.find(folder.policies)
    write_figure(folder.path)
    results = (folder.results, folder.figure_numbers, folder.figure, folder.manifest)
    with files.swapping(data / folder.task) as output:
        written = [files.put(file, output) for file in results]
        written += record_subgoals.record(found, output, record_subgoals.EPISODES)
    with files.swapping(chosen) as output:
        best = _publish_policies(folder.task, found, output)
    return [data / folder.task / file.name for file in written] + [
        chosen / file.name for file in best
    ]


def _publish_policies(task: str, found: Sequence[policies.Found], chosen: Path) -> list[Path]:
    """Copies the best seed of each agent; those of earlier runs go."""
    for earlier in policies.find(chosen):
        if earlier.task == task:
            for file in policy_files.paths(earlier.path):
                file.unlink()
    written = []
    for layers in sorted({policy.subgoal_layers for policy in found}):
        best = policies.best([policy for policy in found if policy.subgoal_layers == layers])
        written += [files.put(file, chosen) for file in policy_files.paths(best.path)]
    return written


if __name__ == "__main__":
    sys.exit(main(sys.argv))
