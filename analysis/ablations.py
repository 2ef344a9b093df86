"""Ablations: agents with one choice of HAC changed, compared with unchanged ones."""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from analysis import program
from analysis.figures.success import DOTS_PER_INCH
from analysis.reading import names, paper
from analysis.reading.files import write_atomically
from analysis.reading.results import NoResults, load
from analysis.statistics.seeds import bootstrap, episodes_to, mean_interval

_HELP = """Compares ablations: agents with one choice changed against unchanged ones.

  python -m analysis.ablations --data=runs/ablations

writes ablations.png and ablations.csv, and prints the table. `python launch/ablate.py` trains the
variants: --data holds VARIANT/TASK/results.csv.

Flags:
{flags}

Exit status: 0; 2 a file to read is missing or damaged, or the command was wrong."""

FOLDER = Path(__file__).parent / "data" / "ablations"
NAME = "ablations"
REFERENCE = "paper"
LABELS = {
    REFERENCE: "unchanged",
    "release_2018": "choices of the 2018 release",
    "release_2020": "choices of the 2020 release",
    "no_subgoal_tests": "no subgoal testing",
    "no_hindsight_actions": "no hindsight actions",
    "no_hindsight_goals": "no hindsight goals",
    "penalise_cut_short": "penalty for attempts cut short",
    "bf16": "products in bfloat16",
}
_NOTHING = "{folder}: holds no results of variants; run `python launch/ablate.py` first"
_COLOUR, _GREY = "#1558c0", "#777777"


def load_variants(folder: Path) -> pd.DataFrame:
    """All results in `<folder>/<variant>/<task>/`, with a column `variant`.

    Raises:
      ValueError: there are none, or as `analysis.reading.results.load`.
    """
    found = []
    for results in sorted(Path(folder).glob(f"*/*/{names.RESULTS}")):
        try:
            table = load(results.parent)
        except NoResults:
            continue
        found.append(table.assign(variant=results.parent.parent.name))
    if not found:
        raise ValueError(_NOTHING.format(folder=folder))
    return pd.concat(found, ignore_index=True)


def compare(results: pd.DataFrame) -> pd.DataFrame:
    """A row per task, agent and variant, the unchanged first.

    Returns:
      `n` seeds; `final` success at the last period that all variants have, and `area`, the mean
      success of all trained periods until then (the area under the curve), each with `_low` and
      `_high`, its 95% interval over seeds; `difference` of the area from that of the unchanged,
      with its interval; `episodes_to_80`, the median seed's.
    """
    rows = []
    for (task, layers), of_agent in results.groupby(["task", "subgoal_layers"]):
        # Where a variant stopped early, all are compared until there.
        of_agent = of_agent[of_agent["train_episodes"] <= _common_budget(of_agent)]
        last = of_agent["period"].max()
        reference = _areas(of_agent[of_agent["variant"] == REFERENCE])
        for variant in sorted(of_agent["variant"].unique(), key=_place):
            own = of_agent[of_agent["variant"] == variant]
            areas, final = _areas(own), own.loc[own["period"] == last, "success_rate"]
            reached = episodes_to(own)["median_episodes"].iloc[0]
            row = {"task": task, "subgoal_layers": layers, "variant": variant, "n": len(areas)}
            for name, sample in (("final", final.to_numpy()), ("area", areas)):
                interval = mean_interval(sample) if len(sample) else (np.nan,) * 3
                row |= dict(zip((name, f"{name}_low", f"{name}_high"), interval, strict=True))
            row |= _difference(areas, reference, is_reference=variant == REFERENCE)
            rows.append({**row, "episodes_to_80": reached})
    return pd.DataFrame(rows)


def _common_budget(results: pd.DataFrame) -> int:
    """Training episodes that at least one seed of every variant has reached."""
    return results.groupby("variant")["train_episodes"].max().min()


def _place(variant: str) -> tuple[int, str]:
    order = list(LABELS)
    return (order.index(variant) if variant in order else len(order)), variant


def _areas(results: pd.DataFrame) -> np.ndarray:
    trained = results[results["period"] > 0]
    return trained.groupby("seed")["success_rate"].mean().to_numpy()


