"""What tuning found: the best of each study beside what it began with, and what mattered."""

import importlib.util
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from analysis import program
from analysis.figures.success import DOTS_PER_INCH
from analysis.reading import paper
from analysis.reading.files import write_atomically

_HELP = """Sets the best trial of each tuning study beside its first ones, and says what mattered.

  python -m analysis.tuning --data=analysis/data/tuning

writes tuning.png, and tuning.csv with a row for each trial, and prints a table for each study.
`python launch/tune.py` makes the journals that --data holds.

Flags:
{flags}

Exit status: 0; 2 what it is to read is not there or damaged, or the command was wrong."""

FOLDER = Path(__file__).parent / "data" / "tuning"
NAME = "tuning"
SHUFFLES = 200
_LEAST_TRIALS = 8  # complete or pruned, for an importance to say anything
_TOP = 0.25  # importance is for being among this share of the trials
_NOTHING = "{folder}: holds no journal of trials; `python launch/tune.py` makes some"
_NO_OPTUNA = (
    "journals are read with optuna, which is not installed; in the repository's folder, "
    "`python -m pip install -c constraints.txt -e '.[tune]'` adds it"
)
_BLUE, _ORANGE, _GREY = "#1558c0", "#c05a15", "#777777"


class Spread(NamedTuple):
    """A mean over seeds and its standard error (NaN for one seed)."""

    mean: float
    error: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        error = float(stats.sem(values)) if len(values) > 1 else float("nan")
        return cls(float(np.mean(values)), error)

    def text(self, scale: float = 1.0, digits: int = 3) -> str:
        error = "" if np.isnan(self.error) else f" ± {scale * self.error:.{digits}f}"
        return f"{scale * self.mean:.{digits}f}{error}"


class Trial(NamedTuple):
    """A trial as its journal has it."""

    number: int
    state: str  # complete, pruned, fail, running, waiting
    label: str | None  # default, candidate, ...: what the study began with
    value: float  # the objective; NaN for one that is not complete
    params: Mapping[str, Any]
    cpu_hours: float
    spent: float  # core-hours of the study when it ended
    seeds: Mapping[str, float]  # the objective of each, of complete trials
    final: tuple[float, ...]  # each seed's success at its last test, mean over tasks
    minutes: float  # core-minutes for each seed and task
    last: float  # the mean success that it reported last


class Study(NamedTuple):
    """A journal: trials in the order in which they ended, those that have not come last."""

    name: str
    asked: Mapping[str, Any]  # tasks, subgoal_layers, seeds, periods, ...
    hours: float  # its budget
    trials: tuple[Trial, ...]
    importance: Mapping[str, "Importance"]  # the greatest first; none from too few trials

    @property
    def complete(self) -> list[Trial]:
        return [trial for trial in self.trials if trial.state == "complete"]

    @property
    def best(self) -> Trial | None:
        return max(self.complete, key=lambda trial: trial.value, default=None)

    @property
    def title(self) -> str:
        learner = f", {self.asked['learner']}" if self.asked.get("learner") else ""
        names = " + ".join(paper.title(task) for task in self.asked["tasks"])
        return f"{names}, {paper.agent_name(self.asked['subgoal_layers'])}{learner}"

    def started_with(self) -> list[Trial]:
        """The complete trials that have labels, the latest of each."""
        return list({t.label: t for t in self.complete if t.label}.values())


class Importance(NamedTuple):
    """How much a parameter decides whether a trial is among the best, and what chance gives."""

    share: float  # of all parameters' importance
    noise: float  # the share that 95% of shuffled studies stay below
    p: float  # the share of shuffled studies that give as much


def read(folder: Path) -> list[Study]:
    """The studies of all journals in a folder.

    Raises:
      ValueError: there are none, optuna is missing, or a file is no journal.
    """
    paths = sorted(Path(folder).glob("*.journal"))
    if not paths:
        raise ValueError(_NOTHING.format(folder=folder))
    if importlib.util.find_spec("optuna") is None:
        raise ValueError(_NO_OPTUNA)
    return [_study(path) for path in paths]


