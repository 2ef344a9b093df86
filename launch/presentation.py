"""What a launch leaves to look at once training is over: videos, the report, a summary."""

import json
from collections.abc import Iterable

from rich.console import Console
from rich.table import Table

from analysis.load import load
from analysis.report import write_report
from analysis.statistics import final_success
from launch import results, videos
from launch.command_line import Request
from launch.execution import StopSignal
from launch.run_folder import RunFolder


def present(
    folders: Iterable[RunFolder], request: Request, console: Console, stop: StopSignal
) -> None:
    """Renders the videos that are missing or older than their policies, and writes the reports."""
    for folder in folders:
        for layers in request.subgoal_layers:
            if request.video and stop.number is None:
                _video(folder, layers, console, stop)
        try:
            write_report(folder.path)
        except Exception as error:  # the runs themselves are whole
            console.print(f"warning: {folder.report} was not written: {error}")


def summarise(folder: RunFolder, console: Console) -> None:
    """Prints each agent's success at its last test period, and the path to open."""
    if not results.read(folder.results)[0]:
        return
    table = Table(box=None, pad_edge=False, header_style="bold", title_justify="left")
    for heading in ("agent", "seeds", "test period", "success", "95% interval"):
        table.add_column(heading, justify="left" if heading == "agent" else "right")
    for row in final_success(load(folder.path)).itertuples():
        name = f"{folder.task}, {row.subgoal_layers} subgoal layers"
        interval = f"{row.low:.0%} to {row.high:.0%}" if row.low == row.low else "-"
        table.add_row(name, str(row.n), str(row.period), f"{row.mean:.0%}", interval)
    console.print(table)
    for path in (folder.figure, folder.report, *sorted(folder.videos.glob("*.mp4"))):
        if path.exists():
            console.print(str(path), soft_wrap=True)


def _video(folder: RunFolder, layers: int, console: Console, stop: StopSignal) -> None:
    policy = _typical_policy(folder, layers)
    target = folder.video(layers)
    if policy is None or _is_newer(target, folder, layers):
        return
    console.print(f"rendering {target}", soft_wrap=True)
    try:
        for note in videos.render(folder.policies / policy, target, stop=stop):
            console.print(note, soft_wrap=True)
    except videos.RenderingError as error:
        console.print(f"warning: no video of {folder.task}, {layers} subgoal layers: {error}")


def _typical_policy(folder: RunFolder, layers: int) -> str | None:
    """Name of the agent's policy of median test success: neither its best nor its worst seed."""
    found = []
    for path in folder.policies.glob(f"{folder.task}_{layers}layers_seed*.json"):
        description = json.loads(path.read_text(encoding="utf-8"))
        found.append((description["success_rate"], description["seed"], path.stem))
    return sorted(found)[len(found) // 2][-1] if found else None


def _is_newer(target, folder: RunFolder, layers: int) -> bool:
    policies = folder.policies.glob(f"{folder.task}_{layers}layers_seed*.safetensors")
    newest = max(path.stat().st_mtime for path in policies)
    return target.exists() and target.stat().st_mtime > newest
