"""The only code that prints: it escapes text from users and files, and survives closed outputs."""

import contextlib
import os
import sys
from typing import Any, cast

import rich.console
from rich.text import Text

_GONE = (
    b"nobody reads the output any more; the work goes on, `launch/status.py` says how it stands\n"
)


class Console(rich.console.Console):
    """A console without markup that survives a closed output."""

    def __init__(self, **arguments: Any) -> None:
        """Takes the arguments of rich's own."""
        arguments.setdefault("file", cast(Any, _Output()))
        super().__init__(markup=False, emoji=False, highlight=False, **arguments)

    def say(self, text: str, **arguments: Any) -> None:
        """Prints lines as they are, however long, with `repr`'s signs for what is no text."""
        self.print(Text(printable(text)), soft_wrap=True, **arguments)


def printable(text: str) -> str:
    """The text with an escape for every character that commands a terminal or is none."""
    return "".join(
        sign if sign.isprintable() or sign in "\n\t" else repr(sign)[1:-1] for sign in text
    )


class _Output:
    """The standard output as it is now, and nothing once it is closed, or takes nothing more."""

    def __init__(self) -> None:
        self._gone = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._now(), name)

    @staticmethod
    def _now() -> Any:
        # While rich draws it takes the place of the standard output, and passes on here.
        return getattr(sys.stdout, "rich_proxied_file", sys.stdout)

    def write(self, text: str) -> int:
        self._unless_gone("write", text)
        return len(text)

    def flush(self) -> None:
        self._unless_gone("flush")

    def _unless_gone(self, name: str, *arguments: Any) -> None:
        if self._gone:
            return
        try:
            getattr(self._now(), name)(*arguments)
        except UnicodeError:
            encoding = getattr(self._now(), "encoding", None) or "ascii"
            plain = [a.encode(encoding, "backslashreplace").decode(encoding) for a in arguments]
            self._unless_gone(name, *plain)
        except (AttributeError, OSError, ValueError):  # there is none; its reader left; closed
            self._gone = True
            with contextlib.suppress(OSError):
                os.write(2, _GONE)
