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
from analysis.reading import files, grid, names
from hac_suite import policy_files
from launch import record_subgoals
from launch.asking import lists
from launch.folder import manifest, policies, states
from launch.folder.layout import RunFolder
from launch.recording import joining

_HELP = """Publishes a finished run folder: copies it where the analysis and play.py find it.

  python launch/publish.py --task=pick_place

copies results.csv, figure.csv, figure.png and manifest.json to analysis/data/grid/TASK, replays the
policies to record their subgoals there, and copies the best seed's policy of each agent to
assets/policies. --add keeps the published results of other agents and seeds, so you can train an
experiment in pieces, on several machines. Each of the two folders is replaced in one rename: if the
program is killed, it holds either the old or the new results. If a run failed for good, the
manifest lists it, and n is smaller.

Flags:
{flags}

Exit status: 0 done; 2 the command was wrong, or the folder's runs are not finished."""


_RESULTS = (names.RESULTS, names.FIGURE_NUMBERS, names.FIGURE, names.MANIFEST)


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = _flags()
    return program.carry_out(program.Program(_HELP, values), argv, lambda _: _publish(values))


def _publish(values: flags.FlagValues) -> None:
    folder = RunFolder(Path(values.runs).absolute(), lists.task(values.task))
    for path in publish(folder, Path(values.data), Path(values.policies), add=values.add):
        print(os.path.relpath(path))


def _flags() -> flags.FlagValues:
    values = flags.FlagValues()
    flags.DEFINE_string("task", "pick_place", "which task", values)
    flags.DEFINE_string("runs", "runs", "folder that holds the task's run folder", values)
    define_places(values)
    flags.DEFINE_boolean(
        "add", False, "keep the published results of other agents and seeds", values
    )
    return values


def define_places(values: flags.FlagValues) -> None:
    """Defines the flags that say where published results and policies are."""
    flags.DEFINE_string("data", os.path.relpath(grid.FOLDER), "holds published results", values)
    flags.DEFINE_string(
        "policies", os.path.relpath(policies.PUBLISHED), "holds published policies", values
    )


def publish(folder: RunFolder, data: Path, chosen: Path, *, add: bool = False) -> list[Path]:
    """Publishes a run folder; returns what was written.

    Args:
      add: whether published agents and seeds stay that the folder does not have.

    Raises:
      CommandError: some of its runs are neither done nor failed, it is no run folder, or it is of
        another configuration than what it is to be added to.
    """
    state = states.read(folder.path)
    open_runs = [run for run in state.runs if run.state not in ("done", "failed")]
    if open_runs or not state.runs:
        raise CommandError(
            f"{folder.path}: {len(open_runs)} of its {len(state.runs)} runs are not finished; the "
            "command that began them resumes them"
        )
    found = policies.find(folder.policies)
    add = add and (data / folder.task / names.RESULTS).is_file()
    with files.swapping(data / folder.task) as output:
        if add:
            before = joining.Records(output)
            runs = joining.join_results(output, folder)
        else:
            for file in (folder.results, folder.manifest):
                files.put(file, output)
        described = manifest.read(output / names.MANIFEST)
        assert described is not None, "it has just been put there"
        manifest.write(output / names.MANIFEST, manifest.portable(described))
        write_figure(output)
        written = [output / name for name in _RESULTS]
        written += record_subgoals.record(found, output, record_subgoals.EPISODES)
        if add:
            before.join(runs)
    with files.swapping(chosen) as output:
        if add:
            found += [
                own
                for own in policies.find(output)
                if own.task == folder.task and (own.subgoal_layers, own.seed) not in runs
            ]
        best = _publish_policies(folder.task, found, output)
    return [data / folder.task / file.name for file in written] + [
        chosen / file.name for file in best
    ]


def _publish_policies(task: str, found: Sequence[policies.Found], chosen: Path) -> list[Path]:
    """Copies the best seed of each agent; those of earlier runs go."""
    agents = sorted({policy.subgoal_layers for policy in found})
    best = [policies.best([own for own in found if own.subgoal_layers == k]) for k in agents]
    stay = {policy.path for policy in best}
    for earlier in policies.find(chosen):
        if earlier.task == task and earlier.path not in stay:
            for file in policy_files.paths(earlier.path):
                file.unlink()
    written = []
    for policy in best:
        for file in policy_files.paths(policy.path):
            written.append(file if file.parent == chosen else files.put(file, chosen))
    return written


if __name__ == "__main__":
    sys.exit(main(sys.argv))
