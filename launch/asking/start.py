"""First steps of a process: settings that libraries read at import, and ending with its parent."""

import contextlib
import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from typing import IO

Stream = int | IO[str]  # where a child writes to: as `subprocess.Popen` has it

_PARENT = "HAC_SUITE_PARENT"  # names the pipe whose other end the parent holds


def standard_streams() -> None:
    """Replaces closed standard streams.

    Otherwise the next opened file would become standard error and receive what is printed there.
    """
    for stream in range(3):
        try:
            os.fstat(stream)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
    sys.stdout = sys.stdout or open(1, "w", closefd=False)  # noqa: SIM115  (for as long as we live)
    sys.stderr = sys.stderr or open(2, "w", closefd=False)  # noqa: SIM115


def without_display() -> None:
    """For programs that load tasks: what renders does so in a process of its own."""
    standard_streams()
    os.environ["MUJOCO_GL"] = "disabled"


def for_training() -> None:
    """For programs that train, here and in their workers."""
    without_display()
    for library in ("OMP", "MKL", "OPENBLAS"):  # many processes of one thread beat few of many
        os.environ[f"{library}_NUM_THREADS"] = "1"


@contextlib.contextmanager
def child(
    command: Sequence[str],
    environment: Mapping[str, str],
    *,
    stdout: Stream = subprocess.DEVNULL,
    stderr: Stream = subprocess.PIPE,
) -> Iterator[subprocess.Popen[str]]:
    """A process that calls `die_with_the_parent`: it never outlives this one, however this ends.

    It is killed if it still runs when the block ends.
    """
    reader, writer = os.pipe()
    try:
        try:
            process = subprocess.Popen(
                command,
                env={**environment, _PARENT: str(reader)},
                pass_fds=[reader],
                stdout=stdout,
                stderr=stderr,
                text=True,
            )
        finally:
            os.close(reader)
        try:
            yield process
        finally:
            process.kill()  # does nothing to one that has ended
            process.wait()
    finally:
        os.close(writer)


def die_with_the_parent() -> None:
    """Ends this process when the process that started it as a `child` is gone."""
    if pipe := os.environ.pop(_PARENT, ""):
        threading.Thread(target=_wait_for_the_end, args=(int(pipe),), daemon=True).start()


def _wait_for_the_end(pipe: int) -> None:
    os.read(pipe, 1)  # nothing is ever written into it: it ends with the parent
    os._exit(1)


def say_that_it_loads() -> None:
    """Tells a user at a terminal that loading takes some seconds."""
    if sys.stderr.isatty():
        print("loading torch and MuJoCo, which takes some seconds", file=sys.stderr, flush=True)
