"""Draws tuning studies: trials over the core-hours spent, and which parameters mattered."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.statistics.tuning import LEAST_TRIALS, TOP, Spread, Study

_BLUE, _ORANGE, _GREY = "#1558c0", "#c05a15", "#777777"


def draw(studies: Sequence[Study]) -> Figure:
    """A row for each study: its trials over the core-hours spent, and what mattered."""
    figure = Figure(figsize=(10, 0.4 + 3.2 * len(studies)))
    figure.set_layout_engine("constrained", w_pad=0.08, h_pad=0.08)
    axes = figure.subplots(len(studies), 2, squeeze=False, width_ratios=(3, 2))
    for (left, right), study in zip(axes, studies, strict=True):
        _draw_trials(left, study)
        _draw_importance(right, study)
    return figure


def _draw_trials(ax: Axes, study: Study) -> None:
    complete = study.complete
    unlabelled = [trial for trial in complete if not trial.label]
    pruned = [trial for trial in study.trials if trial.state == "pruned"]
    ax.plot([t.spent for t in unlabelled], [t.value for t in unlabelled], "o", color=_BLUE,
            alpha=0.6, label="complete")  # fmt: skip
    ax.plot([t.spent for t in pruned], [t.last for t in pruned], "x", color=_GREY,
            label="pruned (success at its last test)")  # fmt: skip
    for trial, marker in zip(study.started_with(), "sD^v<>", strict=False):
        spread = Spread.of(list(trial.seeds.values()))
        ax.errorbar(trial.spent, spread.mean, np.nan_to_num(spread.error), fmt=marker,
                    color=_ORANGE, capsize=3, label=trial.label)  # fmt: skip
    if complete:
        best = np.maximum.accumulate([trial.value for trial in complete])
        ends = [*(trial.spent for trial in complete), study.trials[-1].spent]
        ax.step(
            ends, [*best, best[-1]], where="post", color=_BLUE, linewidth=1, label="best so far"
        )
    ax.axvline(study.hours, color=_GREY, linewidth=0.8, linestyle=":")
    ax.set_title(study.title, size="medium")
    ax.set_xlabel("core-hours")
    ax.set_ylabel("objective")
    ax.set_ylim(-0.03, 1.03)
    ax.grid(alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(loc="best", fontsize="x-small", framealpha=0.85)


def _draw_importance(ax: Axes, study: Study) -> None:
    ax.spines[["top", "right"]].set_visible(False)
    if not study.importance:
        ax.text(0.5, 0.5, f"fewer than {LEAST_TRIALS} trials", ha="center", color=_GREY)
        ax.set_axis_off()
        return
    names = list(study.importance)
    found = [study.importance[name] for name in names]
    colours = [_BLUE if one.share > one.noise else _GREY for one in found]
    ax.barh(names, [one.share for one in found], color=colours, height=0.6)
    ax.plot([one.noise for one in found], names, "|", color=_ORANGE, markersize=12,
            label="95% of shuffled trials stay below")  # fmt: skip
    ax.invert_yaxis()
    ax.tick_params(axis="y", labelsize="small")
    ax.set_xlabel(f"importance for the best {TOP:.0%} of trials")
    ax.legend(loc="lower right", fontsize="x-small", framealpha=0.85)
