"""What a command tells a person whose input was wrong."""

import difflib
from collections.abc import Iterable


class CommandError(Exception):
    """The command cannot be carried out as typed; the message says what to type instead."""


def unknown(kind: str, name: str, valid: Iterable[str]) -> str:
    """As in `unknown task 'pick_plce': did you mean 'pick_place'?`; all names if none is near."""
    valid = list(valid)
    closest = difflib.get_close_matches(name, valid, n=1, cutoff=0.5)
    if closest:
        return f"unknown {kind} {name!r}: did you mean {closest[0]!r}?"
    return f"unknown {kind} {name!r}: it is one of {', '.join(valid)}"
