"""Writes a task for a model: `python launch/new_task.py NAME MODEL.xml`."""

import ast
import keyword
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from absl import flags

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

    from launch.asking import start

    start.without_display()

import tasks
from analysis import program
from analysis.program import CommandError
from analysis.reading.files import write_text
from tasks.authoring.beginning import begin

_HELP = """Writes a task for an MJCF model: move a point of the model to places that it can reach.

  python launch/new_task.py arm_reach path/to/arm.xml
  python launch/check_task.py arm_reach.py:arm_reach
  python launch/run.py --task=arm_reach.py:arm_reach

It writes NAME.xml, the model with sensors, a camera and a light added if it has none, and NAME.py,
a task that works as it is and that you can edit.

Flags:
{flags}

Exit status: 0 both are written; 2 the command was wrong, or the model cannot be used."""


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = flags.FlagValues()
    flags.DEFINE_string(
        "point", None, "site or body that moves to the goal; default: the end of the chain", values
    )
    flags.DEFINE_boolean("overwrite", False, "overwrite existing files", values)
    what = "a name and a model, as in arm_reach path/to/arm.xml"
    own = program.Program(_HELP, values, words=what, several_words=True)
    return program.carry_out(own, argv, lambda words: _new(words, values))


def _names_of(code: str) -> set[str]:
    """The names that a task file uses, but for those that it defines."""
    nodes = list(ast.walk(ast.parse(code)))
    imported = {own.asname or own.name for node in nodes for own in getattr(node, "names", ())
                if isinstance(own, ast.alias)}  # fmt: skip
    return imported | {node.id for node in nodes if isinstance(node, ast.Name)}


def _new(words: list[str], values: flags.FlagValues) -> int:
    if len(words) != 2:
        raise CommandError("give a name and a model, as in arm_reach path/to/arm.xml")
    name, model = words[0], Path(words[1])
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        fit = re.sub(r"\W", "_", name.lower(), flags=re.ASCII).strip("_0123456789") or "my_task"
        raise CommandError(
            f"{name!r}: a task's name has lower-case letters, digits and _, such as {fit!r}"
        )
    if keyword.iskeyword(name):
        raise CommandError(f"{name!r} is a word of Python; choose another name")
    if name in tasks.ALL:
        raise CommandError(f"{name!r} is a task of the suite; choose another name")
    if not model.is_file():
        raise CommandError(f"there is no model {str(model)!r}")
    targets = Path(f"{name}.py"), Path(f"{name}.xml")
    for target in targets:
        if target.exists() and not values.overwrite:
            raise CommandError(f"{target} exists already; add --overwrite to replace it")
    try:
        begun = begin(name, model, values.point)
    except ValueError as error:
        raise CommandError(str(error)) from error
    if name in _names_of(begun.code):
        raise CommandError(f"{name!r} is a name that the file itself uses; choose another")
    for target, text in zip(targets, (begun.code, begun.xml), strict=True):
        write_text(target, text)
    for note in begun.notes:
        print(f"note: {note}")
    print(f"{targets[0]}, {targets[1]}: next\n  python launch/check_task.py {targets[0]}:{name}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
