"""Estimates spaces for a task: `python launch/fit.py --task=gym:PointMaze_UMaze-v3`."""

import math
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from absl import flags
from rich.table import Table

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

    from launch.asking import start

    start.for_training()

import numpy as np

import hac_suite
import tasks
from analysis import program
from analysis.program import CommandError
from analysis.reading.files import write_text
from hac_suite.types import level_specs
from launch.asking import doubts, lists
from launch.asking.console import Console
from tasks.worlds import cautions, estimates
from tasks.worlds.copies import EnvFailed
from tasks.worlds.estimates import Played
from tasks.worlds.settings import Settings, as_toml

_HELP = """Estimates scales, bounds, thresholds and T for a task, and writes them to a file.

  python launch/fit.py --task=gym:gymnasium_robotics:PointMaze_UMaze-v3
  python launch/run.py --task=PointMaze_UMaze-v3_fit.toml

It plays random episodes, trains a flat agent for a short time, and estimates the numbers from the
states that both reach. The file is short and has comments: edit what you know better. Warnings say
which settings will not learn, and why.

Flags:
{flags}

Exit status: 0 the file is written; 2 the command was wrong."""
_LEARNT = 16  # episodes that the flat agent plays to be looked at
_MOST_STEPS = 60_000  # of its training: where episodes are long, they are fewer
_SHOWN = 12  # numbers of an observation that the table has lines for


class Fit(NamedTuple):
    """What `fit` estimates for a task."""

    settings: Settings
    random: Played
    learnt: Played | None  # episodes of a flat agent, trained a little
    warnings: list[str]


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = _flags()
    return program.carry_out(program.Program(_HELP, values), argv, lambda _: _fit(values))


def _flags() -> flags.FlagValues:
    values = flags.FlagValues()
    lists.define_task(values, None, lists.ANY_TASK)
    flags.DEFINE_string(
        "output", None, "file to write; default: TASK_fit.toml in this folder", values
    )
    flags.DEFINE_boolean("overwrite", False, "overwrite an existing file", values)
    program.define_count(
        values,
        "train_episodes",
        60,
        "training episodes of the flat agent; 0: use random episodes only",
        least=0,
    )
    return values


def _fit(values: flags.FlagValues) -> int:
    if values.task is None:
        raise CommandError(
            "flag --task is missing: give a task, as in --task=gym:PointMaze_UMaze-v3"
        )
    try:
        task = tasks.unfitted(lists.task_word(values))
    except ValueError as error:
        raise CommandError(str(error)) from error
    if task.own is not None and task.name not in tasks.ALL:
        doubts.refuse_fault(tasks.find(task.word), task.name)
    output = Path(values.output or f"{task.name}_fit.toml")
    if output.suffix != ".toml" or output.stem in tasks.ALL:
        raise CommandError(
            f"flag --output={output}: give a name that ends in .toml and is not that of a task"
        )
    if output.exists() and not values.overwrite:
        raise CommandError(f"{output} exists already; add --overwrite to replace it")
    console = Console()
    for note in task.notes:
        console.say(f"note: {note}")
    try:
        found = fit(task, values.train_episodes, console.say)
    except EnvFailed as error:
        raise CommandError(str(error)) from error
    names = task.about.goal_names, task.about.subgoal_names
    output.parent.mkdir(parents=True, exist_ok=True)
    judged = task.about.threshold is None
    write_text(output, as_toml(found.settings, task.word, str(output), names, judged=judged))
    show(task, found, console)
    console.say(
        f"\n{output}: edit what you know better, then\n"
        f"  python launch/run.py --task={shlex.quote(str(output))}"
    )
    return 0


def fit(task: tasks.Unfitted, train_episodes: int, say: Callable[[str], None]) -> Fit:
    """Estimates a task's spaces from random episodes and from those of a briefly trained flat
    agent.

    Args:
      train_episodes: of the flat agent; 0 leaves it out.
      say: told what takes a while.
    """
    say("playing random episodes")
    random = estimates.random_episodes(task.env_of, task.about)
    settings = estimates.settings(task.about, random)
    episodes = min(train_episodes, math.ceil(_MOST_STEPS / settings.max_steps))
    if episodes:
        say(f"training a flat agent for {episodes} episodes of up to {settings.max_steps} steps")
    learnt = _learnt(task, settings, episodes) if episodes else None
    everything = estimates.joined([random, learnt]) if learnt else random
    if learnt:
        about = task.about._replace(max_steps=settings.max_steps)  # as the agent's episodes had
        settings = estimates.settings(about, everything)
    warned = cautions.warnings(task.about, random, everything, settings, task.own)
    return Fit(settings, random, learnt, list(warned))


