"""Pictures after training: videos, replays, the report."""

import contextlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

import tasks
from analysis.program import CommandError
from analysis.reading.results import load
from analysis.report.index import write_index
from analysis.report.run_report import write_report
from analysis.statistics.seeds import FEW_SEEDS, final_success
from hac_suite import policy_files
from launch.asking import looks
from launch.asking.console import Console
from launch.asking.request import Request
from launch.folder import policies, results
from launch.folder.agents import Agent
from launch.folder.layout import RunFolder
from launch.jobs.local import StopSignal
from launch.pictures import replay, scene, video


def present(
    folders: Iterable[RunFolder], request: Request, console: Console, stop: StopSignal
) -> None:
    """Makes videos and replays that are missing or older than their policies, and the reports."""
    if request.video:
        try:
            scene.load()
        except scene.ViewerMissing as error:
            console.say(f"note: no 3-D replays: {error}")
    folders = list(folders)
    for folder in folders:
        for layers in request.subgoal_layers:
            if request.video and stop.number is None:
                _video(folder, layers, console, stop)
            if request.video and stop.number is None:
                _replay(folder, layers, console)
        try:
            write_report(folder.path)
        except Exception as error:  # the runs themselves are whole
            console.say(f"warning: {folder.report} was not written: {error}")
    for runs in {folder.path.parent for folder in folders}:
        with contextlib.suppress(ValueError, OSError):  # a page of links; the reports are there
            write_index(runs)


def summarise(folder: RunFolder, console: Console) -> None:
    """Prints each agent's success at its last test period, and the path to open."""
    if not results.read(folder.results)[0]:
        return
    try:
        final = final_success(load(folder.path))
        console.print(_final_table(folder, final))
        if final["n"].max() < FEW_SEEDS:
            console.say(
                f"note: with fewer than {FEW_SEEDS} seeds the interval is little more than their "
                "range"
            )
    except ValueError as error:  # such as a success rate that somebody edited
        console.say(f"warning: {error}")
    shown = (*sorted(folder.videos.glob("*.mp4")), *sorted(folder.replays.glob("*.html")))
    for path in (folder.figure, folder.report, *shown):
        if path.exists():
            console.say(str(path))


def _final_table(folder: RunFolder, final: Any) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold", title_justify="left")
    for heading in ("agent", "seeds", "test period", "success", "95% interval"):
        table.add_column(heading, justify="left" if heading == "agent" else "right")
    for row in final.itertuples():
        interval = f"{row.low:.0%} to {row.high:.0%}" if row.low == row.low else "-"
        agent = str(Agent(folder.task, row.subgoal_layers))
        table.add_row(agent, str(row.n), str(row.period), f"{row.mean:.0%}", interval)
    return table


def _video(folder: RunFolder, layers: int, console: Console, stop: StopSignal) -> None:
    """Renders the agent's video unless it is current; what prevents it is said, not raised."""
    target = folder.video(layers)
    try:
        own = _policies(folder, layers)
        if not own or _is_current(target, own):
            return
        console.say(f"rendering {target}")
        shown = [policy.path for policy in policies.typical(own)]
        word = tasks.find(folder.task).word
        with looks.telling() as tell:
            notes = video.render(shown, target, stop=stop, task=word, tell=tell)
        for note in notes:
            console.say(note)
    except (CommandError, video.RenderingError) as error:
        agent = Agent(folder.task, layers)
        console.say(f"warning: no video of {agent}: {error}")


def _replay(folder: RunFolder, layers: int, console: Console) -> None:
    """Makes the agent's replay unless it is current; what prevents it is said, not raised."""
    target = folder.replay(layers)
    try:
        scene.load()
        own = _policies(folder, layers)
        if own and not _is_current(target, own):
            replay.render([policy.path for policy in policies.typical(own)], target)
    except scene.ViewerMissing:
        return  # it is said once
    except Exception as error:  # the runs themselves are whole
        agent = Agent(folder.task, layers)
        console.say(f"warning: no replay of {agent}: {error}")


def _policies(folder: RunFolder, layers: int) -> list[policies.Found]:
    """Those of one agent."""
    found = policies.find(folder.policies)
    return [policy for policy in found if policy.subgoal_layers == layers]


def _is_current(picture: Path, own: Sequence[policies.Found]) -> bool:
    """Whether the agent's video or replay is there, and none of its policies is newer."""
    if not picture.exists():
        return False
    files = [file for policy in own for file in policy_files.paths(policy.path)]
    return picture.stat().st_mtime > max(file.stat().st_mtime for file in files)