def _study(path: Path) -> Study:
    import optuna
    from optuna.storages.journal import JournalFileBackend, JournalStorage

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    try:
        storage = JournalStorage(JournalFileBackend(str(path)))
        found = optuna.load_study(study_name=None, storage=storage)
        asked, hours = found.user_attrs["asked"], float(found.user_attrs["hours"])
        trials = _trials(found.get_trials(deepcopy=False))
    except (ValueError, KeyError, AttributeError, TypeError) as error:
        raise ValueError(f"{path} is no journal of trials: {error}") from error
    return Study(path.stem, asked, hours, trials, _importance(found))


def _trials(frozen: Sequence[Any]) -> tuple[Trial, ...]:
    def ended(trial: Any) -> tuple[bool, float]:
        when = trial.datetime_complete
        return (when is None, when.timestamp() if when else trial.number)

    trials, spent = [], 0.0
    for trial in sorted(frozen, key=ended):
        hours = trial.user_attrs.get("cpu_seconds", 0.0) / 3600
        spent += hours
        curves = trial.user_attrs.get("curves", {}).values()
        tested = [curve for curve in curves if curve["success"]]
        trials.append(
            Trial(
                trial.number,
                trial.state.name.lower(),
                trial.user_attrs.get("label"),
                float("nan") if trial.values is None else trial.value,
                {name: trial.params[name] for name in trial.params},
                hours,
                spent,
                trial.user_attrs.get("objectives", {}),
                tuple(np.mean([c["success"][-1] for c in tested], axis=0)) if tested else (),
                float(np.mean([c["minutes"][-1] for c in tested])) if tested else float("nan"),
                max(trial.intermediate_values.items(), default=(0, float("nan")))[1],
            )
        )
    return tuple(trials)


def _importance(study: Any, shuffles: int = SHUFFLES) -> dict[str, Importance]:
    """PED-ANOVA (Watanabe et al. 2023): what sets the best of complete and pruned trials apart.

    Pruned trials count as worse than complete ones, and the less the earlier they were pruned:
    without them, what a study has learnt to avoid would look unimportant. With a few dozen trials
    some parameter always looks important. What shuffled trials give is how important it looks where
    nothing matters.
    """
    from optuna.trial import TrialState

    tested = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.PRUNED))
    values = _ranks(tested)
    if len(values) < _LEAST_TRIALS or np.ptp(values) == 0:
        return {}
    random = np.random.default_rng(0)
    found = _shares(tested, values)
    chance = [_shares(tested, random.permutation(values)) for _ in range(shuffles)]
    return {name: _beside_chance(share, [c[name] for c in chance]) for name, share in found.items()}


def _ranks(tested: Sequence[Any]) -> np.ndarray:
    """Places of trials, the best last: pruned ones, by period and success, before complete ones."""

    def worth(trial: Any) -> tuple[bool, int, float]:
        if trial.values is not None and trial.state.name == "COMPLETE":
            return (True, 0, trial.value)
        return (False, *max(trial.intermediate_values.items()))

    found = [worth(trial) for trial in tested]
    order = sorted(set(found))
    return np.array([order.index(one) for one in found], float)


def _shares(tested: Sequence[Any], values: np.ndarray) -> dict[str, float]:
    """Each parameter's share of the importance, were the trials worth these values."""
    import optuna
    from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances

    study = optuna.create_study(direction="maximize")
    study.add_trials(
        optuna.create_trial(params=t.params, distributions=t.distributions, value=float(value))
        for t, value in zip(tested, values, strict=True)
    )
    return get_param_importances(study, evaluator=PedAnovaImportanceEvaluator(target_quantile=_TOP))


def _beside_chance(share: float, chance: Sequence[float]) -> Importance:
    as_much = 1 + sum(other >= share for other in chance)
    return Importance(share, float(np.quantile(chance, 0.95)), as_much / (1 + len(chance)))


def table(studies: Sequence[Study]) -> pd.DataFrame:
    """A row for each trial that has begun: its state, cost, worth and parameters."""
    rows = [
        {
            "study": study.name,
            "trial": trial.number,
            "label": trial.label,
            "state": trial.state,
            "core_hours": trial.cpu_hours,
            "objective": trial.value,
            "objective_error": Spread.of(list(trial.seeds.values())).error if trial.seeds else None,
            "final_success": Spread.of(trial.final).mean if trial.final else None,
            "final_error": Spread.of(trial.final).error if trial.final else None,
            "core_minutes_a_seed": trial.minutes,
            **trial.params,
        }
        for study in studies
        for trial in sorted(study.trials, key=lambda trial: trial.number)
        if trial.state != "waiting"
    ]
    return pd.DataFrame(rows)


