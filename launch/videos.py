"""Renders in a process of its own: the parent's part, which chooses a GL backend and waits."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from launch.execution import StopSignal

BACKENDS = ("egl", "osmesa")
REMEDY = (
    "for rendering without a display install EGL (Debian, Ubuntu: apt-get install libegl1 "
    "libegl-mesa0 libgl1-mesa-dri) or OSMesa (apt-get install libosmesa6); "
    "`python launch/doctor.py` shows what works"
)

_ROOT = Path(__file__).resolve().parent.parent
_TIMEOUT_SECONDS = 600.0
_POLL_SECONDS = 0.2


class RenderingError(Exception):
    """No picture could be made; the message says why and what to do."""


def render(
    policy: Path,
    output: Path,
    *,
    episodes: int = 2,
    backends: Sequence[str] = BACKENDS,
    stop: StopSignal | None = None,
) -> list[str]:
    """Renders test episodes of a policy into `output`: a video (.mp4) or a strip of frames (.png).

    Args:
      policy: its path, without or with a suffix.
      episodes: how many a video shows, successful ones first.
      backends: values of MUJOCO_GL, tried in turn.
      stop: ends the rendering when set.

    Returns:
      What the user should know: which backend was fallen back to, and why.

    Raises:
      RenderingError: no backend works, or the file cannot be written; `output` is untouched.
    """
    request = {"policy": str(policy), "output": str(output), "episodes": episodes}
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
    """Runs `python -m launch.rendering ARGUMENT` with this backend; None, or why it failed."""
    environment = {**os.environ, "MUJOCO_GL": backend, "PYOPENGL_PLATFORM": backend}
    path = [str(_ROOT), os.environ.get("PYTHONPATH", "")]
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, path))
    process = subprocess.Popen(
        [sys.executable, "-m", "launch.rendering", argument],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    end = time.monotonic() + timeout
    while True:
        try:
            _, printed = process.communicate(timeout=_POLL_SECONDS)
            break
        except subprocess.TimeoutExpired:
            late = time.monotonic() > end
            if late or (stop is not None and stop.number is not None):
                process.kill()
                process.communicate()
                return f"gave no result within {timeout:.0f} s" if late else "stopped"
    return None if process.returncode == 0 else _reason(process.returncode, printed)


def _reason(status: int, printed: str) -> str:
    if status < 0:
        return f"the renderer was killed by {signal.Signals(-status).name}"
    lines = [line for line in printed.strip().splitlines() if line.strip()]
    return lines[-1].strip() if lines else f"the renderer ended with status {status}"
