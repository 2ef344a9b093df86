"""Where a second subgoal layer starts to pay: the same motion, taken in more and more decisions."""

import json
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from absl import flags
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis import program
from analysis.figures.success import DOTS_PER_INCH, label_periods, look, plot_success
from analysis.reading import paper, schema
from analysis.reading.files import write_atomically
from analysis.reading.results import NoResults, load
from analysis.statistics import comparison
from analysis.statistics.seeds import success_per_period
from analysis.verdicts import evidence
from analysis.verdicts.evidence import NOT_SUPPORTED, SUPPORTED, Evidence

_HELP = """Compares 0, 1 and 2 subgoal layers where the same motion takes more and more decisions.

  python -m analysis.depth --data=runs/depth

writes depth.png, the numbers it shows (depth.csv, depth_curves.csv) and the verdicts (depth.md).
The tasks are those of tasks/families/depth.py. --data holds TASK/results.csv.

Flags:
{flags}

Exit status: 0; 2 what it is to read is not there or damaged, or the command was wrong."""

FOLDER = Path(__file__).parent / "data" / "depth"
NAME = "depth"
STUDY = {"ur5_reacher": (200, 400, 800), "pick_place": (300, 600, 1200)}
"""By motion, the numbers of decisions that it is taken in; the suite's own comes first."""
GAINS = ((1, 0), (2, 1))
"""Agents compared, by subgoal layers: the first is to gain over the second."""
SEEDS, PERIODS, RUNS = "10-19", 10, "runs/depth"

_NOTHING = (
    "{folder}: holds no results of {tasks}; `python -m analysis.depth --commands` prints what "
    "trains them, and --data says where they are"
)
_NO_PAIRS = (
    "{folder}: no seed of two agents was trained for the same number of episodes yet; "
    "--episodes=N compares over the first N episodes"
)
_NO_SUCH_TEST = (
    "{folder}: no seed of {motion} was tested after {episodes} episodes, but after {all}"
)
_CONFIGS = "{path}: is of another configuration than {other} ({names}); they cannot be compared"
_LAYERS = {1: "a first layer over none", 2: "a second layer over one"}
_PAYS, _COSTS, _UNDECIDED = "it pays", "it costs", "undecided"
_TOO_LITTLE = f"less than {evidence.MARGIN * 100:.0f} points, if anything"


def load_study(folder: Path) -> pd.DataFrame:
    """All results in `<folder>/<task>/`, with columns `motion` and `decisions`.

    Raises:
      ValueError: there are none, some are of different configurations, or as
        `analysis.reading.results.load`.
    """
    found, configs = [], {}
    for path in sorted(Path(folder).glob("*/results.csv")):
        try:
            table = load(path.parent)
        except NoResults:
            continue
        places = [_place(task) for task in table["task"]]
        if None in places:
            continue
        motions = pd.DataFrame(places, columns=["motion", "decisions"])
        found.append(pd.concat([table, motions], axis=1))
        configs[path] = _config(path.parent)
    if not found:
        raise ValueError(_NOTHING.format(folder=folder, tasks=" or ".join(STUDY)))
    _check_same(configs)
    return pd.concat(found, ignore_index=True)


def _place(task: str) -> tuple[str, int] | None:
    """Motion and decisions of a task of the study, such as depth-ur5_reacher_400."""
    named = re.fullmatch(r"(?:\w+-)?(\w+)_(\d+)", task)
    if named is None or int(named[2]) not in STUDY.get(named[1], ()):
        return None
    return named[1], int(named[2])


def _config(folder: Path) -> dict[str, Any] | None:
    """The hyperparameters in a run folder's manifest; None where there is no manifest."""
    path = folder / "manifest.json"
    return json.loads(path.read_text(encoding="utf-8"))["config"] if path.is_file() else None


def _check_same(configs: dict[Path, dict[str, Any] | None]) -> None:
    known = [(path, config) for path, config in configs.items() if config is not None]
    for path, config in known[1:]:
        other, first = known[0]
        differ = [name for name in sorted({*first, *config}) if first.get(name) != config.get(name)]
        if differ:
            names = ", ".join(differ)
            raise ValueError(_CONFIGS.format(path=path.parent, other=other.parent, names=names))


