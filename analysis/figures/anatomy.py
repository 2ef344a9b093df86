"""Draws one episode: the agent's path, the subgoals of its levels, and their outcomes."""

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from analysis.figures.diagnostics import LOOKS
from analysis.reading import paper
from analysis.reading.episodes import Episode, GoalDimension, Subgoal, labelled, some_planes

_GOAL_COLOUR = "#f0c000"
_PATH_COLOUR = "#333333"
_GREY = "#777777"
_SIZES = (5.5, 8.0, 10.0)  # of markers in points, by the level that proposed
_LEAST_NUMBERED = 0.03  # of the episode
_ACHIEVED, _MISSED = "achieved", "missed"
_HATCH = "////"


def draw_anatomy(episode: Episode) -> Figure:
    """Left: the planes in which the agent moves. Right: every dimension over time, and outcomes.

    A subgoal space of one dimension has no plane, and nothing on the left. Dimensions that only the
    end goal has follow those of subgoals.

    Subgoals have the colour of their markers in videos: purple for level 1's, green for level 2's.
    Filled ones were achieved, hatched or crossed ones missed, hollow ones cut short.
    """
    shown = some_planes(episode.subgoal_space.names)
    dimensions = len(episode.subgoal_space.names)
    rows = dimensions + len(episode.goal_only) + 1
    figure = Figure(figsize=(13, max(5.2, 1.5 * rows + 1.2)))
    figure.set_layout_engine("constrained", w_pad=0.08, h_pad=0.05)
    right: FigureBase = figure
    if shown:
        left, right = figure.subfigures(1, 2, width_ratios=(1, 1.25), squeeze=False)[0]
        for ax, plane in zip(np.ravel(left.subplots(len(shown), 1)), shown, strict=True):
            draw_plane(ax, episode, *plane)
    heights = [1.0] * (rows - 1) + [0.3 + 0.35 * max(episode.subgoal_layers, 1)]
    *over_time, outcomes = right.subplots(rows, 1, sharex=True, height_ratios=heights)
    for dimension, ax in enumerate(over_time[:dimensions]):
        _draw_dimension(ax, episode, dimension)
    for goal_dimension, ax in zip(episode.goal_only, over_time[dimensions:], strict=True):
        _draw_goal_only(ax, goal_dimension)
    _draw_outcomes(outcomes, episode)
    figure.suptitle(_title(episode), fontweight="bold")
    figure.legend(
        handles=list(_legend(episode)), loc="outside lower center", ncols=4, frameon=False
    )
    return figure


def _title(episode: Episode) -> str:
    end = "goal achieved" if episode.success else "goal not achieved"
    who = f"{paper.title(episode.task)}, {paper.agent_name(episode.subgoal_layers)}"
    return f"{who}, seed {episode.seed}: {end} in {episode.steps} steps"


def draw_plane(ax: Axes, episode: Episode, title: str, plane: tuple[int, int]) -> None:
    """The path and all subgoals in the plane of two dimensions of the subgoal space."""
    for subgoal in sorted(episode.subgoals, key=lambda s: -s.level):
        x, y = subgoal.point[list(plane)]
        ax.plot(x, y, **_marker(subgoal), zorder=2 + subgoal.level)
        if subgoal.outcome == _MISSED:
            look = _marker(subgoal)
            look.update(marker="x", markersize=0.7 * look["markersize"])
            ax.plot(x, y, **look, zorder=2 + subgoal.level)
    for number, subgoal in _numbered(episode):
        x, y = subgoal.point[list(plane)]
        ax.annotate(
            str(number), (x, y), xytext=(6, 6), textcoords="offset points", fontsize="small",
            color=LOOKS[subgoal.level % len(LOOKS)].colour, zorder=9,
        )  # fmt: skip
    path = episode.path[:, plane]
    ax.plot(*path.T, color=_PATH_COLOUR, linewidth=1.3, zorder=6)
    ax.plot(*path[0], "o", color="white", markeredgecolor=_PATH_COLOUR, markersize=8, zorder=7)
    ax.plot(*path[-1], "o", color=_PATH_COLOUR, markersize=7, zorder=7)
    _draw_goal(ax, episode, plane)
    ax.set_aspect("equal", adjustable="datalim")
    space = episode.subgoal_space
    across, up = (labelled(space.names[d], space.units[d]) for d in plane)
    ax.set_xlabel(across)
    ax.set_ylabel(up)
    ax.set_title(title, fontsize="medium")
    _tidy(ax)


def _numbered(episode: Episode) -> Iterator[tuple[int, Subgoal]]:
    """The top level's subgoals and their numbers, but for those too short to be told apart."""
    for number, subgoal in enumerate(episode.of_level(episode.subgoal_layers), start=1):
        if subgoal.end_step - subgoal.step >= _LEAST_NUMBERED * episode.steps:
            yield number, subgoal


def _draw_goal(ax: Axes, episode: Episode, plane: tuple[int, int]) -> None:
    across, up = (episode.goal_in(dimension) for dimension in plane)
    if across is None or up is None:
        return
    (x, wide), (y, high) = across, up
    box = Rectangle(
        (x - wide, y - high), 2 * wide, 2 * high,
        facecolor=_GOAL_COLOUR, edgecolor="none", alpha=0.55, zorder=1,
    )  # fmt: skip
    ax.add_patch(box)


