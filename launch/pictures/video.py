"""Renders in a separate process. This is the parent's part: it chooses a GL backend and waits."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple

from launch.asking import start
from launch.jobs.local import StopSignal

BACKENDS = ("egl", "osmesa")
BAD_REQUEST = 3  # the renderer's exit status where a policy or flag is at fault, not the backend
REMEDY = (
    "for rendering without a display install EGL (Debian, Ubuntu: apt-get install libegl1 "
    "libegl-mesa0 libgl1-mesa-dri) or OSMesa (apt-get install libosmesa6); "
    "`python launch/doctor.py` shows what works"
)

_ROOT = Path(__file__).resolve().parents[2]
_TIMEOUT_SECONDS = 600.0  # without a frame
_POLL_SECONDS = 0.2


Tell = Callable[[int, int], None]
"""Takes how many frames are done, and of how many."""


class Look(NamedTuple):
    """How a film looks."""

    speed: float | None = None  # times real time; None: slower where it would be over too soon
    camera: str | None = None  # None: the task's first
    size: tuple[int, int] = (1280, 720)  # width, height in pixels


PLAIN = Look()


class RenderingError(Exception):
    """No picture could be made; the message says why and what to do."""


def render(
    policies: Sequence[Path],
    output: Path,
    *,
    episodes: int = 1,
    look: Look = PLAIN,
    backends: Sequence[str] = BACKENDS,
    stop: StopSignal | None = None,
    task: str | None = None,
    tell: Tell | None = None,
) -> list[str]:
    """Renders test episodes of a policy into `output`: a film (.mp4) or a strip of frames (.png).

    Args:
      policies: their paths without a suffix. The first one that succeeds in a test episode is
        shown; if none does, the first.
      episodes: how many a film shows, successful ones first.
      backends: values of MUJOCO_GL, tried in turn.
      stop: ends the rendering when set.
      task: the word that finds theirs, which one in a file of one's own needs: the renderer runs
        that file. What the policies' own files say runs nothing.
      tell: called as frames are done.

    Returns:
      What the user should know: which backend was fallen back to, and why.

    Raises:
      RenderingError: no backend works, a policy is bad, the file cannot be written, or the
        rendering was stopped; `output` is untouched.
    """
    request = film(policies, output, episodes=episodes, look=look, task=task)
    return _render(request, backends, stop, tell)


def film(
    policies: Sequence[Path],
    output: Path,
    *,
    episodes: int = 1,
    look: Look = PLAIN,
    task: str | None = None,
) -> dict[str, Any]:
    """What `launch.films.rendering` is asked for by `render`, which says what the arguments are."""
    return {"columns": [], "episodes": episodes, **_common(policies, output, look, task)}


def render_side_by_side(
    policies: Sequence[Path],
    names: Sequence[str],
    output: Path,
    *,
    seed: int,
    said: str,
    most_bytes: int,
    look: Look = PLAIN,
    task: str | None = None,
    tell: Tell | None = None,
) -> list[str]:
    """Renders the same test episode of several policies into one film, animated WebP or GIF.

    Args:
      names: what each policy is called.
      seed: of the episode: all begin from its start.
      said: of all of them, above them.
      most_bytes: that a WebP or GIF may take.

    Returns, Raises:
      As `render`.
    """
    request = {"columns": list(names), "seed": seed, "said": said, "most_bytes": most_bytes}
    return _render({**request, **_common(policies, output, look, task)}, BACKENDS, None, tell)


def _common(policies: Sequence[Path], output: Path, look: Look, task: str | None) -> dict[str, Any]:
    return {
        "task": task,
        "films": [str(policy) for policy in policies],
        "output": str(output),
        **look._asdict(),
    }


def _render(
    request: dict[str, Any],
    backends: Sequence[str],
    stop: StopSignal | None,
    tell: Tell | None,
) -> list[str]:
    """Tries one backend after the other."""
    problems: list[str] = []
    for backend in backends:
        problem = run_renderer(backend, json.dumps(request), stop=stop, tell=tell)
        if problem is None:
            if problems:
                return [f"note: rendered with {backend}, since {'; '.join(problems)}"]
            return []
        problems.append(f"{backend}: {problem}")
    raise RenderingError(f"{'; '.join(problems)}\n  {REMEDY}")


def run_renderer(
    backend: str,
    argument: str,
    *,
    timeout: float = _TIMEOUT_SECONDS,
    stop: StopSignal | None = None,
    tell: Tell | None = None,
) -> str | None:
    """Runs `launch.films.rendering ARGUMENT` with this backend; None, or why it failed.

    Raises:
      RenderingError: no other backend would do better: a policy is bad, or `stop` is set.
    """
    if stop is not None and stop.number is not None:
        raise RenderingError("stopped")
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as printed:
        with _started(backend, argument, printed) as process:
            frames = _Frames(process, tell)
            while True:
                try:
                    process.wait(_POLL_SECONDS)
                    break
                except subprocess.TimeoutExpired:
                    if stop is not None and stop.number is not None:
                        raise RenderingError("stopped") from None
                    if time.monotonic() > frames.last + timeout:
                        return f"gave no result within {timeout:.0f} s"
                finally:
                    frames.hear()
        printed.seek(0)
        reason = _reason(process.returncode, printed.read())
    if process.returncode == BAD_REQUEST:
        raise RenderingError(reason)
    return None if process.returncode == 0 else reason


def _started(
    backend: str, argument: str, printed: IO[str]
) -> contextlib.AbstractContextManager[subprocess.Popen[str]]:
    environment = {**os.environ, "MUJOCO_GL": backend, "PYOPENGL_PLATFORM": backend}
    path = [str(_ROOT), os.environ.get("PYTHONPATH", "")]
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, path))
    command = [sys.executable, "-m", "launch.films.rendering", argument]
    return start.child(command, environment, stdout=subprocess.PIPE, stderr=printed)


class _Frames:
    """What a renderer prints of its frames, heard on a thread and told on the caller's.

    Attributes:
      last: when the renderer began, or was last heard of.
    """

    def __init__(self, process: subprocess.Popen, tell: Tell | None):
        self._process, self._tell = process, tell
        self.last = time.monotonic()
        self._newest: tuple[int, int] | None = None
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        for line in self._process.stdout or ():
            words = line.split()
            if len(words) == 2 and all(word.isdecimal() for word in words):
                self._newest = int(words[0]), int(words[1])
                self.last = time.monotonic()

    def hear(self) -> None:
        """Tells of the newest frame."""
        newest, self._newest = self._newest, None
        if newest and self._tell:
            self._tell(*newest)


def _reason(status: int, printed: str) -> str:
    if status < 0:
        return f"the renderer was killed by {signal.Signals(-status).name}"
    lines = [line for line in printed.strip().splitlines() if line.strip()]
    return lines[-1].strip() if lines else f"the renderer ended with status {status}"
