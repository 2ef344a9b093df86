"""Runs jobs in worker processes. If one dies, the others continue."""

import contextlib
import faulthandler
import multiprocessing
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Final, NamedTuple

from launch.asking import start
from launch.folder.agents import Job
from launch.jobs.messages import Failed, Finished, Hooks, Send, Started, Warned

Work = Callable[[Job, Send], None]

_POLL_SECONDS = 0.2
_START_METHOD: Final = "spawn"  # nothing of the launch's own state, its threads least of all
GRACE_SECONDS = 60.0  # for workers to save what they are at


class StopSignal:
    """Remembers Ctrl-C or SIGTERM, so that a loop can end in order; a second one ends at once."""

    def __init__(self, text: bytes | None = None) -> None:
        self.number: int | None = None
        self._text = text or _STOPPING_TEXT

    def __enter__(self) -> "StopSignal":
        self._before = {number: signal.getsignal(number) for number in _STOPPING}
        for number in _STOPPING:
            signal.signal(number, self._receive)
        return self

    def __exit__(self, *_) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _receive(self, number: int, _) -> None:
        self.number = number
        with contextlib.suppress(OSError):
            os.write(2, self._text)  # safe in a handler, as print is not
        for stopping in _STOPPING:
            signal.signal(stopping, signal.SIG_DFL)


_STOPPING_TEXT = b"\nstopping: unfinished runs are saved; once more quits at once\n"
_UNSAVED = (
    "its worker did not stop within {seconds:.0f} s, in a long round or test period; "
    "what it did since its last checkpoint is lost"
)
_STOPPING = (signal.SIGINT, signal.SIGTERM)


class _Worker(NamedTuple):
    job: Job
    process: BaseProcess
    messages: Connection
    log: Path
    started: float


def execute(
    jobs: Sequence[Job], work: Work, hooks: Hooks, *, workers: int, stop: StopSignal
) -> None:
    """Runs every job, in this order, `workers` at a time.

    Args:
      work: what a worker calls with its job and a function that sends messages; an importable
        function or a partial of one, since the processes are spawned.
      hooks: they hear Started of each job, what the job sends, and one Finished or Failed. The log
        of a job that finishes is removed.
      stop: when set, workers are ended. Of what they still send only warnings are passed on.
    """
    waiting, running = list(jobs), list[_Worker]()
    try:
        while (waiting or running) and stop.number is None:
            while waiting and len(running) < workers:
                running.append(_start(waiting[0], work, hooks.log(waiting.pop(0))))
                hooks.on_message(running[-1].job, Started())
            ready = wait([worker.messages for worker in running], timeout=_POLL_SECONDS)
            for worker in [worker for worker in running if worker.messages in ready]:
                message = _receive(worker)
                if isinstance(message, Finished | Failed):
                    running.remove(worker)
                    _settle(worker, message)
                hooks.on_message(worker.job, message)
            hooks.on_poll()
    finally:
        for worker in running:  # all at once: each may have a checkpoint to write first
            worker.process.terminate()
        for worker in running:
            for message in _last_messages(worker):
                if isinstance(message, Warned):
                    hooks.on_message(worker.job, message)
            if worker.process.is_alive():
                hooks.on_message(worker.job, Warned(_UNSAVED.format(seconds=GRACE_SECONDS)))
            _end(worker.process, 0.0)


def _last_messages(worker: _Worker) -> Iterator[Any]:
    """What a worker sends that is ending: until it has ended, or its grace is over."""
    end = time.monotonic() + GRACE_SECONDS
    with contextlib.suppress(EOFError, OSError):
        while (left := end - time.monotonic()) > 0 and worker.messages.poll(left):
            yield worker.messages.recv()
    worker.process.join(timeout=max(0.0, end - time.monotonic()))


def messages_of(job: Job, work: Work, log: Path) -> Generator[Any, None, None]:
    """Runs one job in a worker process; yields the messages that `execute` passes on.

    Closing this ends the worker.
    """
    worker = _start(job, work, log)
    try:
        yield Started()
        message = None
        while not isinstance(message, Finished | Failed):
            while not wait([worker.messages], timeout=_POLL_SECONDS):
                pass  # to notice an interrupt that, like Ray's, does not wake what blocks
            message = _receive(worker)
            if isinstance(message, Finished | Failed):
                _settle(worker, message)
            yield message
    finally:
        _end(worker.process, GRACE_SECONDS)


def _start(job: Job, work: Work, log: Path) -> _Worker:
    log.touch()  # there even if the process dies before it can open it
    context = multiprocessing.get_context(_START_METHOD)
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_main, args=(work, job, sender, log), name=job.name)
    process.daemon = True
    process.start()
    sender.close()  # only the worker holds it now: its death ends the stream
    return _Worker(job, process, receiver, log, time.monotonic())


def _receive(worker: _Worker) -> Any:
    """The worker's next message; where it ended without one, what became of it."""
    try:
        message = worker.messages.recv()
    except (EOFError, OSError):
        worker.process.join(timeout=10)
        return Failed(_epitaph(worker.process.exitcode))
    if isinstance(message, Finished):
        return Finished(time.monotonic() - worker.started)
    return message


def _settle(worker: _Worker, message: Finished | Failed) -> None:
    """Sees a worker off that has sent its last message."""
    worker.process.join(timeout=5)
    _end(worker.process)
    if isinstance(message, Finished):
        worker.log.unlink(missing_ok=True)


def _epitaph(exit_code: int | None) -> str:
    if exit_code is None or exit_code >= 0:
        return f"the worker process ended early, with exit status {exit_code}"
    name = signal.Signals(-exit_code).name
    hint = " (often: out of memory)" if name == "SIGKILL" else ""
    return f"the worker process was killed by {name}{hint}"


def _end(process: BaseProcess, grace: float = 5.0) -> None:
    """Sees to it that the process is gone."""
    if process.is_alive():
        process.terminate()
        process.join(timeout=grace)
    if process.is_alive():
        process.kill()
        process.join()


def _main(work: Work, job: Job, messages: Connection, log: Path) -> None:
    """A worker's whole life."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all; the parent ends its workers
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    with log.open("w", encoding="utf-8") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    start.standard_streams()
    faulthandler.enable()
    threading.Thread(target=_die_with_the_parent, daemon=True).start()
    try:
        work(job, messages.send)
    except BrokenPipeError:
        return  # the parent is gone: nobody would keep the results
    except BaseException as error:
        traceback.print_exc()
        sys.stderr.flush()
        with contextlib.suppress(OSError):
            messages.send(Failed(f"{type(error).__name__}: {error}".splitlines()[0]))
    else:
        messages.send(Finished(0.0))


def _die_with_the_parent() -> None:
    """A launch that was killed can be started again at once: nothing of it is still at work."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)