def budgets(results: pd.DataFrame, episodes: int | None, folder: Path) -> dict[str, int]:
    """By motion, the episodes over which its agents are compared: the most that a seed has.

    Args:
      episodes: compares over as many instead.

    Raises:
      ValueError: no seed was tested then.
    """
    tested = results.groupby("motion")["train_episodes"].unique()
    if episodes is None:
        return {motion: int(own.max()) for motion, own in tested.items()}
    for motion, own in tested.items():
        if episodes not in own:
            after = ", ".join(str(number) for number in sorted(own) if number)
            raise ValueError(
                _NO_SUCH_TEST.format(folder=folder, motion=motion, episodes=episodes, all=after)
            )
    return dict.fromkeys(tested.index, episodes)


def areas(results: pd.DataFrame, budget: int) -> pd.Series:
    """By seed, the area under the success curve until `budget`, as a share of the largest possible.

    Seeds that were not tested then are left out.

    Args:
      results: of one agent on one task.
      budget: training episodes.
    """
    found = {}
    for seed, own in results[results["train_episodes"] <= budget].groupby("seed"):
        if own["train_episodes"].max() == budget > 0:
            found[seed] = np.trapezoid(own["success_rate"], own["train_episodes"] / budget)
    return pd.Series(found, dtype=float)


def paired_gains(results: pd.DataFrame, new: int, old: int, budget: int) -> np.ndarray:
    """[pairs] what seeds of agent `new` gain in area over the same seeds of agent `old`."""
    layers = results["subgoal_layers"]
    gains = areas(results[layers == new], budget) - areas(results[layers == old], budget)
    return gains.dropna().to_numpy()


def compare(results: pd.DataFrame, budget: dict[str, int]) -> list[Evidence]:
    """Every gain that there are pairs of seeds for, judged; those of a motion are one family.

    Returns:
      Evidence whose `task` is as in "ur5_reacher_400" and `agents` as in "2 over 1"; `p` is that
      of flipping the signs of the pairs' gains.
    """
    judged = []
    for motion, steps in STUDY.items():
        found = []
        for decisions in steps:
            own = results[(results["motion"] == motion) & (results["decisions"] == decisions)]
            for new, old in GAINS if len(own) else ():
                gains = paired_gains(own, new, old, budget[motion])
                if len(gains):
                    found.append(_gain(f"{motion}_{decisions}", f"{new} over {old}", gains))
        judged += evidence.judge_gains(found)
    return judged


def trend(results: pd.DataFrame, motion: str, budget: int) -> str | None:
    """A sentence: how a second layer's gain changes from the fewest decisions to the most.

    None where there is only one number of decisions with pairs of seeds.
    """
    own = results[results["motion"] == motion]
    measured = {n: paired_gains(own[own["decisions"] == n], 2, 1, budget) for n in STUDY[motion]}
    found = [decisions for decisions, gains in measured.items() if len(gains)]
    if len(found) < 2:
        return None
    few, many = measured[found[0]], measured[found[-1]]
    change = Evidence(
        motion, "2 over 1", "change of gain", "points", (len(few), len(many)),
        *comparison.contrast([many, few], (1, -1)), comparison.permutation_p(many, few),
    )  # fmt: skip
    return (
        f"{motion}: from {found[0]} to {found[-1]} decisions, a second layer's gain changes by "
        f"{change.shown} (p = {change.p:.2g})."
    )


def _gain(task: str, agents: str, gains: np.ndarray) -> Evidence:
    value = comparison.contrast([gains], (1,))
    p = comparison.sign_flip_p(gains)
    return Evidence(task, agents, "gain in area", "points", (len(gains),), *value, p)