def _learnt(task: tasks.Unfitted, settings: Settings, episodes: int) -> Played:
    """Episodes of a flat agent after brief training, alternately with and without noise."""
    entry = task.fit(settings)
    per_round = hac_suite.Config().episodes_per_round
    config = hac_suite.Config(
        episodes_per_period=max(1, episodes // per_round) * per_round, test_episodes=1
    )
    horizons = (settings.max_steps,)
    *_, last = hac_suite.train(
        entry.load_vector, config, [0], subgoal_layers=0, horizons=horizons, periods=1
    )
    env = entry.load_vector(_LEARNT)
    (actor,) = last.policies[0].actors(level_specs(env, horizons))
    rng = np.random.default_rng(0)
    middle, half = (env.action_high + env.action_low) / 2, (env.action_high - env.action_low) / 2
    noisy = np.arange(_LEARNT)[:, None] % 2 == 1

    def act(time: int, state: hac_suite.EnvStep) -> np.ndarray:
        del time
        output = actor(state.observation, state.desired_goal).astype(np.float64)
        noise = np.where(rng.random((_LEARNT, 1)) < 0.3, rng.uniform(-1, 1, output.shape), output)
        return middle + half * np.where(noisy, noise, output)

    seeds = np.random.default_rng(1).integers(2**32, size=_LEARNT)
    return estimates.play(env, env.goal_space.achieved, act, seeds, test=True)


def show(task: tasks.Unfitted, found: Fit, console: Console) -> None:
    """Prints the estimates, the episodes they come from, and warnings."""
    console.print(_settings_table(task, found.settings))
    console.print(_episodes_table(found))
    console.say(_lines(task, found.settings))
    for warning in found.warnings:
        console.say(f"warning: {warning}", style="yellow")


def _settings_table(task: tasks.Unfitted, settings: Settings) -> Table:
    """Every number that was estimated; beside it the one that somebody chose, if there is one."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    headings = ("space", "dimension", "low", "high", "threshold")
    for heading in (*headings, *(("chosen by hand",) if task.own else ())):
        table.add_column(heading, justify="left" if heading in headings[:2] else "right")
    for space, names in (("goal", task.about.goal_names), ("subgoal", task.about.subgoal_names)):
        fields = [getattr(settings, f"{space}_{field}") for field in headings[2:]]
        own = task.own and getattr(task.own, f"{space}_space")
        for i, name in enumerate(names):
            cells = [_number(field[i]) for field in fields]
            if own:
                chosen = (own.low[i], own.high[i], own.threshold[i])
                cells.append(" ".join(map(_number, chosen)))
            table.add_row(space, name, *cells)
    pairs = list(zip(settings.observation_offset, settings.observation_scale, strict=True))
    for i, (offset, scale) in enumerate(pairs[:_SHOWN]):
        name = task.own.observation_names[i] if task.own else f"obs[{i}]"
        low, high = _number(offset - scale), _number(offset + scale)
        own_scale = [_number(task.own.observation_scale[i])] if task.own else []
        table.add_row("observation", name, low, high, "", *own_scale)
    if len(pairs) > _SHOWN:
        table.add_row("observation", f"and {len(pairs) - _SHOWN} more in the file", "", "", "")
    return table


def _episodes_table(found: Fit) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in (
        "episodes",
        "number",
        "success",
        "goal achieved at start",
        "failed",
        "cut short",
    ):
        table.add_column(heading, justify="left" if heading == "episodes" else "right")
    for name, played in (("random", found.random), ("flat agent, briefly trained", found.learnt)):
        if played is not None:
            cells = [f"{share:.0%}" for share in cautions.shares(played)]
            table.add_row(name, str(len(played.steps)), *cells)
    return table


def _lines(task: tasks.Unfitted, settings: Settings) -> str:
    own = f" (by hand: {task.own.max_steps})" if task.own else ""
    lines = [f"steps of an episode: {settings.max_steps}{own}"]
    for layers, attempts in sorted(settings.horizons.items()):
        chosen = ""
        if task.own:
            by_hand = hac_suite.horizons(task.own.max_steps, layers, task.own.horizons)
            chosen = f" (by hand: {list(by_hand)})"
        lines.append(f"T with {layers} subgoal layer(s): {list(attempts)}{chosen}")
    return "\n".join(lines)


def _number(value: float) -> str:
    return f"{value:.3g}"


if __name__ == "__main__":
    sys.exit(main(sys.argv))
