"""Maps of goal spaces: where subgoals are put over training, and what critics expect there."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure

from analysis.figures.diagnostics import LOOKS
from analysis.reading import paper
from analysis.reading.episodes import some_planes
from analysis.reading.subgoals import places, points_named

_GOAL: dict[str, Any] = {
    "color": "#f0c000",
    "edgecolors": "#5a4700",
    "linewidths": 0.5,
    "s": 22,
    "alpha": 0.9,
}
_HERE: dict[str, Any] = {
    "color": "white",
    "edgecolors": "black",
    "linewidths": 1.2,
    "s": 60,
    "zorder": 5,
}
_BINS = 36
_SIDE = 2.9  # inches of a panel


class _Panel(NamedTuple):
    """What a panel of the maps shows."""

    layers: int
    level: int
    stage: int  # training episodes
    title: str  # of the plane
    plane: tuple[int, int]


def draw_subgoal_maps(table: pd.DataFrame) -> Figure:
    """Rows for each agent's levels, a column for each stage of training; of one stage, each plane.

    Darker where more subgoals were put; yellow dots are the episodes' end goals. A panel's title
    says how many of its subgoals were achieved.
    """
    names = points_named(table, "subgoal")
    rows = _panels(table, names)
    size = (_SIDE * len(rows[0]) + 1.2, _SIDE * len(rows) + 0.9)
    figure = Figure(figsize=(max(size[0], 7.5), size[1]), layout="constrained")
    axes = figure.subplots(len(rows), len(rows[0]), squeeze=False)
    for panels, row in zip(rows, axes, strict=True):
        for panel, ax in zip(panels, row, strict=True):
            _draw_map(ax, table, names, panel)
        who = f"{paper.agent_name(panels[0].layers)}\nlevel {panels[0].level}'s subgoals"
        row[0].set_ylabel(f"{who}\n{row[0].get_ylabel()}", fontsize="small")
    task = paper.title(table["task"].iloc[0])
    figure.suptitle(f"{task}: where subgoals are put (yellow: end goals)", fontweight="bold")
    return figure


def _panels(table: pd.DataFrame, names: Sequence[str]) -> list[list[_Panel]]:
    pairs = table[["subgoal_layers", "level"]].drop_duplicates().to_numpy().tolist()
    stages = [int(stage) for stage in sorted(table["train_episodes"].unique())]
    planes = some_planes(names)
    if len(stages) == 1:
        return [[_Panel(k, n, stages[0], *plane) for plane in planes] for k, n in sorted(pairs)]
    return [
        [_Panel(k, n, stage, *plane) for stage in stages]
        for k, n in sorted(pairs)
        for plane in planes
    ]


def _stage(train_episodes: int) -> str:
    if train_episodes < 0:
        return "trained"
    return f"after {train_episodes} episodes" if train_episodes else "untrained"


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _limits(
    table: pd.DataFrame, names: Sequence[str], plane: tuple[int, int]
) -> list[tuple[float, float]]:
    """What all panels of a row show of both dimensions."""
    points = places(table, "subgoal", tuple(names[d] for d in plane))
    low, high = points.min(0), points.max(0)
    room = 0.05 * np.maximum(high - low, 1e-6)
    return list(zip((low - room).tolist(), (high + room).tolist(), strict=True))


def _draw_map(ax: Axes, table: pd.DataFrame, names: Sequence[str], panel: _Panel) -> None:
    own = table[(table["subgoal_layers"] == panel.layers) & (table["level"] == panel.level)]
    shown = own[own["train_episodes"] == panel.stage]
    across, up = (names[dimension] for dimension in panel.plane)
    limits = _limits(own, names, panel.plane)
    colour = LOOKS[panel.level % len(LOOKS)].colour
    colours = LinearSegmentedColormap.from_list("level", ["#e4dcec", colour, "#140a1e"])
    said = _stage(panel.stage)
    if len(shown):
        x, y = places(shown, "subgoal", (across, up)).T
        counts, *edges = np.histogram2d(x, y, bins=_BINS, range=limits)
        filled = np.ma.masked_equal(counts.T, 0)
        scale = LogNorm(1, max(counts.max(), 2))
        ax.pcolormesh(*edges, filled, cmap=colours, norm=scale, rasterized=True)
        achieved = (shown["outcome"] == "achieved").mean()
        said += f", {panel.title}\n{len(shown)} subgoals, {achieved:.0%} achieved"
    if {f"goal_{across}", f"goal_{up}"} <= set(shown):
        ax.scatter(*np.unique(places(shown, "goal", (across, up)), axis=0).T, **_GOAL)
    ax.set_title(said, fontsize="small")
    ax.set_xlim(*limits[0])
    ax.set_ylim(*limits[1])
    ax.set_xlabel(_plain(across), fontsize="small")
    ax.set_ylabel(_plain(up), fontsize="small")
    ax.tick_params(labelsize="x-small")


def draw_values(agents: Sequence[dict[str, Any]], task: str) -> Figure:
    """A row for each agent, a column for each level: Q over the level's goals at one start."""
    columns = max(len(agent["levels"]) for agent in agents)
    size = (3.6 * columns + 0.6, 3.1 * len(agents) + 0.9)
    figure = Figure(figsize=(max(size[0], 6.5), size[1]), layout="constrained")
    panels = figure.subplots(len(agents), columns, squeeze=False)
    for row, agent in zip(panels, agents, strict=True):
        for ax, level in zip(row, agent["levels"], strict=False):
            _draw_value(ax, level)
            ax.set_title(_whose(agent, level), fontsize="small")
        for ax in row[len(agent["levels"]) :]:
            ax.axis("off")
    figure.suptitle(
        f"{paper.title(task)}: attempts that a level expects to need for each goal (Q)",
        fontweight="bold",
    )
    handles, labels = panels[0, len(agents[0]["levels"]) - 1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    return figure


def _whose(agent: dict[str, Any], level: dict[str, Any]) -> str:
    top = level["level"] == agent["subgoal_layers"]
    goals = "end goals" if top else f"level {level['level'] + 1}'s subgoals"
    return f"{paper.agent_name(agent['subgoal_layers'])}, level {level['level']}: {goals}"


def _draw_value(ax: Axes, level: dict[str, Any]) -> None:
    drawn = ax.pcolormesh(*level["axes"], level["q"], cmap="viridis", rasterized=True)
    ax.figure.colorbar(drawn, ax=ax, label="Q: 0 is there, lower is further")
    ax.scatter(*level["here"], **_HERE, label="where it is")
    if level["goal"] is not None:
        ax.scatter(*level["goal"], **{**_GOAL, "s": 90, "zorder": 5}, label="its end goal")
    across, up = (
        f"{_plain(name)} ({unit})"
        for name, unit in zip(level["names"], level["units"], strict=True)
    )
    ax.set_xlabel(across, fontsize="small")
    ax.set_ylabel(up, fontsize="small")
    ax.tick_params(labelsize="x-small")
