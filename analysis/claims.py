"""Tests every claim of the paper's section 4 on the published results."""

import dataclasses
import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from analysis import program
from analysis.reading import grid
from analysis.reading.files import write_atomically, write_text
from analysis.verdicts import hierarchy
from analysis.verdicts.evidence import ALPHA, LEAST_SEEDS, MARGIN, Claim, Evidence
from analysis.verdicts.learning_claims import CONSISTENT, STEPS_BAND, judge_learning
from analysis.verdicts.subgoal_claims import NEAR, judge_subgoals

_HELP = """Tests every claim of the paper's section 4 on the published results.

  python -m analysis.claims

writes claims.csv, claims.json and claims.md, and prints the verdicts. costs.md says what the gain
of a hierarchy is at equal environment steps, core-minutes, updates and episodes.

Flags:
{flags}

Exit status: 0; 2 a file to read is missing or damaged, or the command was wrong."""

NAME = "claims"
WHY_FILE = "claims_why.json"
"""Notes by the letter of the claim: written by hand, shown beside the verdicts."""
COSTS = "costs.md"
_ON_COSTS = """# What a hierarchy gains at equal cost

The gain in area under the success curve over the agent without subgoal layers that is the strongest
at equal cost of that kind, in points, with 95% intervals from pairs of seeds. Updates are those of
all levels, and do not depend on the machine; core-minutes do, and include tests.

Agents are compared until one seed of either has done all of its training. Between two tests, areas
follow a straight line. A star marks a gain whose sign does not depend on that, as long as
success stayed between the values of both tests. Intervals are not corrected for each other.
"""
_ON_ENDS = """
The gain in success, in points, when that amount is spent, and the share of its training that the
hierarchy has done by then:
"""

HEADINGS = ("claim", "verdict", "measured", "seeds", "quantity", "where")
COLUMNS = (
    "claim", "task", "agents", "quantity", "unit", "seeds", "value", "low", "high", "p", "p_holm",
    "verdict",
)  # fmt: skip

METHOD = (
    "Agents are named by their number of subgoal layers. The sampling unit is the seed. Intervals "
    "of means and of their differences are 95% t intervals (Welch). Those of medians and of "
    "probabilities of improvement are bootstrap intervals (BCa), which are too narrow for ten "
    "seeds. Intervals of counted seeds are exact binomial ones. An interval of zero width means "
    "that all seeds agree, not that the estimate is exact.",
    "(a) and (b) compare with the strongest agent without subgoal layers on each task: the one "
    "with a larger mean area than any other, over as many episodes as both have. Weaker ones are "
    "shown and decide nothing. Choosing the baseline by the data that it is judged on favours the "
    "baseline, so it can make a hierarchy look worse than it is.",
    "Areas and episodes to 80% end where the first seed of a task ends. A seed that never reaches "
    "80% counts as reaching it there. The p values are from a permutation test for areas, "
    "Mann-Whitney for the probability of improvement, log-rank for episodes, and sign flips for "
    "falls.",
    f"(a), (c), (e): a gain is not supported if its interval ends below {100 * MARGIN:.0f} points. "
    f"Otherwise it is supported if it is positive with p < {ALPHA} after Holm's correction over "
    "the claim's comparisons, and undecided if not. Probability of improvement and episodes are "
    "shown without correction and decide nothing. (e) counts the subgoals of training episodes, "
    "including random ones and those pursued under exploration noise. A subgoal is missed if its "
    "attempt ended without achieving it, also where the attempt was cut short.",
    f"(b): supported on a task if the share of seeds above {CONSISTENT:.0%} is below "
    f"{CONSISTENT:.0%} with p < {ALPHA} (binomial, Holm). Not supported if that share is at least "
    f"{CONSISTENT:.0%}.",
    f"(d): supported if the interval of the ratio lies within {STEPS_BAND[0]} to {STEPS_BAND[1]}, "
    "not supported if it lies outside. (f), (g): supported if the interval of the share lies above "
    "one half, not supported if below. These claims need all of their parts, so no correction is "
    f"made. In (g), near means within a rod's length, {100 * NEAR:.0f} cm.",
    f"Fewer than {LEAST_SEEDS} seeds decide nothing. A claim about every task is not supported if "
    "it is not supported on one of them.",
)


def judge(folder: Path) -> list[Claim]:
    """The paper's claims (a) to (g), judged from a folder of run folders.

    Raises:
      ValueError: none of the tasks has results, or a file is damaged.
    """
    return [
        *judge_learning(grid.load_grid(folder), grid.load_flats(folder)),
        *judge_subgoals(folder),
    ]


