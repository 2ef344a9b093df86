"""The report of one run folder: results, whether hierarchy helped, and how to reproduce them.

Run as `python -m analysis.report runs/pick_place`.
"""

import itertools
import json
import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from analysis.figures.anatomy import draw_anatomy
from analysis.figures.costs import draw_costs
from analysis.figures.diagnostics import draw_diagnostics
from analysis.figures.success import DOTS_PER_INCH, draw_seeds, draw_success
from analysis.reading import names, paper
from analysis.reading.episodes import Episode, load_episodes
from analysis.reading.files import write_text
from analysis.reading.results import load, read_manifest, with_updates
from analysis.report.explanations import explanations, recording_command
from analysis.report.page import Picture, render
from analysis.statistics.seeds import FEW_SEEDS, final_success, success_per_period, with_cost
from analysis.verdicts import hierarchy

_MANY_PANELS = 120  # dots per inch of pictures that have so many that the page would get large
_FILES = (names.FIGURE, names.FIGURE_NUMBERS, names.RESULTS, names.MANIFEST, names.SUBGOALS)
_HEADINGS = {
    "learning": "How it learns",
    "success": "Success at the last test period",
    "verdict": "Does hierarchy help here?",
    "watch": "Watch it",
    "levels": "What the levels do in training",
    "why": "What was learnt",
    "reproduce": "How to reproduce",
}
_FAILURES = ", and which tests fail"  # added to a heading
_QUANTITIES = (
    (
        "subgoals missed",
        "The share of the subgoals proposed in training that the level below did not achieve. It "
        "should fall, as a level learns to propose reachable subgoals. Random and noisy subgoals "
        "of exploration count too, so it does not reach 0.",
    ),
    (
        "mean Q value",
        "What a level's critic expects of its own actor on replayed states: about minus the "
        "attempts still needed. It rises towards 0 as the level gets faster. A line at its floor "
        "for many periods means that the critic can no longer tell actions apart.",
    ),
    (
        "level 0, level 1, ...",
        "Level 0 acts in the environment. Each higher level proposes subgoals to the one below, "
        "and the top level pursues the end goal. Means over the n seeds that have the quantity.",
    ),
)


def write_report(run_dir: Path) -> Path:
    """Writes report.html into a run folder and returns its path.

    Figures are inside the page; videos, replays, policies and tables are linked by relative paths,
    so the folder can be moved whole. Missing parts are named in the report.

    Raises:
      FileNotFoundError, ValueError: as `load`; also when the folder mixes tasks.
    """
    run_dir = Path(run_dir)
    results = with_updates(load(run_dir), run_dir)
    manifest, problem = read_manifest(run_dir)
    task = results["task"].iloc[0]
    name = paper.title(task)
    verdict = _verdict(results)
    explained = list(explanations(run_dir, task))
    headings = dict(_HEADINGS)
    if any(shown.of_failures for shown in explained):
        headings["why"] += _FAILURES
    document = render(
        "run.html",
        title=f"{name} - hierarchical actor-critic",
        name=name,
        about=paper.ABOUT.get(task, ""),
        headline=_headline(results, verdict),
        headings=headings,
        contents=headings.items(),
        **_pictures(results),
        final=_final(results, task),
        verdict=verdict,
        replays=_below(run_dir, names.REPLAYS, "*.html"),
        videos=_below(run_dir, names.VIDEOS, "*.mp4"),
        anatomies=_anatomies(run_dir, task),
        quantities=_QUANTITIES,
        explanations=[
            Picture.of(shown.figure, shown.description, shown.caption, _MANY_PANELS)
            for shown in explained
        ],
        recording=recording_command(task, run_dir),
        commands=_recorded_commands(manifest) or [_command_for(results)],
        problem=problem,
        files=[file for file in _FILES if (run_dir / file).is_file()],
        policies=_below(run_dir, names.POLICIES, "*.safetensors"),
        manifest=list(_leaves(manifest)) if manifest else [],
    )
    write_text(run_dir / names.REPORT, document)
    return run_dir / names.REPORT


def _headline(results: pd.DataFrame, verdict: Mapping[str, Any]) -> str:
    """The best agent's success, and what the verdict says, in a sentence or two."""
    final = final_success(results)
    best = final.loc[final["mean"].idxmax()]
    seeds = f"{best['n']:.0f} seed{'' if best['n'] == 1 else 's'}"
    interval = "" if math.isnan(best["low"]) else f" {_interval(best['low'], best['high'])}"
    said = (
        f"After {best['train_episodes']:.0f} training episodes, the agent with "
        f"{paper.agent_name(int(best['subgoal_layers']))} achieves {best['mean']:.1%} of its end "
        f"goals in tests{interval} (mean over {seeds})."
    )
    short = [f"with {agent} {says}" for agent, says in verdict["short"]]
    return f"{said} Hierarchy against the flat agent: {'; '.join(short)}." if short else said


