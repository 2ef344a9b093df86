"""Shared by all programs here and in launch: flags, --help, one error line, an exit status."""

import difflib
import os
import sys
import textwrap
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from absl import flags

MOST = 100_000  # of anything: what nobody means must not fill the memory
_WIDTH, _COLUMN = 100, 38  # of a help text; where its right column begins
_HELP_FLAGS = {"--help", "-help", "-h"}
_INTERRUPTED = 128 + 2  # SIGINT


class CommandError(Exception):
    """The command cannot be carried out as typed; the message says what to type instead.

    It is one line, whatever characters are in the words and files that it quotes.
    """

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


def printable(said: str) -> str:
    """Text from users or files, with unprintable characters escaped."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in said)


WRONG: tuple[type[Exception], ...] = (CommandError,)
"""What a program raises where the command was wrong."""
UNREADABLE = (CommandError, OSError, ValueError)
"""The same of a program that only reads: it was told to read the wrong files."""


class HelpRequested(Exception):
    """The command asks for --help; the handler prints it."""


class Program(NamedTuple):
    """A program's help, flags and other arguments."""

    help_text: str  # what --help prints, with `{flags}` for a line for each flag
    flags: flags.FlagValues
    words: str = ""  # what the words that are no flags name; "": it takes none
    several_words: bool = False  # rather than one
    wrong: tuple[type[Exception], ...] = WRONG


def carry_out(program: Program, argv: Sequence[str], work: Callable[[list[str]], object]) -> int:
    """Reads the words of the command into the program's flags, and works.

    Args:
      argv: the command's words; the first is the program.
      work: called with the words that are no flags. Returns the exit status, if it is not 0.

    Returns:
      The exit status, as `answer` says.
    """

    def read_and_work() -> int:
        words = parse(program.flags, argv, program.words)
        if program.words and not (words and (program.several_words or len(words) == 1)):
            raise CommandError(f"it takes {program.words}")
        status = work(words)
        return status if isinstance(status, int) else 0

    return answer(read_and_work, lambda: help_of(program), program.wrong)


def answer(
    work: Callable[[], int],
    help_text: Callable[[], str],
    wrong: tuple[type[Exception], ...] = WRONG,
) -> int:
    """Calls `work`; prints the help if asked for, and one line if something goes wrong.

    Args:
      wrong: kinds of exceptions that mean that the command was wrong.

    Returns:
      The exit status: that of `work`; 2 after a wrong command; 1 after another failure, such as a
      full disk; 130 after Ctrl-C.
    """
    try:
        return work()
    except HelpRequested:
        print(help_text())
        return 0
    except wrong as error:
        _complain(error)
        return 2
    except OSError as error:
        _complain(f"{error}; finished results are kept")
        return 1
    except KeyboardInterrupt:
        _complain("interrupted; finished results are kept")
        return _INTERRUPTED


def _complain(said: object) -> None:
    print(f"error: {printable(str(said))}", file=sys.stderr)


def help_of(program: Program) -> str:
    """What --help prints."""
    return program.help_text.format(flags=describe(program.flags))


def parse(values: flags.FlagValues, argv: Sequence[str], words: str = "") -> list[str]:
    """Gives the flags the values that `argv` states; its first item is the program.

    Args:
      words: what words that are no flags name; "": there are to be none.

    Returns:
      The words that are no flags.

    Raises:
      CommandError: an unknown flag, a value that a flag does not take, or a word that is no flag.
      HelpRequested: the command asks for help.
    """
    if _HELP_FLAGS & set(argv):
        raise HelpRequested
    values.set_gnu_getopt(True)  # flags are flags after words as well
    try:
        extra = list(values(list(argv))[1:])
    except flags.UnrecognizedFlagError as error:
        raise CommandError(unknown("flag", error.flagname, sorted(values))) from error
    except (flags.Error, ValueError) as error:  # a switch that is given a value is the latter
        raise CommandError(str(error).splitlines()[0]) from error
    if extra and not words:
        raise CommandError(f"unexpected word {extra[0]!r}: flags are typed like --task=pick_place")
    return extra


def describe(values: flags.FlagValues) -> str:
    """Each flag, its default and what it is for, in two columns."""
    lines = []
    for name in values:
        default = (values[name].default_as_str or "").strip("'")
        said = textwrap.wrap(values[name].help, _WIDTH - _COLUMN) or [""]
        lines += _in_columns(f"  --{name}={default}", said)
    return "\n".join(lines) or "  none"


def _in_columns(left: str, right: Sequence[str]) -> list[str]:
    """The left text beside the right lines; above them where it is too long."""
    if len(left) + 2 > _COLUMN:
        return [left, *(" " * _COLUMN + line for line in right)]
    return [f"{left:<{_COLUMN}}{right[0]}", *(" " * _COLUMN + line for line in right[1:])]


def unknown(kind: str, name: str, valid: Iterable[str]) -> str:
    """As in `unknown task 'pick_plce': did you mean 'pick_place'?`; all names if none is near."""
    valid = list(valid)
    closest = difflib.get_close_matches(name, valid, n=1, cutoff=0.5)
    if closest:
        return f"unknown {kind} {name!r}: did you mean {closest[0]!r}?"
    if not valid:
        return f"unknown {kind} {name!r}: there is none but --help"
    return f"unknown {kind} {name!r}: it is one of {', '.join(valid)}"


class _WholeNumber(flags.IntegerParser):
    def convert(self, argument: Any) -> int:
        try:
            return int(argument)
        except (TypeError, ValueError):
            raise ValueError("it takes a whole number") from None


def define_count(
    values: flags.FlagValues,
    name: str,
    default: int | None,
    description: str,
    *,
    least: int,
    most: int = MOST,
) -> None:
    """Defines a flag that takes a whole number from `least` to `most`."""
    parser = _WholeNumber(lower_bound=least, upper_bound=most)
    flags.DEFINE(parser, name, default, description, values, flags.ArgumentSerializer())


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """The lines of a table in Markdown."""
    lines = [tuple(headings), ("---",) * len(headings), *rows]
    return [f"| {' | '.join(map(str, cells))} |" for cells in lines]


def over_results(help_text: str, argv: Sequence[str], work: Callable[[list[str]], object]) -> int:
    """Carries out a command whose words are run folders or results, for `work` to read."""
    words = "run folders or results.csv files, such as runs/pick_place"
    program = Program(help_text, flags.FlagValues(), words, several_words=True, wrong=UNREADABLE)
    return carry_out(program, argv, work)


def over_a_folder(help_text: str, argv: Sequence[str], work: Callable[[Path], object]) -> int:
    """Carries out a command whose one word is the run folder to `work` on."""
    words = "one run folder, such as runs/pick_place"
    program = Program(help_text, flags.FlagValues(), words, wrong=UNREADABLE)
    return carry_out(program, argv, lambda words: work(Path(words[0])))


def over_the_grid(
    help_text: str, data: Path, argv: Sequence[str], work: Callable[[Path, Path], object]
) -> int:
    """Carries out a command that reads results below --data and writes into --output.

    Args:
      data: what --data is if it is not given.
      work: called with both folders.
    """
    values = flags.FlagValues()
    flags.DEFINE_string("data", os.path.relpath(data), "holds the results", values)
    flags.DEFINE_string("output", None, "folder for the files; default: --data", values)
    program = Program(help_text, values, wrong=UNREADABLE)

    def read_and_write(_: list[str]) -> object:
        output = values.data if values.output is None else values.output
        return work(Path(values.data), Path(output))

    return carry_out(program, argv, read_and_write)
