"""One self-contained page of what a run folder holds: curves, tables, diagnostics, videos.

Run as `python -m analysis.report runs/pick_place`.
"""

import json
import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from analysis.figures.diagnostics import draw_diagnostics
from analysis.figures.success import DOTS_PER_INCH, draw_success
from analysis.reading import names, paper
from analysis.reading.files import write_text
from analysis.reading.results import load
from analysis.report import page
from analysis.statistics.seeds import final_success, success_per_period

_TABLES = (names.FIGURE, names.FIGURE_NUMBERS, names.RESULTS, names.MANIFEST)


def write_report(run_dir: Path) -> Path:
    """Writes report.html into a run folder and returns its path.

    Figures are inside the page; videos, policies and tables are linked by relative paths, so the
    folder can be moved whole. What the folder lacks is said in its place.

    Raises:
      FileNotFoundError, ValueError: as `load`; also when the folder mixes tasks.
    """
    run_dir = Path(run_dir)
    results = load(run_dir)
    summary = success_per_period(results)
    figure = page.picture(draw_success(summary), "success rate per test period", DOTS_PER_INCH)
    task = results["task"].iloc[0]
    body = [
        f"<h1>{page.text(paper.title(task))}</h1>",
        '<p class="note">Hierarchical actor-critic: end goals achieved in tests, per number of '
        "subgoal layers. The seed is the unit of every mean and interval.</p>",
        figure,
        _files(run_dir, _TABLES),
        *_final_table(results, task),
        *_diagnostics(results),
        *_videos(run_dir),
        *_policies(run_dir),
        *_reproduction(run_dir, results),
    ]
    target = run_dir / names.REPORT
    document = page.page(f"{paper.title(task)} - hierarchical actor-critic", body)
    write_text(target, document)
    return target


def _files(run_dir: Path, wanted: Sequence[str]) -> str:
    present = [page.link(name) for name in wanted if (run_dir / name).is_file()]
    return f"<p>Files: {', '.join(present)}</p>"


def _final_table(results: pd.DataFrame, task: str) -> Iterator[str]:
    yield "<h2>Success at the last test period</h2>"
    header = (
        "agent",
        "mean success [95% interval]",
        "seeds",
        "test period (training episodes)",
        "training episodes to 80%",
        "steps to goal",
    )
    caption = (
        "Episodes to 80%: median over seeds, one that never got there counting as later than any "
        "other. Steps to goal: median over seeds of the mean over successful tests of that period."
    )
    if task in paper.STEPS_TO_GOAL:
        caption += f" The paper's efficient policy takes about {paper.STEPS_TO_GOAL[task]}."
    yield page.table(header, map(_final_row, final_success(results).itertuples()), caption)


def _final_row(agent: Any) -> tuple[str, ...]:
    return (
        paper.agent_name(agent.subgoal_layers),
        f"{agent.mean:.1%} {_interval(agent.low, agent.high)}",
        f"{agent.n}" if agent.n == agent.seeds else f"{agent.n} of {agent.seeds} got this far",
        f"{agent.period} ({agent.train_episodes})",
        f"{_number(agent.episodes_to_80)} ({agent.reached_80} of {agent.seeds} seeds)",
        _number(agent.median_steps),
    )


def _interval(low: float, high: float) -> str:
    return "(one seed, no interval)" if math.isnan(low) else f"[{low:.1%}, {high:.1%}]"


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.0f}"


def _diagnostics(results: pd.DataFrame) -> Iterator[str]:
    yield "<h2>What the levels do</h2>"
    yield page.picture(
        draw_diagnostics(results), "missed subgoals and Q values per level", DOTS_PER_INCH
    )
    yield (
        '<p class="note">Level 0 acts; each level above proposes subgoals to the one below. Means '
        "over the n seeds that have the quantity, per test period.</p>"
    )


def _videos(run_dir: Path) -> Iterator[str]:
    yield "<h2>Videos</h2>"
    found = sorted((run_dir / names.VIDEOS).glob("*.mp4"))
    if found:
        yield (
            '<p class="note">Yellow: end goal. Purple: subgoals of the lowest level. Green: '
            "subgoals of the level above.</p>"
        )
        players = [page.video(f"{names.VIDEOS}/{path.name}") for path in found]
        yield f'<div class="videos">{"".join(players)}</div>'
    else:
        yield "<p>This run folder holds no videos.</p>"
    replays = sorted((run_dir / names.REPLAYS).glob("*.html"))
    if replays:
        links = [page.link(f"{names.REPLAYS}/{path.name}") for path in replays]
        yield f"<p>An episode in 3-D, to turn and to scrub: {', '.join(links)}</p>"


def _policies(run_dir: Path) -> Iterator[str]:
    found = sorted((run_dir / names.POLICIES).glob("*.safetensors"))
    if found:
        links = [page.link(f"{names.POLICIES}/{path.name}") for path in found]
        items = "".join(f"<li>{link}</li>" for link in links)
        yield f"<details><summary>{len(found)} policies</summary><ul>{items}</ul></details>"


def _reproduction(run_dir: Path, results: pd.DataFrame) -> Iterator[str]:
    yield "<h2>How to reproduce</h2>"
    manifest, problem = _read_manifest(run_dir / names.MANIFEST)
    commands = _recorded_commands(manifest) or [_command_for(results)]
    yield f"<pre>{page.text(chr(10).join(commands))}</pre>"
    if problem:
        yield f'<p class="note">{page.text(problem)}</p>'
    else:
        yield "<details><summary>Configuration, versions, machine (manifest.json)</summary>"
        yield page.table(("entry", "value"), _leaves(manifest))
        yield "</details>"


def _read_manifest(path: Path) -> tuple[dict[str, Any], str]:
    """The manifest, or {} and what is wrong: a report is worth having without one."""
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return (
            {},
            "No manifest.json here: the command is what the results ask for.",
        )
    except (OSError, ValueError) as error:
        return {}, f"manifest.json cannot be read: {error}"
    if not isinstance(manifest, dict):
        return {}, "manifest.json is not a run folder's manifest."
    return manifest, ""


def _recorded_commands(manifest: Mapping[str, Any]) -> list[str]:
    """Command lines of the launches that made the folder, each once, oldest first.

    A launch's `command` is a list of words; the latest launch is at the manifest's top level.
    """
    earlier = manifest.get("earlier_launches")
    launches = [*(earlier if isinstance(earlier, list) else []), manifest]
    recorded = [
        shlex.join(map(str, launch["command"]))
        for launch in launches
        if isinstance(launch, dict) and isinstance(launch.get("command"), list)
    ]
    return list(dict.fromkeys(recorded))


def _command_for(results: pd.DataFrame) -> str:
    """A command line that makes results of the same task, agents, seeds and periods."""
    layers = ",".join(str(k) for k in sorted(results["subgoal_layers"].unique()))
    return (
        f"python launch/run.py --task={shlex.quote(results['task'].iloc[0])}"
        f" --seeds={results['seed'].nunique()} --subgoal_layers={layers}"
        f" --periods={max(results['period'].max(), 1)}"
    )


def _leaves(tree: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Leaves of nested dictionaries and lists of them, each under its dotted path."""
    if isinstance(tree, dict):
        items = list(tree.items())
    elif isinstance(tree, list) and any(isinstance(item, dict) for item in tree):
        items = list(enumerate(tree))
    else:
        yield path, tree if isinstance(tree, str) else json.dumps(tree)
        return
    for key, value in items:
        yield from _leaves(value, f"{path}.{key}" if path else f"{key}")