def _pictures(results: pd.DataFrame) -> dict[str, Picture]:
    summary = success_per_period(results)
    few = results.groupby("subgoal_layers")["seed"].nunique().max() < FEW_SEEDS
    bands = "bands: 95% bootstrap interval over seeds" + (
        f" (fewer than {FEW_SEEDS} seeds: little more than their range)" if few else ""
    )
    return {
        "curves": Picture.of(
            draw_success(summary),
            "success rate per test period, a curve for each number of subgoal layers",
            f"Share of end goals achieved in noise-free tests. Lines: mean over seeds; {bands}.",
            DOTS_PER_INCH,
        ),
        "seeds": Picture.of(
            draw_seeds(results),
            "success rate per test period, a thin line for each seed and a thick one for the mean",
            "The same, seed by seed: a mean can hide a seed that never learns or that forgets.",
            DOTS_PER_INCH,
        ),
        "costs": Picture.of(
            draw_costs(with_cost(summary, results)),
            "success rate against environment steps, and against core-minutes",
            "The same against the cost per seed: environment steps, and core-minutes.",
            DOTS_PER_INCH,
        ),
        "diagnostics": Picture.of(
            draw_diagnostics(results),
            "missed subgoals and Q values per level and test period",
            "In training, before each test period: a column for each agent, a line for each level.",
            DOTS_PER_INCH,
        ),
    }


def _final(results: pd.DataFrame, task: str) -> dict[str, Any]:
    caption = (
        "Episodes to 80%: median over seeds; a seed that never gets there counts as the latest. "
        "Steps to goal: median over seeds of the mean over successful tests of that period."
    )
    if task in paper.STEPS_TO_GOAL:
        caption += f" The paper's efficient policy takes about {paper.STEPS_TO_GOAL[task]}."
    return {
        "heading": (
            "agent",
            "mean success [95% interval]",
            "seeds",
            "test period (training episodes)",
            "training episodes to 80%",
            "steps to goal",
        ),
        "rows": [_final_row(agent) for agent in final_success(results).itertuples()],
        "caption": caption,
    }


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


def _verdict(results: pd.DataFrame) -> dict[str, Any]:
    try:
        verdicts = hierarchy.judge(results, {})
    except ValueError as error:
        return {"sentences": [], "lacking": str(error), "short": []}
    return {
        "sentences": [verdict.sentence for verdict in verdicts],
        "short": [(paper.agent_name(one.subgoal_layers), one.short) for one in verdicts],
        "heading": hierarchy.HEADINGS,
        "rows": hierarchy.rows(verdicts),
    }


def _below(run_dir: Path, folder: str, pattern: str) -> list[str]:
    """Files of a folder of the run folder, as relative paths."""
    return sorted(f"{folder}/{path.name}" for path in (run_dir / folder).glob(pattern))


def _anatomies(run_dir: Path, task: str) -> list[Picture]:
    """Recorded episodes drawn; none where none are recorded, or the recording is damaged."""
    try:
        episodes = load_episodes(run_dir, task)
        return [
            _anatomy(episode)
            for episode in sorted(episodes, key=lambda episode: episode.subgoal_layers)
        ]
    except (OSError, LookupError, TypeError, ValueError):
        return []  # the results can still be seen


def _anatomy(episode: Episode) -> Picture:
    agent = paper.agent_name(episode.subgoal_layers)
    return Picture.of(
        draw_anatomy(episode),
        f"one test episode of the agent with {agent}",
        f"One test episode of the agent with {agent}: its path, the subgoals of its levels over "
        "time, and their outcomes.",
        _MANY_PANELS,
    )


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
        f" --seeds={_seeds(sorted(results['seed'].unique()))} --subgoal_layers={layers}"
        f" --periods={max(results['period'].max(), 1)}"
    )


def _seeds(seeds: Sequence[int]) -> str:
    """As --seeds takes them: a count means those from 0 on, and a single other one is a range."""
    if seeds == list(range(len(seeds))):
        return str(len(seeds))
    # In an unbroken range, seeds and their places differ by the same number.
    found = itertools.groupby(enumerate(seeds), lambda numbered: numbered[1] - numbered[0])
    ranges = [[seed for _, seed in own] for _, own in found]
    alone = len(seeds) == 1
    return ",".join(
        f"{own[0]}-{own[-1]}" if alone or len(own) > 1 else f"{own[0]}" for own in ranges
    )


def _leaves(tree: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Leaves of nested dictionaries and lists of them, each under its dotted path."""
    items: Sequence[tuple[Any, Any]]
    if isinstance(tree, dict):
        items = list(tree.items())
    elif isinstance(tree, list) and any(isinstance(item, dict) for item in tree):
        items = list(enumerate(tree))
    else:
        yield path, tree if isinstance(tree, str) else json.dumps(tree)
        return
    for key, value in items:
        yield from _leaves(value, f"{path}.{key}" if path else f"{key}")
