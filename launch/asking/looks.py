"""Flags for the look of a video, and progress while it is rendered."""

import contextlib
import re
import sys
import time
from collections.abc import Callable, Iterator

from absl import flags

from analysis.program import CommandError

_SMALLEST, _LARGEST = 160, 3840  # pixels
_SECONDS_BETWEEN_LINES = 10.0  # where what is printed goes to a file


def define(values: flags.FlagValues, size: str) -> None:
    """Adds --speed, --camera and --size, which is `size` if not given."""
    flags.DEFINE_float(
        "speed",
        None,
        "playback speed, 1 is real time; default: slow motion if a video would last less than 5 s",
        lower_bound=0.001,
        upper_bound=1000.0,
        flag_values=values,
    )
    flags.DEFINE_string(
        "camera", None, "camera of a video or strip; default: the task's first", values
    )
    flags.DEFINE_string("size", size, "WIDTHxHEIGHT of the picture in pixels", values)


def size(word: str) -> tuple[int, int]:
    """The width and height that --size names; even, since films need that.

    Raises:
      CommandError: it names none, or what nobody can watch.
    """
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", word)
    sides = (int(found[1]), int(found[2])) if found else (0, 0)
    if not all(_SMALLEST <= side <= _LARGEST and side % 2 == 0 for side in sides):
        raise CommandError(
            f"flag --size={word}: give WIDTHxHEIGHT, even numbers from {_SMALLEST} to {_LARGEST}, "
            "as in 1280x720"
        )
    return sides


@contextlib.contextmanager
def telling() -> Iterator[Callable[[int, int], None]]:
    """What prints how far a rendering is: a line that counts up, or a line now and then."""
    live, last = sys.stderr.isatty(), time.monotonic()
    began = False

    def tell(done: int, count: int) -> None:
        nonlocal last, began
        if live:
            began = True
            print(f"\rrendering: frame {done} of {count}", end="", file=sys.stderr, flush=True)
        elif time.monotonic() - last >= _SECONDS_BETWEEN_LINES:
            last = time.monotonic()
            print(f"rendering: frame {done} of {count}", file=sys.stderr, flush=True)

    try:
        yield tell
    finally:
        if began:
            print(file=sys.stderr)