def table_of(claims: Sequence[Claim]) -> pd.DataFrame:
    """A row for each measured quantity, `COLUMNS`; the claim's own is in the row of task "all"."""
    rows = []
    for claim in claims:
        own = {} if claim.headline is None else _row(claim, claim.headline)
        rows.append(own | {"claim": claim.letter, "task": "all", "verdict": claim.verdict})
        rows += [_row(claim, item) for item in claim.evidence]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _row(claim: Claim, item: Evidence) -> dict[str, Any]:
    seeds = " ".join(map(str, item.seeds))
    return dataclasses.asdict(item) | {"claim": claim.letter, "seeds": seeds}


def as_markdown(claims: Sequence[Claim], why: Mapping[str, str]) -> str:
    """The claims with verdicts, reasons and our explanations; all evidence; the method."""
    lines = ["# The paper's claims, and what our runs say", ""]
    lines += program.markdown_table(HEADINGS, map(_summary, claims))
    for claim in claims:
        lines += ["", f"## ({claim.letter}) {claim.statement}", ""]
        lines += [f"**{claim.verdict.capitalize()}**: {claim.reason}.", ""]
        if claim.letter in why:
            lines += [f"Note: {why[claim.letter]}", ""]
        if claim.evidence:
            headings = ("task", "agents", "quantity", "seeds", "value", "p (Holm)", "verdict")
            lines += program.markdown_table(headings, map(_detail, claim.evidence))
    return "\n".join([*lines, "", "## How to read this", "", *(f"- {item}" for item in METHOD), ""])


def _summary(claim: Claim) -> tuple[str, ...]:
    item = claim.headline
    measured = ("-",) * 4 if item is None else (
        item.shown, _seeds(item), item.quantity, f"{item.task}: {item.agents}"
    )  # fmt: skip
    return (f"({claim.letter})", claim.verdict, *measured)


def _detail(item: Evidence) -> tuple[str, ...]:
    p = "-" if math.isnan(item.p) else f"{item.p:.2g}"
    if not math.isnan(item.p_holm):
        p += f" ({item.p_holm:.2g})"
    verdict = item.verdict or "-"
    return (item.task, item.agents, item.quantity, _seeds(item), item.shown, p, verdict)


def _seeds(item: Evidence) -> str:
    return " and ".join(map(str, item.seeds))


def _as_json(claims: Sequence[Claim], why: Mapping[str, str]) -> str:
    """Everything, for programs; NaN, which JSON does not know, as null."""
    described = [dataclasses.asdict(claim) | {"why": why.get(claim.letter)} for claim in claims]
    return json.dumps(_without_nan({"claims": described, "method": METHOD}), indent=1) + "\n"


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def costs(folder: Path) -> str:
    """A table of each task's gains from hierarchy, at equal amounts of each key of `EQUAL`.

    Tasks without a flat agent and a hierarchy are left out.

    Raises:
      ValueError: as `judge`.
    """
    flats, gains, ends = grid.load_flats(folder), [], []
    for task, results in grid.load_grid(folder).items():
        own = {name: found[task] for name, found in flats.items() if task in found}
        try:
            verdicts = hierarchy.judge(results, own)
        except hierarchy.NothingToCompareError:  # not trained yet
            continue
        gains += [(task, *row) for row in hierarchy.costs(verdicts)]
        ends += [(task, *row) for row in hierarchy.ends(verdicts)]
    headings = ("task", *hierarchy.COST_HEADINGS)
    first, second = (program.markdown_table(headings, rows) for rows in (gains, ends))
    return "\n".join([_ON_COSTS, *first, _ON_ENDS, *second, ""])


def read_why(folder: Path) -> dict[str, str]:
    """Notes by claim; none where nothing is written.

    Raises:
      ValueError: the file does not hold texts by letters.
    """
    path = folder / WHY_FILE
    if not path.exists():
        return {}
    try:
        why = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    if not isinstance(why, dict) or not all(isinstance(text, str) for text in why.values()):
        raise ValueError(f"{path}: it must map letters of claims to texts")
    return why


def write_claims(claims: Sequence[Claim], why: Mapping[str, str], output: Path) -> list[Path]:
    """Writes claims.csv, .json and .md into `output`; returns their paths."""
    output.mkdir(parents=True, exist_ok=True)
    table, described, page = (output / f"{NAME}{suffix}" for suffix in (".csv", ".json", ".md"))
    write_atomically(table, lambda path: table_of(claims).to_csv(path, index=False))
    write_text(described, _as_json(claims, why))
    write_text(page, as_markdown(claims, why))
    return [table, described, page]


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    return program.over_the_grid(_HELP, grid.FOLDER, argv, _judge)


def _judge(data: Path, output: Path) -> None:
    """Writes the files, and prints a row for each claim."""
    claims, why = judge(data), read_why(data)
    paths = write_claims(claims, why, output)
    write_text(output / COSTS, costs(data))
    for claim in claims:
        print(f"({claim.letter}) {claim.statement}\n    {claim.verdict.upper()}: {claim.reason}")
        if claim.headline is not None:
            item = claim.headline
            print(f"    {item.quantity}, {item.task}, {item.agents}: {item.shown}")
    print(*paths, output / COSTS, sep="\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv))
