"""Plays a policy live for `launch/play.py`: in MuJoCo's own window, or on the page."""

import os
import sys
import warnings
from collections.abc import Sequence

from launch.folder import policies
from launch.jobs.local import StopSignal
from launch.viewing import serving

VIEWERS = ("auto", "window", "page")

_QUIET = b"\n"


def play(found: Sequence[policies.Found], word: str, viewer: str) -> int:
    """Plays test episodes of the first of these policies until somebody ends it.

    Args:
      found: policies of one agent.
      word: finds their task.
      viewer: one of VIEWERS.

    Returns:
      The exit status.

    Raises:
      CommandError: the policy cannot be played, or the page's extra is not installed.
    """
    with StopSignal(_QUIET) as stop:
        if viewer == "window" or (viewer == "auto" and has_display()):
            from launch.viewing import window  # it loads GLFW

            window.play(found[0], word, stop)
        else:
            serving.check()
            address = serving.Address(serving.LOOPBACK, serving.PORT)
            serving.serve(found, found[0], word=word, address=address, stop=stop)
    return 0


def has_display() -> bool:
    """Whether a window can be opened."""
    if sys.platform in ("darwin", "win32"):
        return True
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return False
    import glfw

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns of a display that does not answer
        return bool(glfw.init())