def as_text(study: Study) -> str:
    """A study in Markdown: what was spent, the best beside the first, and the parameters."""
    counts = pd.Series([trial.state for trial in study.trials]).value_counts()
    said = ", ".join(f"{count} {state}" for state, count in counts.items())
    hours = sum(trial.cpu_hours for trial in study.trials)
    seeds = ", ".join(map(str, study.asked["seeds"]))
    lines = [
        f"## {study.title}",
        f"{len(study.trials)} trials ({said}); {hours:.2f} of {study.hours:g} core-hours; "
        f"seeds {seeds}; {study.asked['periods']} periods",
    ]
    best = study.best
    if best is None:
        return "\n".join([*lines, "no trial is complete"])
    shown = {trial.number: trial for trial in (*study.started_with(), best)}.values()
    lines += ["", *_worth(study, list(shown), best), "", *_settings(study, list(shown), best)]
    return "\n".join(lines)


def _worth(study: Study, shown: Sequence[Trial], best: Trial) -> list[str]:
    lines = [
        "| trial | objective | the best's gain on it | last test, % | core-minutes a seed |",
        "|---" * 5 + "|",
    ]
    for trial in shown:
        own = Spread.of(list(trial.seeds.values())).text()
        gain = "-" if trial is best else _gain(best, trial).text()
        final = Spread.of(trial.final).text(100, 0)
        lines.append(f"| {_name(trial, best)} | {own} | {gain} | {final} | {trial.minutes:.2f} |")
    count = len(study.complete)
    lines += [
        "",
        f"Means over seeds ± their standard errors; gains are seed by seed. The best of {count} "
        "trials owes some of its lead to having been chosen: other seeds show what is left.",
    ]
    return lines


def _gain(best: Trial, other: Trial) -> Spread:
    return Spread.of([best.seeds[seed] - other.seeds[seed] for seed in best.seeds])


def _name(trial: Trial, best: Trial) -> str:
    label = f" ({trial.label})" if trial.label else ""
    return f"{trial.number}{label}{', the best' if trial is best else ''}"


def _settings(study: Study, shown: Sequence[Trial], best: Trial) -> list[str]:
    head = " | ".join(_name(trial, best) for trial in shown)
    lines = [
        f"| parameter | {head} | importance | by chance | p |",
        "|---" * (4 + len(shown)) + "|",
    ]
    for name in [*study.importance, *(n for n in best.params if n not in study.importance)]:
        values = " | ".join(_short(trial.params.get(name)) for trial in shown)
        found = study.importance.get(name)
        weight = (
            f"{found.share:.2f} | < {found.noise:.2f} | {found.p:.2f}" if found else "- | - | -"
        )
        lines.append(f"| {name} | {values} | {weight} |")
    if not study.importance:
        lines += ["", f"Importances need {_LEAST_TRIALS} trials that differ in worth."]
    return lines


def _short(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


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
        ax.text(0.5, 0.5, f"fewer than {_LEAST_TRIALS} trials", ha="center", color=_GREY)
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
    ax.set_xlabel(f"importance for the best {_TOP:.0%} of trials")
    ax.legend(loc="lower right", fontsize="x-small", framealpha=0.85)


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    return program.over_the_grid(_HELP, FOLDER, argv, _report)


def _report(data: Path, output: Path) -> None:
    """Writes figure and numbers, and prints the tables."""
    studies = read(data)
    output.mkdir(parents=True, exist_ok=True)
    png, csv = output / f"{NAME}.png", output / f"{NAME}.csv"
    figure = draw(studies)
    write_atomically(png, lambda path: figure.savefig(path, format="png", dpi=DOTS_PER_INCH))
    write_atomically(csv, lambda path: table(studies).to_csv(path, index=False))
    print(*map(as_text, studies), f"{png}\n{csv}", sep="\n\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv))
