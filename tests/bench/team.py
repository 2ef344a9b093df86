"""Processes that hold work ready and do it all at once: what is timed is work, not start-up."""

import multiprocessing
import resource
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import torch

Worker = Callable[..., Any]


class Team:
    """One spawned, single-threaded process for each worker, as a launch has them.

    Attributes:
      start_seconds: until all were ready: new processes, imports, making the workers.
    """

    def __init__(self, make: Callable[..., Worker], arguments: Sequence[tuple]):
        """Starts the processes; each makes its worker with `make(*arguments[i])`.

        Raises:
          RuntimeError: a worker could not be made; the message has its traceback.
        """
        context = multiprocessing.get_context("spawn")
        start = time.perf_counter()
        self._members = []
        for own in arguments:
            here, there = context.Pipe()
            process = context.Process(target=_main, args=(there, make, own), daemon=True)
            process.start()
            there.close()
            self._members.append((process, here))
        self._answers()
        self.start_seconds = time.perf_counter() - start

    def work(self, *orders: Any) -> tuple[float, list[Any]]:
        """Has every worker called with `orders`.

        Returns:
          The seconds from go until the last was done, and what each returned.

        Raises:
          RuntimeError: a worker failed; the message has its traceback.
        """
        start = time.perf_counter()
        for _, connection in self._members:
            connection.send(orders)
        answers = self._answers()
        return time.perf_counter() - start, answers

    def _answers(self) -> list[Any]:
        answers = []
        for process, connection in self._members:
            try:
                done, answer = connection.recv()
            except EOFError:
                process.join(timeout=5)
                raise RuntimeError(f"a worker ended with exit code {process.exitcode}") from None
            if not done:
                raise RuntimeError(f"a worker failed:\n{answer}")
            answers.append(answer)
        return answers

    def __enter__(self) -> "Team":
        return self

    def __exit__(self, *_) -> None:
        """Ends the processes."""
        for process, connection in self._members:
            connection.close()  # ends its loop
            process.join(timeout=5)
            if process.is_alive():
                process.terminate()
                process.join()


def held_memory() -> float:
    """GiB that this process holds, its share of what it shares; elsewhere than Linux, at most."""
    shares = Path("/proc/self/smaps_rollup")
    if shares.exists():
        lines = shares.read_text(encoding="ascii").splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("Pss:")) / 2**20
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**30


def _main(connection: Connection, make: Callable[..., Worker], arguments: tuple) -> None:
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    try:
        worker = make(*arguments)
        connection.send((True, None))
        while True:
            connection.send((True, worker(*connection.recv())))
    except EOFError:
        return  # the team was closed
    except BaseException:
        connection.send((False, traceback.format_exc()))
