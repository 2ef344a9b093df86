"""Compares the best trial of each study with its first ones, and shows what mattered."""

import sys
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from analysis import program
from analysis.figures.success import save_png
from analysis.figures.tuning import draw
from analysis.reading.files import write_atomically
from analysis.statistics.tuning import LEAST_TRIALS, Spread, Study, Trial, read

_HELP = """Compares each tuning study's best trial with its first ones, and shows what mattered.

  python -m analysis.tuning --data=analysis/data/tuning

writes tuning.png, and tuning.csv with a row for each trial, and prints a table for each study.
`python launch/tune.py` makes the journals that --data holds.

Flags:
{flags}

Exit status: 0; 2 a file to read is missing or damaged, or the command was wrong."""
FOLDER = Path(__file__).parent / "data" / "tuning"
NAME = "tuning"


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
        lines += ["", f"Importances need {LEAST_TRIALS} trials that differ in worth."]
    return lines


def _short(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    return program.over_the_grid(_HELP, FOLDER, argv, _report)


def _report(data: Path, output: Path) -> None:
    """Writes figure and numbers, and prints the tables."""
    studies = read(data)
    output.mkdir(parents=True, exist_ok=True)
    png, csv = output / f"{NAME}.png", output / f"{NAME}.csv"
    figure = draw(studies)
    write_atomically(png, lambda path: save_png(figure, path))
    write_atomically(csv, lambda path: table(studies).to_csv(path, index=False))
    print(*map(as_text, studies), f"{png}\n{csv}", sep="\n\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv))
