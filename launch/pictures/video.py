"""Renders in a process of its own: the parent's part, which chooses a GL backend and waits."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from launch.asking import start
from launch.jobs.local import StopSignal

BACKENDS = ("egl", "osmesa")
BAD_POLICY = 3  # the renderer's exit status where the policy is at fault, not the backend
REMEDY = (
    "for rendering without a display install EGL (Debian, Ubuntu: apt-get install libegl1 "
    "libegl-mesa0 libgl1-mesa-dri) or OSMesa (apt-get install libosmesa6); "
    "`python launch/doctor.py` shows what works"
)

_ROOT = Path(__file__).resolve().parents[2]
_TIMEOUT_SECONDS = 600.0
_POLL_SECONDS = 0.2


class RenderingError(Exception):
    """No picture could be made; the message says why and what to do."""


def render(
    policies: Sequence[Path],
    output: Path,
    *,
    episodes: int = 2,
    backends: Sequence[str] = BACKENDS,
    stop: StopSignal | None = None,
    task: str | None = None,
) -> list[str]:
    """Renders test episodes of a policy into `output`: a video (.mp4) or a strip of frames (.png).

    Args:
      policies: their paths without a suffix. The first one that succeeds in a test episode is
        shown; if none does, the first.
      episodes: how many a video shows, successful ones first.
      backends: values of MUJOCO_GL, tried in turn.
      stop: ends the rendering when set.
      task: the word that finds theirs, which one in a file of one's own needs: the renderer runs
        that file. What the policies' own files say runs nothing.

    Returns:
      What the user should know: which backend was fallen back to, and why.

    Raises:
      RenderingError: no backend works, a policy is bad, the file cannot be written, or the
        rendering was stopped; `output` is untouched.
    """
    request = {
        "task": task,
        "policies": [str(policy) for policy in policies],
        "output": str(output),
        "episodes": episodes,
    }
    problems: list[str] = []
    for backend in backends:
        problem = run_renderer(backend, json.dumps(request), stop=stop)
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
) -> str | None:
    """Runs `launch.pictures.rendering ARGUMENT` with this backend; None, or why it failed.

    Raises:
      RenderingError: no other backend would do better: a policy is bad, or `stop` is set.
    """
    if stop is not None and stop.number is not None:
        raise RenderingError("stopped")
    environment = {**os.environ, "MUJOCO_GL": backend, "PYOPENGL_PLATFORM": backend}
    path = [str(_ROOT), os.environ.get("PYTHONPATH", "")]
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, path))
    command = [sys.executable, "-m", "launch.pictures.rendering", argument]
    end = time.monotonic() + timeout
    with start.child(command, environment) as process:
        while True:
            try:
                _, printed = process.communicate(timeout=_POLL_SECONDS)
                break
            except subprocess.TimeoutExpired:
                if stop is not None and stop.number is not None:
                    raise RenderingError("stopped") from None
                if time.monotonic() > end:
                    return f"gave no result within {timeout:.0f} s"
    if process.returncode == BAD_POLICY:
        raise RenderingError(_reason(process.returncode, printed))
    return None if process.returncode == 0 else _reason(process.returncode, printed)


def _reason(status: int, printed: str) -> str:
    if status < 0:
        return f"the renderer was killed by {signal.Signals(-status).name}"
    lines = [line for line in printed.strip().splitlines() if line.strip()]
    return lines[-1].strip() if lines else f"the renderer ended with status {status}"