def as_table(gains: Sequence[Evidence], budget: dict[str, int]) -> pd.DataFrame:
    """What the figure's last column shows, a row for each gain; shares of the area, not points."""
    rows = []
    for item in gains:
        place = _place(item.task)
        assert place is not None  # `compare` made it
        rows.append(
            {
                "motion": place[0], "decisions": place[1], "agents": item.agents,
                "pairs": item.seeds[0], "episodes": budget[place[0]],
                "gain": item.value, "low": item.low, "high": item.high,
                "p": item.p, "p_holm": item.p_holm, "verdict": _verdict(item),
            }
        )  # fmt: skip
    return pd.DataFrame(rows)


def _verdict(item: Evidence) -> str:
    if item.verdict == NOT_SUPPORTED:
        return _COSTS if item.p_holm < evidence.ALPHA and item.value < 0 else _TOO_LITTLE
    return _PAYS if item.verdict == SUPPORTED else _UNDECIDED


def sentences(gains: Sequence[Evidence], budget: dict[str, int]) -> list[str]:
    """A sentence for each number of decisions and pair of agents, and one for each motion."""
    table, said = as_table(gains, budget), []
    for item, row in zip(gains, table.itertuples(), strict=True):
        pairs = f"{row.pairs} pair{'' if row.pairs == 1 else 's'} of seeds"
        said.append(
            f"{row.motion} in {row.decisions} decisions: {_LAYERS[int(row.agents[0])]} gains "
            f"{item.shown} of area over {row.episodes} episodes ({pairs}, p = {row.p_holm:.2g} "
            f"after Holm): {row.verdict}."
        )
    return said + [_answer(motion, own) for motion, own in table.groupby("motion", sort=False)]


def _answer(motion: str, table: pd.DataFrame) -> str:
    """From how many decisions on the second layer pays."""
    second = table[table["agents"] == "2 over 1"].sort_values("decisions")
    absent = [str(n) for n in STUDY[motion] if n not in set(second["decisions"])]
    lacking = f" Not measured: {', '.join(absent)}." if absent else ""
    if second.empty:
        return f"{motion}: no runs of a second layer to compare yet."
    start = None
    for row in second.iloc[::-1].itertuples():
        if row.verdict != _PAYS:
            break
        start = row.decisions
    if start is None:
        most = second["decisions"].max()
        return f"{motion}: a second layer is not shown to pay in {most} decisions.{lacking}"
    return f"{motion}: a second layer pays from {start} decisions on, of those measured.{lacking}"


def draw(curves: pd.DataFrame, gains: pd.DataFrame) -> Figure:
    """A row for each motion: its curves at each number of decisions, then the gains.

    Args:
      curves: `schema.FIGURE_COLUMNS` with `motion` and `decisions`.
      gains: as `as_table` makes it.
    """
    motions = [motion for motion in STUDY if motion in set(curves["motion"])]
    columns = max(len(STUDY[motion]) for motion in motions) + 1
    figure = Figure(figsize=(4.1 * columns, 3.9 * len(motions)))
    figure.set_layout_engine("constrained", w_pad=0.08, h_pad=0.08)
    grid = figure.subplots(len(motions), columns, squeeze=False)
    for motion, row in zip(motions, grid, strict=True):
        own = curves[curves["motion"] == motion]
        for ax, decisions in zip(row, STUDY[motion], strict=False):
            _plot_curves(ax, own[own["decisions"] == decisions])
            ax.set_title(f"{paper.title(motion)}, {decisions} decisions", size="medium")
        _plot_gains(row[-1], gains[gains["motion"] == motion], STUDY[motion])
        row[-1].set_title("gain in area, 95% interval over pairs of seeds", size="medium")
    return figure


def _plot_curves(ax: Axes, own: pd.DataFrame) -> None:
    if len(own):
        plot_success(ax, own, legend=False)
        label_periods(ax, own, most_ticks=6)
        ax.legend(framealpha=0.85, fontsize="small", handlelength=3.2)
    else:
        ax.text(0.5, 0.5, "no runs yet", transform=ax.transAxes, ha="center", color="#777777")
        ax.set_axis_off()


