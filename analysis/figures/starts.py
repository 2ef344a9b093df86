"""Which test episodes fail: their starts and goals, and a gallery of some of them."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.figures.anatomy import draw_plane
from analysis.reading import paper
from analysis.reading.episodes import Episode, labelled, some_planes
from analysis.reading.subgoals import points_named

_REACHED: dict[str, Any] = {
    "marker": "o",
    "color": "#1a7f37",
    "alpha": 0.35,
    "s": 16,
    "linewidths": 0,
}
_FAILED: dict[str, Any] = {
    "marker": "x",
    "color": "#c5221f",
    "s": 34,
    "linewidths": 1.6,
    "zorder": 4,
}
_COLUMNS = 4  # failures that are shown


class _Panel(NamedTuple):
    """What a panel of starts and goals shows: two columns of the table, and how to call them."""

    title: str
    columns: tuple[str, str]
    labels: tuple[str, str]


def draw_starts(table: pd.DataFrame, units: Mapping[str, str]) -> Figure:
    """A row for each agent: where episodes began, and where their goals were, by how they ended.

    Where both have one dimension and so no plane, goals are drawn over starts.

    Args:
      units: of dimensions, by name, as far as they are known.

    Raises:
      ValueError: there is neither a plane nor a pair of dimensions.
    """
    panels = list(_panels(table, units))
    if not panels:
        raise ValueError("starts and goals that lie in no plane")
    agents = sorted(table["subgoal_layers"].unique())
    size = (3.4 * len(panels) + 0.6, 3.1 * len(agents) + 1.0)
    figure = Figure(figsize=(max(size[0], 6.5), size[1]), layout="constrained")
    grid = figure.subplots(len(agents), len(panels), squeeze=False)
    for row, layers in zip(grid, agents, strict=True):
        own = table[table["subgoal_layers"] == layers]
        for ax, panel in zip(row, panels, strict=True):
            _draw_ends(ax, own, panel)
        row[0].set_ylabel(f"{_failures(own, layers)}\n{row[0].get_ylabel()}", fontsize="small")
    figure.suptitle(
        f"{paper.title(table['task'].iloc[0])}: starts and goals from which agents fail",
        fontweight="bold",
    )
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    return figure


def _panels(table: pd.DataFrame, units: Mapping[str, str]) -> Iterator[_Panel]:
    named = {kind: points_named(table, kind) for kind in ("start", "goal")}
    label = {name: labelled(name, units.get(name)) for own in named.values() for name in own}
    planes = [(kind, *plane) for kind, own in named.items() for plane in some_planes(own)]
    for kind, title, plane in planes:
        across, up = (named[kind][d] for d in plane)
        columns = f"{kind}_{across}", f"{kind}_{up}"
        yield _Panel(f"{kind}: {title}", columns, (label[across], label[up]))
    if not planes and all(named.values()):
        (start,), (goal,) = named.values()
        labels = f"start: {label[start]}", f"goal: {label[goal]}"
        yield _Panel("start and goal", (f"start_{start}", f"goal_{goal}"), labels)


def _failures(table: pd.DataFrame, layers: int) -> str:
    failed, seeds = int((table["success"] == 0).sum()), table["seed"].nunique()
    of = f"{seeds} seed{'' if seeds == 1 else 's'}"
    return f"{paper.agent_name(layers)}\n{failed} of {len(table)} tests of {of} fail"


def _draw_ends(ax: Axes, table: pd.DataFrame, panel: _Panel) -> None:
    points = table[list(panel.columns)].to_numpy(float)
    success = table["success"].to_numpy(bool)
    ax.scatter(*points[success].T, **_REACHED, label="goal reached")
    ax.scatter(*points[~success].T, **_FAILED, label="goal not reached")
    ax.set_aspect("equal", adjustable="datalim")
    ax.grid(alpha=0.25, linewidth=0.6)
    ax.tick_params(labelsize="x-small")
    ax.set_xlabel(panel.labels[0], fontsize="small")
    ax.set_ylabel(panel.labels[1], fontsize="small")
    ax.set_title(panel.title, fontsize="small")


def draw_failures(episodes: Sequence[Episode]) -> Figure:
    """A gallery of failed episodes of one agent, and how near each of them came to its goal.

    Raises:
      ValueError: there are no episodes, or their space has no plane.
    """
    planes = some_planes(episodes[0].subgoal_space.names) if episodes else []
    if not planes:
        raise ValueError("no failure that can be drawn")
    shown = episodes[:_COLUMNS]
    size = (3.2 * max(len(shown), 2) + 0.6, 3.1 * len(planes) + 1.0)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(len(planes), len(shown), squeeze=False)
    for row, (title, plane) in zip(grid, planes, strict=True):
        for ax, episode in zip(row, shown, strict=True):
            draw_plane(ax, episode, title, plane)
            ax.tick_params(labelsize="x-small")
    for ax, episode in zip(grid[0], shown, strict=True):
        said = f"seed {episode.seed}, {episode.steps} steps\n{_nearest(episode)}"
        ax.set_title(f"{said}\n{ax.get_title()}", fontsize="small")
    agent = paper.agent_name(episodes[0].subgoal_layers)
    figure.suptitle(
        f"{paper.title(episodes[0].task)}, {agent}: tests that failed\n"
        "from the white dot to the black one; yellow: the end goal",
        fontweight="bold",
    )
    return figure


def _nearest(episode: Episode) -> str:
    """How near the episode came to its goal, in thresholds of the worst dimension."""
    wanted = [(episode.goal_in(d), path) for d, path in enumerate(episode.path.T)]
    wanted += [(dimension.goal, dimension.path) for dimension in episode.goal_only]
    away = [
        np.abs(path - goal[0]) / goal[1]
        for goal, path in wanted
        if goal is not None and goal[1] > 0 and path is not None
    ]
    if not away:
        return "the goal is not in the plane"
    nearest = float(np.max(away, axis=0).min())
    unknown = [dimension.name for dimension in episode.goal_only if dimension.path is None]
    but = f" ({', '.join(unknown)} not recorded)".replace("_", " ") if unknown else ""
    return f"nearest: {nearest:.1f} thresholds from the goal{but}"
