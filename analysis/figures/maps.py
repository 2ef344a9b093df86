"""Maps of goal spaces: where levels put subgoals during training, and Q over goals."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, LinearSegmentedColormap, LogNorm, to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter

from analysis.figures.diagnostics import LOOKS
from analysis.reading import paper
from analysis.reading.episodes import labelled, some_planes
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
    plane: tuple[str, str]  # names of its dimensions


class _Cells(NamedTuple):
    """Subgoals counted in the cells of a panel's plane."""

    counts: np.ndarray  # [cells across, cells up]
    edges: Sequence[np.ndarray]  # of the cells, across and up


def draw_subgoal_maps(table: pd.DataFrame, units: Mapping[str, str]) -> Figure:
    """Rows for each agent's levels, a column for each stage of training; of one stage, each plane.

    The more subgoals were put into a cell, the darker it is in the colour of their level, on a
    scale beside each row; yellow dots are the episodes' end goals. A panel's title says how many
    of its subgoals were achieved.

    Args:
      units: of dimensions, by name, as far as they are known.

    Raises:
      ValueError: the subgoal space is of one dimension, and has no plane.
    """
    rows = _panels(table, points_named(table, "subgoal"))
    size = (_SIDE * len(rows[0]) + 1.9, _SIDE * len(rows) + 0.9)
    figure = Figure(figsize=(max(size[0], 7.5), size[1]), layout="constrained")
    axes = figure.subplots(len(rows), len(rows[0]), squeeze=False)
    for panels, row in zip(rows, axes, strict=True):
        _draw_row(figure, row, table, panels)
        for panel, ax in zip(panels, row, strict=True):
            across, up = (labelled(name, units.get(name)) for name in panel.plane)
            ax.set_xlabel(across, fontsize="small")
            ax.set_ylabel(up, fontsize="small")
        who = f"{paper.agent_name(panels[0].layers)}\nlevel {panels[0].level}'s subgoals"
        row[0].set_ylabel(f"{who}\n{row[0].get_ylabel()}", fontsize="small")
    goals = " (yellow: end goals)" if any(ax.collections[1:] for ax in axes.flat) else ""
    task = paper.title(table["task"].iloc[0])
    figure.suptitle(f"{task}: where subgoals are put{goals}", fontweight="bold")
    return figure


def _panels(table: pd.DataFrame, names: Sequence[str]) -> list[list[_Panel]]:
    pairs = table[["subgoal_layers", "level"]].drop_duplicates().to_numpy().tolist()
    stages = [int(stage) for stage in sorted(table["train_episodes"].unique())]
    planes = [(title, (names[a], names[b])) for title, (a, b) in some_planes(names)]
    if not planes:
        raise ValueError("subgoals that lie in no plane")
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


def _draw_row(
    figure: Figure, row: Sequence[Axes], table: pd.DataFrame, panels: Sequence[_Panel]
) -> None:
    """A level's panels, and the scale that they share."""
    first = panels[0]
    own = table[(table["subgoal_layers"] == first.layers) & (table["level"] == first.level)]
    cells = [_count(own, panel) for panel in panels]
    scale = LogNorm(1, max(2, *(each.counts.max() for each in cells)))
    colours = _tints(LOOKS[first.level % len(LOOKS)].colour)
    for ax, panel, each in zip(row, panels, cells, strict=True):
        filled = np.ma.masked_equal(each.counts.T, 0)
        ax.pcolormesh(*each.edges, filled, cmap=colours, norm=scale, rasterized=True)
        ax.set(xlim=each.edges[0][[0, -1]], ylim=each.edges[1][[0, -1]])
        _annotate(ax, own[own["train_episodes"] == panel.stage], panel)
    bar = figure.colorbar(
        ScalarMappable(scale, colours),
        ax=list(row),
        ticks=LogLocator(subs=(1, 2, 5)),
        format=StrMethodFormatter("{x:.0f}"),
    )
    bar.set_label("subgoals per cell (log)", fontsize="small")
    bar.ax.yaxis.set_minor_locator(NullLocator())
    bar.ax.tick_params(labelsize="x-small")


def _tints(colour: str) -> Colormap:
    """From a light tint of a colour, past itself, to a dark shade of it."""
    own = np.array(to_rgb(colour))
    return LinearSegmentedColormap.from_list("level", [0.2 * own + 0.8, own, 0.2 * own])


def _count(own: pd.DataFrame, panel: _Panel) -> _Cells:
    """A level's subgoals at a stage, in cells that are the same at all its stages."""
    points = places(own, "subgoal", panel.plane)
    low, high = points.min(0), points.max(0)
    room = 0.05 * np.maximum(high - low, 1e-6)
    limits = np.stack([low - room, high + room], axis=1).tolist()
    shown = points[own["train_episodes"] == panel.stage]
    across, up = shown.T
    counts, *edges = np.histogram2d(across, up, bins=_BINS, range=limits)
    return _Cells(counts, edges)


def _annotate(ax: Axes, shown: pd.DataFrame, panel: _Panel) -> None:
    """What a panel has beside its cells: a title, and the end goals of these subgoals."""
    said = _stage(panel.stage)
    if len(shown):
        achieved = (shown["outcome"] == "achieved").mean()
        said += f", {panel.title}\n{len(shown)} subgoals, {achieved:.0%} achieved"
    ax.set_title(said, fontsize="small")
    ax.tick_params(labelsize="x-small")
    if {f"goal_{name}" for name in panel.plane} <= set(shown):
        ends = np.unique(places(shown, "goal", panel.plane), axis=0)
        ax.scatter(*ends.T, **_GOAL)


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
    across, up = map(labelled, level["names"], level["units"])
    ax.set_xlabel(across, fontsize="small")
    ax.set_ylabel(up, fontsize="small")
    ax.tick_params(labelsize="x-small")
