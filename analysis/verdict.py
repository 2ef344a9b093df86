"""Does hierarchy help on a task? A verdict with an interval, from one or more run folders."""

import sys
from collections.abc import Sequence
from pathlib import Path

from absl import flags

from analysis import program
from analysis.reading import paper
from analysis.reading.results import load, read_manifest, with_updates
from analysis.verdicts import hierarchy

_HELP = """Says whether hierarchy helps: 1 and 2 subgoal layers against the strongest flat agent.

  python -m analysis.verdict runs/pick_place --flat=runs/td3/pick_place

Agents are compared seed by seed, by the area under the success curve at equal environment steps,
which decides. Also shown: the area at equal core-minutes and episodes, success in the last periods,
and the chance that a seed with subgoal layers does better than one without. --flat names run
folders of other flat agents on the same task, separated by commas: the strongest counts.

Flags:
{flags}

Exit status: 0; 2 a file to read is missing or damaged, or the command was wrong."""


def judge(folder: Path, others: Sequence[Path]) -> list[hierarchy.Verdict]:
    """The verdicts on a run folder's hierarchies; see `hierarchy.judge`.

    Args:
      others: run folders of other agents without subgoal layers on the same task.

    Raises:
      FileNotFoundError, ValueError: as `load`; or there is nothing to compare.
    """
    results = with_updates(load(folder), folder)
    tasks = sorted(set(results["task"]))
    if len(tasks) > 1:
        raise ValueError(f"{folder}: holds results of {', '.join(tasks)}; give one task's folder")
    flats = {}
    for other in others:
        rows = with_updates(load(other), other)
        if set(rows["task"]) != set(tasks):
            found = ", ".join(sorted(set(rows["task"])))
            raise ValueError(f"{other}: holds results of {found}, not of {tasks[0]}")
        flats[_name(other)] = rows[rows["subgoal_layers"] == 0]
        if not len(flats[_name(other)]):
            raise ValueError(f"{other}: holds no agent without subgoal layers")
    try:
        return hierarchy.judge(results, flats)
    except ValueError as error:
        raise ValueError(f"{folder}: {error}") from error


def _name(folder: Path) -> str:
    """What another flat agent is called: its learner, if its manifest says it."""
    config = read_manifest(folder)[0].get("config")
    learner = config.get("learner") if isinstance(config, dict) else None
    return f"{learner.upper()}, {folder}" if isinstance(learner, str) else str(folder)


def as_text(verdicts: Sequence[hierarchy.Verdict], task: str) -> str:
    """The sentences, and all that was measured as a table in Markdown."""
    lines = [f"# Does hierarchy help on {paper.title(task)}?", ""]
    lines += [f"- {verdict.sentence}" for verdict in verdicts]
    table = program.markdown_table(hierarchy.HEADINGS, hierarchy.rows(verdicts))
    return "\n".join([*lines, "", *table])


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = flags.FlagValues()
    flags.DEFINE_list("flat", [], "run folders of other flat agents on the task", values)
    words = "one run folder, such as runs/pick_place"
    this = program.Program(_HELP, values, words, wrong=program.UNREADABLE)
    return program.carry_out(this, argv, lambda words: _say(Path(words[0]), values.flat))


def _say(folder: Path, others: Sequence[str]) -> None:
    verdicts = judge(folder, [Path(other) for other in others])
    print(as_text(verdicts, verdicts[0].deciding.task))


if __name__ == "__main__":
    sys.exit(main(sys.argv))