def _marker(subgoal: Subgoal) -> dict:
    """How a subgoal is marked: filled where it was achieved."""
    colour = LOOKS[subgoal.level % len(LOOKS)].colour
    achieved = subgoal.outcome == _ACHIEVED
    return {
        "marker": LOOKS[subgoal.level % len(LOOKS)].marker,
        "markersize": _SIZES[min(subgoal.level, len(_SIZES) - 1)],
        "markerfacecolor": colour if achieved else "white",
        "markeredgecolor": colour,
        "markeredgewidth": 1.2,
        "alpha": 0.85 if achieved else 0.6,
        "linestyle": "none",
    }


def _draw_dimension(ax: Axes, episode: Episode, dimension: int) -> None:
    """The agent's value over time, the goal's band, and each subgoal for as long as it stood."""
    space = episode.subgoal_space
    _label(ax, space.names[dimension], space.units[dimension])
    goal = episode.goal_in(dimension)
    if goal is not None:
        _draw_band(ax, goal)
    reach = episode.subgoal_space.threshold[dimension]
    for subgoal in sorted(episode.subgoals, key=lambda s: -s.level):
        colour = LOOKS[subgoal.level % len(LOOKS)].colour
        achieved = subgoal.outcome == _ACHIEVED
        box = Rectangle(
            (subgoal.step, subgoal.point[dimension] - reach),
            subgoal.end_step - subgoal.step,
            2 * reach,
            facecolor=colour if achieved else "none",
            edgecolor=colour,
            hatch=_HATCH if subgoal.outcome == _MISSED else None,
            alpha=0.35 if achieved else 0.75,
            linewidth=0.8,
        )
        ax.add_patch(box)
    ax.plot(episode.path[:, dimension], color=_PATH_COLOUR, linewidth=1.4, zorder=5)
    _tidy(ax)


def _draw_goal_only(ax: Axes, dimension: GoalDimension) -> None:
    """The agent's value over time, and the goal's band."""
    _label(ax, dimension.name, dimension.unit)
    _draw_band(ax, dimension.goal)
    said = "only the end goal asks for it"
    if dimension.path is None:
        said += "; where the agent was is not recorded"
    else:
        ax.plot(dimension.path, color=_PATH_COLOUR, linewidth=1.4, zorder=5)
    ax.set_title(said, fontsize="x-small", color=_GREY, loc="right", pad=2)
    _tidy(ax)


def _label(ax: Axes, name: str, unit: str) -> None:
    plain = name.replace("_", " ")
    ax.set_ylabel(f"{plain}\n({unit})" if unit else plain, fontsize="small")


def _draw_band(ax: Axes, goal: tuple[float, float]) -> None:
    """A goal, as far as its threshold to either side."""
    ax.axhspan(goal[0] - goal[1], goal[0] + goal[1], color=_GOAL_COLOUR, alpha=0.35, linewidth=0)


def _draw_outcomes(ax: Axes, episode: Episode) -> None:
    """A row per level, the top one above: each subgoal's time, filled where it was achieved."""
    layers = episode.subgoal_layers
    for subgoal in episode.subgoals:
        colour = LOOKS[subgoal.level % len(LOOKS)].colour
        achieved = subgoal.outcome == _ACHIEVED
        ax.barh(
            subgoal.level,
            subgoal.end_step - subgoal.step,
            left=subgoal.step,
            height=0.62,
            facecolor=colour if achieved else "white",
            edgecolor=colour,
            hatch=_HATCH if subgoal.outcome == _MISSED else None,
            linewidth=0.9,
            alpha=0.85,
        )
    for number, subgoal in _numbered(episode):
        middle = (subgoal.step + subgoal.end_step) / 2
        ax.text(middle, layers, str(number), **_number_style(subgoal.outcome == _ACHIEVED))
    if not layers:
        ax.text(0.5, 0.5, "proposes no subgoals", transform=ax.transAxes, ha="center", color=_GREY)
    ax.set_yticks(range(1, layers + 1), [f"level {level}" for level in range(1, layers + 1)])
    ax.set_ylim(0.5, max(layers, 1) + 0.5)
    ax.set_xlim(0, episode.steps)
    ax.set_xlabel("step")
    _tidy(ax)


def _number_style(achieved: bool) -> dict:
    box = None if achieved else {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
    return {
        "ha": "center", "va": "center", "fontsize": "x-small", "bbox": box,
        "color": "white" if achieved else "black",
    }  # fmt: skip


def _legend(episode: Episode) -> Iterator[Line2D | Patch]:
    yield Line2D([], [], color=_PATH_COLOUR, label="path: from the white dot to the black one")
    yield Patch(facecolor=_GOAL_COLOUR, alpha=0.5, label="end goal, within its threshold")
    for level in range(1, episode.subgoal_layers + 1):
        look = LOOKS[level % len(LOOKS)]
        yield Line2D(
            [], [], color=look.colour, marker=look.marker, linestyle="none",
            label=f"level {level}'s subgoals: {_counts(episode, level)}",
        )  # fmt: skip
    if episode.subgoal_layers:
        yield Patch(facecolor=_GREY, edgecolor=_GREY, label="filled: achieved")
        yield Patch(
            facecolor="white", edgecolor=_GREY, hatch=_HATCH, label="hatched or crossed: missed"
        )
        yield Patch(
            facecolor="white", edgecolor=_GREY,
            label="hollow: cut short, by a level above or the end",
        )  # fmt: skip


def _counts(episode: Episode, level: int) -> str:
    own = [subgoal.outcome for subgoal in episode.of_level(level)]
    return f"{own.count(_ACHIEVED)} of {len(own)} achieved"


def _tidy(ax: Axes) -> None:
    ax.grid(alpha=0.25, linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
