"""absl flags with answers fit for a person: one line, the closest name, no traceback."""

import sys
from collections.abc import Callable, Sequence
from typing import Any

from absl import flags

from launch.asking.errors import CommandError, unknown

MOST = 100_000  # of anything: what nobody means must not fill the memory


class HelpRequested(Exception):
    """--help was among the words; whoever catches this prints the help."""


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


def parse(values: flags.FlagValues, argv: Sequence[str]) -> None:
    """Gives the flags the values that `argv` states; its first item is the program.

    Raises:
      CommandError: an unknown flag, a value that a flag does not take, or a word that is no flag.
      HelpRequested: the command asks for help.
    """
    if {"--help", "-help", "-h"} & set(argv):
        raise HelpRequested
    try:
        extra = values(list(argv))[1:]
    except flags.UnrecognizedFlagError as error:
        raise CommandError(unknown("flag", error.flagname, sorted(values))) from error
    except flags.Error as error:
        raise CommandError(str(error).splitlines()[0]) from error
    if extra:
        raise CommandError(f"unexpected word {extra[0]!r}: flags are typed like --task=pick_place")


def carry_out(
    values: flags.FlagValues, argv: Sequence[str], help_text: str, work: Callable[[], None]
) -> int:
    """What a program of one step does: reads its flags, works, and answers what goes wrong.

    Args:
      help_text: what --help prints, with `{flags}` for their descriptions.
      work: called once `values` are read; raises CommandError.

    Returns:
      The exit status: 0, or 2 after a wrong command.
    """
    try:
        parse(values, argv)
        work()
    except HelpRequested:
        print(help_text.format(flags=describe(values)))
    except CommandError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def describe(values: flags.FlagValues) -> str:
    """A line for each flag: its default and what it is for."""
    lines = []
    for name in values:
        default = (values[name].default_as_str or "").strip("'")
        lines.append(f"  {f'--{name}={default}':<36}{values[name].help}")
    return "\n".join(lines)