def _plot_gains(ax: Axes, gains: pd.DataFrame, steps: Sequence[int]) -> None:
    ax.axhline(0, color="#777777", linewidth=0.8)
    for shift, (new, old) in zip((-0.06, 0.06), GAINS, strict=True):
        own = gains[gains["agents"] == f"{new} over {old}"]
        x = [steps.index(decisions) + shift for decisions in own["decisions"]]
        style, points = look(new), 100 * own[["gain", "low", "high"]].to_numpy(dtype=float).T
        ax.vlines(x, points[1], points[2], color=style.colour, linewidth=2)
        ax.plot(
            x, points[0],
            color=style.colour, marker=style.marker, linestyle=style.line,
            label=f"{new} over {old} subgoal layer{'' if old == 1 else 's'}",
        )  # fmt: skip
    ax.set_xticks(range(len(steps)), [str(decisions) for decisions in steps])
    ax.set_xlim(-0.4, len(steps) - 0.6)
    ax.set_xlabel("decisions for the same motion")
    ax.set_ylabel("points of area under the success curve")
    ax.grid(axis="y", alpha=0.25, linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(framealpha=0.85, fontsize="small")


def curves_of(results: pd.DataFrame, budget: dict[str, int]) -> pd.DataFrame:
    """Success per test period until the budget: `schema.FIGURE_COLUMNS`, motion and decisions."""
    within = results[results["train_episodes"] <= results["motion"].map(budget)]
    curves = success_per_period(within)[list(schema.FIGURE_COLUMNS)]
    places = results[["task", "motion", "decisions"]].drop_duplicates()
    return curves.merge(places, on="task")


def commands() -> list[str]:
    """What trains the study's runs, a line for each task, and what compares them then."""
    trainings = [
        f"python launch/run.py --task=tasks/families/depth.py:{motion}_{decisions} --seeds={SEEDS} "
        f"--periods={PERIODS} --config=launch/configs/candidate.py --out={RUNS} --novideo"
        for motion, steps in STUDY.items()
        for decisions in steps
    ]
    return [*trainings, f"python -m analysis.depth --data={RUNS}"]


def write(folder: Path, output: Path, episodes: int | None = None) -> list[str]:
    """Writes depth.png, the numbers it shows and the verdicts; returns what is to be printed.

    Raises:
      ValueError: as `load_study` and `budgets`; or there is no pair of seeds to compare.
    """
    results = load_study(folder)
    budget = budgets(results, episodes, folder)
    gains = compare(results, budget)
    if not gains:
        raise ValueError(_NO_PAIRS.format(folder=folder))
    curves, table = curves_of(results, budget), as_table(gains, budget)
    trends = [trend(results, motion, own) for motion, own in budget.items()]
    said = [*sentences(gains, budget), *filter(None, trends)]
    figure = draw(curves, table)
    output.mkdir(parents=True, exist_ok=True)
    png, csv, of_curves = (output / f"{NAME}{end}" for end in (".png", ".csv", "_curves.csv"))
    verdicts = output / f"{NAME}.md"
    text = "".join(f"- {sentence}\n" for sentence in said)
    write_atomically(png, lambda path: figure.savefig(path, format="png", dpi=DOTS_PER_INCH))
    write_atomically(csv, lambda path: table.to_csv(path, index=False))
    write_atomically(of_curves, lambda path: curves.to_csv(path, index=False))
    write_atomically(verdicts, lambda path: path.write_text(text, encoding="utf-8"))
    return [*said, *map(str, (png, csv, of_curves, verdicts))]


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = flags.FlagValues()
    flags.DEFINE_string("data", os.path.relpath(FOLDER), "holds the results", values)
    flags.DEFINE_string("output", None, "a folder for the files; if not given, --data", values)
    program.define_count(
        values, "episodes", None, "compare over the first so many; if not given, over all", least=1
    )
    flags.DEFINE_boolean("commands", False, "only print what trains the runs", values)
    this = program.Program(_HELP, values, wrong=program.UNREADABLE)
    return program.carry_out(this, argv, lambda _: _answer_command(values))


def _answer_command(values: flags.FlagValues) -> None:
    if values.commands:
        print(*commands(), sep="\n")
        return
    output = values.data if values.output is None else values.output
    print(*write(Path(values.data), Path(output), values.episodes), sep="\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv))