def _difference(areas: np.ndarray, reference: np.ndarray, *, is_reference: bool) -> dict:
    names = ("difference", "difference_low", "difference_high")
    if is_reference or not len(reference) or not len(areas):
        return dict.fromkeys(names, np.nan)

    def difference(a: np.ndarray, b: np.ndarray, axis: int = -1) -> np.ndarray:
        return a.mean(axis=axis) - b.mean(axis=axis)

    value = float(areas.mean() - reference.mean())
    return dict(zip(names, (value, *bootstrap([areas, reference], difference)), strict=True))


def draw(table: pd.DataFrame) -> Figure:
    """A panel per task and agent: the area under the curve of each variant, with its interval."""
    panels = list(table.groupby(["task", "subgoal_layers"]))
    most = max(len(own) for _, own in panels)
    figure = Figure(figsize=(2.6 + 4.2 * len(panels), 1.6 + 0.42 * most))
    figure.set_layout_engine("constrained", w_pad=0.08, h_pad=0.08)
    axes = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
    variants = sorted(table["variant"].unique(), key=_place)
    for ax, ((task, layers), own) in zip(axes, panels, strict=True):
        _plot(ax, own.set_index("variant"), variants)
        counts = ", ".join(sorted({f"n={n}" for n in own["n"]}))
        ax.set_title(f"{paper.title(task)}\n{paper.agent_name(layers)}, {counts}", size="medium")
    axes[0].set_yticks(range(len(variants)), [LABELS.get(name, name) for name in variants])
    axes[0].invert_yaxis()
    return figure


def _plot(ax: Axes, own: pd.DataFrame, variants: Sequence[str]) -> None:
    for y, variant in enumerate(variants):
        if variant not in own.index:
            ax.text(0.5, y, "not run", ha="center", va="center", color=_GREY, size="small")
            continue
        row = own.loc[variant]
        ax.plot([row["area_low"], row["area_high"]], [y, y], color=_COLOUR, linewidth=2)
        ax.plot(row["area"], y, "o", color=_COLOUR, label="mean of all trained periods")
        ax.plot(row["final"], y, "|", color=_GREY, markersize=12, label="last period")
    if REFERENCE in own.index:
        ax.axvline(own.loc[REFERENCE, "area"], color=_COLOUR, alpha=0.25, linewidth=1)
    handles, labels = ax.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    ax.legend(unique.values(), unique.keys(), loc="best", fontsize="x-small", framealpha=0.85)
    ax.set_xlim(-0.03, 1.03)
    ax.xaxis.set_major_formatter(PercentFormatter(1.0))
    ax.set_xlabel("end goals achieved in tests")
    ax.grid(axis="x", alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)


HEADINGS = (
    "task",
    "layers",
    "variant",
    "n",
    "last period",
    "mean of all periods",
    "minus that of the unchanged",
    "episodes to 80%",
)


def as_text(table: pd.DataFrame) -> str:
    """The comparison as a table in Markdown."""
    rows = []
    for row in table.itertuples():
        last = _share(row.final, row.final_low, row.final_high)
        area = _share(row.area, row.area_low, row.area_high)
        less = "-"
        if not pd.isna(row.difference):
            low, high = 100 * row.difference_low, 100 * row.difference_high
            less = f"{100 * row.difference:+.0f} [{low:+.0f}, {high:+.0f}]"
        reached = "-" if pd.isna(row.episodes_to_80) else f"{row.episodes_to_80:.0f}"
        cells = (row.task, row.subgoal_layers, LABELS.get(row.variant, row.variant), row.n)
        rows.append((*cells, last, area, less, reached))
    return "\n".join(program.markdown_table(HEADINGS, rows))


def _share(mean: float, low: float, high: float) -> str:
    interval = "" if pd.isna(low) else f" [{100 * low:.0f}, {100 * high:.0f}]"
    return "-" if pd.isna(mean) else f"{mean:.0%}{interval}"


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    return program.over_the_grid(_HELP, FOLDER, argv, _compare)


def _compare(data: Path, output: Path) -> None:
    """Writes figure and numbers, and prints the table."""
    table = compare(load_variants(data))
    output.mkdir(parents=True, exist_ok=True)
    png, csv = output / f"{NAME}.png", output / f"{NAME}.csv"
    figure = draw(table)
    write_atomically(png, lambda path: figure.savefig(path, format="png", dpi=DOTS_PER_INCH))
    write_atomically(csv, lambda path: table.to_csv(path, index=False))
    print(as_text(table), png, csv, sep="\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv))
