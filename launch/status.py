"""Shows the progress of an experiment: `python launch/status.py runs/pick_place`."""

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from absl import flags
from rich.table import Table

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from analysis import program
from launch.asking.console import Console
from launch.folder import states
from launch.folder.layout import RunFolder
from launch.folder.states import FolderState, RunState
from launch.jobs.progress import duration

_HELP = """Prints the progress of a run folder's experiment, whether it is running or was killed.

  python launch/status.py runs/pick_place

A run is done, running, waiting (not begun), stopped (begun, but no process works on it), or
failed.

Flags:
{flags}

Exit status: 0; 2 the folder is no run folder, or the command was wrong."""
_WIDTH = 120  # where the output is no terminal


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    status = program.Program(
        _HELP,
        flags.FlagValues(),
        words="one run folder, as in launch/status.py runs/pick_place",
        wrong=program.UNREADABLE,
    )
    return program.carry_out(status, argv, lambda words: _show(Path(words[0])))


def _show(path: Path) -> None:
    state = states.read(path)
    console = Console()
    if not console.is_terminal:
        console = Console(width=_WIDTH)
    show(path, state, console)


def show(path: Path, state: FolderState, console: Console) -> None:
    """Prints the state of the run folder at `path`."""
    console.say(f"{path}: {_headline(state)}")
    if state.runs:
        console.print(_table(state))
    for line in (*_failures(path, state), *_going_on(state)):
        console.say(line)


def _headline(state: FolderState) -> str:
    done = f"{_count(state.runs, 'done')} of {len(state.runs)} runs done"
    if state.holder is not None:
        who, since = state.holder.get("pid", "unknown"), state.holder.get("since", "unknown")
        return f"running (process {who}, since {since}), {done}{_left(state, '')}"
    if _count(state.runs, "waiting") or _count(state.runs, "stopped"):
        return f"interrupted, no process is running; {done}{_left(state, ' after it resumes')}"
    finished = state.manifest.get("finished")
    return f"ended{f' at {finished}' if finished else ''}, {done}"


def _left(state: FolderState, when: str) -> str:
    if state.seconds_left is None:
        return "; the time left is shown after the first test periods"
    return f"; about {duration(state.seconds_left)} left{when}"


def _count(runs: Sequence[RunState], state: str) -> int:
    return sum(run.state == state for run in runs)


def _table(state: FolderState) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in ("agent", "seeds", *states.STATES, "test period", "success", "checkpoint"):
        table.add_column(heading, justify="left" if heading == "agent" else "right", no_wrap=True)
    for agent, runs in states.by_agent(state).items():
        counts = [_count(runs, name) for name in states.STATES]
        cells = [str(count) if count else "-" for count in counts]
        table.add_row(str(agent), str(len(runs)), *cells, *_progress(runs))
    return table


def _progress(runs: Sequence[RunState]) -> tuple[str, str, str]:
    """The slowest seed's test period, mean success of those that tested, oldest checkpoint due."""
    tested = [run.success_rate for run in runs if run.success_rate is not None]
    periods = [run.period for run in runs if run.period is not None]
    reached = str(min(periods)) if len(periods) == len(runs) else "-"
    episodes = [run.episode for run in runs if run.episode and run.state != "done"]
    return (
        f"{reached}/{max(run.periods for run in runs)}",
        f"{sum(tested) / len(tested):.0%}" if tested else "-",
        f"episode {min(episodes)}" if episodes else "-",
    )


def _failures(path: Path, state: FolderState) -> list[str]:
    """Why what failed did, and where its worker's last words are."""
    folder = RunFolder(path.absolute().parent, state.task)
    failed = {(run.subgoal_layers, run.seed) for run in state.runs if run.state == "failed"}
    lines = []
    for job, reason in state.failures:
        own = {(job.agent.subgoal_layers, seed) for seed in job.seeds}
        if own & failed:  # else it has come good since
            named = ", ".join(map(str, job.seeds))
            file = path / folder.failure(job).relative_to(folder.path)
            lines.append(f"failed: {job.agent}, seeds {named}: {reason}\n  see {file}")
    return lines


def _going_on(state: FolderState) -> list[str]:
    due = [run for run in state.runs if run.state != "done"]
    command = state.manifest.get("command")
    if state.holder is not None or not due or not isinstance(command, list):
        return []
    return [f"to resume: {shlex.join(map(str, command))}"]


if __name__ == "__main__":
    sys.exit(main(sys.argv))
