"""Pictures that explain what agents have learnt, from whatever was recorded in a run folder."""

import itertools
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from matplotlib.figure import Figure

from analysis.figures.maps import draw_subgoal_maps, draw_values
from analysis.figures.starts import draw_failures, draw_starts
from analysis.reading import names, paper
from analysis.reading.episodes import load_episodes, load_units
from analysis.reading.subgoals import load_recorded, load_values, task_word


class Explanation(NamedTuple):
    """A picture, what it is called, and what it shows."""

    name: str  # of its file, without suffix
    figure: Figure
    description: str
    caption: str
    of_failures: bool = False  # whether it says which tests fail


def explanations(folder: Path, task: str) -> Iterator[Explanation]:
    """Those for which the folder has records, which are whole."""
    makers: tuple[Callable[[Path, str], Iterator[Explanation]], ...] = (
        _starts, _gallery, _maps, _values,
    )  # fmt: skip
    for make in makers:
        try:
            yield from make(folder, task)
        except (LookupError, OSError, TypeError, ValueError):
            continue  # not recorded, or damaged: the others can still be seen


def recording_command(task: str, folder: Path) -> str:
    """What records what these pictures show."""
    word, run = (shlex.quote(str(part)) for part in (task_word(task, folder), folder))
    return f"python launch/record_episodes.py --task={word} --run={run}"


def _starts(folder: Path, task: str) -> Iterator[Explanation]:
    del task
    yield Explanation(
        "starts",
        draw_starts(load_recorded(folder, names.STARTS), load_units(folder)),
        "starts and goals of test episodes, by whether the goal was reached",
        "Which tests fail. A dot is a test episode that reached its goal, a cross one that "
        "failed. Crosses close together show a part of the task that the agent has not learnt.",
        of_failures=True,
    )


def _gallery(folder: Path, task: str) -> Iterator[Explanation]:
    episodes = load_episodes(folder, task, names.FAILED_EPISODES)
    by_agent = sorted(episodes, key=lambda episode: episode.subgoal_layers)
    for layers, own in itertools.groupby(by_agent, key=lambda episode: episode.subgoal_layers):
        agent = paper.agent_name(layers)
        yield Explanation(
            f"failures_{layers}layers",
            draw_failures(list(own)),
            f"paths of test episodes of the agent with {agent} that failed",
            f"Failures of the agent with {agent}: its path, the end goal in yellow, and subgoals, "
            "filled where they were achieved.",
            of_failures=True,
        )


def _maps(folder: Path, task: str) -> Iterator[Explanation]:
    try:
        table = load_recorded(folder, names.MAPS)
    except FileNotFoundError:
        table = load_recorded(folder, names.SUBGOALS)
    if table["level"].empty:
        return
    whose = _whose(table)
    yield Explanation(
        "subgoal_maps",
        draw_subgoal_maps(table, load_units(folder)),
        f"density of the subgoals of {whose}",
        f"Where the subgoals of {whose} are in test episodes{_stages(table)}. The darker a cell, "
        "the more subgoals: the scale beside it is logarithmic.",
    )


def _whose(table: pd.DataFrame) -> str:
    """Which levels there are subgoals of."""
    said = []
    for layers, own in table.groupby("subgoal_layers")["level"].unique().items():
        whole = len(own) == layers > 1
        levels = ["each level"] if whole else [f"level {level}" for level in sorted(own)]
        said += [f"{each} of the agent with {paper.agent_name(int(layers))}" for each in levels]
    return " and ".join(said)


def _stages(table: pd.DataFrame) -> str:
    """Which policies the subgoals are of."""
    stages = sorted(table["train_episodes"].unique())
    if stages[-1] < 0:
        return " of the trained policies"
    if len(stages) == 1:
        return f" after {stages[0]} training episodes"
    return ", from left to right as training continues"


def _values(folder: Path, task: str) -> Iterator[Explanation]:
    agents = [agent for agent in load_values(folder) if agent["levels"]]
    if agents:
        yield Explanation(
            "values",
            draw_values(agents, task),
            "Q of each level over its goals, at the start of a test episode",
            "What each level's critic expects at the start of a test, for every goal that it "
            "could be given: about minus the attempts that it would need. Bright goals are near "
            "for the level. Dimensions that are not drawn keep their current value, or that of "
            "the end goal.",
        )
