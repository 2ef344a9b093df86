"""Runs jobs as Ray tasks on the nodes of a cluster; a job moves if its node dies.

A Ray task does no more than watch over one worker process, as `local.execute` does here: what
goes wrong in that process ends the same way. Machines share the run folder and this code's folder.
"""

import contextlib
import logging
import os
import pickle
import socket
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from analysis.program import CommandError
from launch.folder import manifest
from launch.folder.agents import Job
from launch.jobs import local
from launch.jobs.local import StopSignal, Work
from launch.jobs.messages import Failed, Finished, Hooks, WorkerLost

MOST_LOSSES = 3  # of one job; the next fails it

# Read when Ray is imported. A cluster that begins here is reached from this machine alone; Ray
# itself has it ask for a token.
_OWN_CLUSTER = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0"}
_ANY_CLUSTER = {
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
    "RAY_COLOR_PREFIX": "0",  # no control characters, wherever the output goes
    "RAY_USAGE_STATS_ENABLED": "0",
}

_ROOT = Path(__file__).resolve().parents[2]
_POLL_SECONDS = 0.2
_OBJECT_STORE_BYTES = 100 * 2**20  # nothing here is large
_PASSED_ON = ("MUJOCO_GL", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


class _Attempt(NamedTuple):
    """A job on its way through the cluster."""

    job: Job  # as it was asked for
    messages: Any  # Ray's generator of pickled messages


class Cluster:
    """The Ray cluster at an address, or one of its own on this machine while the `with` lasts.

    Attributes:
      workers: how many jobs run at a time.
    """

    def __init__(self, address: str | None, workers: int) -> None:
        """
        Args:
          address: `auto`, the cluster that this machine is part of; or HOST:PORT of its head; or
            None, which starts one that other machines cannot reach.
          workers: 0: as many as there are cores.

        Raises:
          CommandError: there is no cluster at that address.
        """
        self.workers = workers
        self._address = address

    def __enter__(self) -> "Cluster":
        for name, value in {**_ANY_CLUSTER, **({} if self._address else _OWN_CLUSTER)}.items():
            os.environ.setdefault(name, value)
        import ray

        environment = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
        options: dict[str, Any] = {
            "logging_level": logging.ERROR,
            "log_to_driver": False,
            "runtime_env": {"env_vars": {**environment, "PYTHONPATH": _search_path()}},
        }
        if self._address is None:
            self.workers = self.workers or manifest.cores()
            own: dict[str, Any] = {
                "num_cpus": self.workers,
                "object_store_memory": _OBJECT_STORE_BYTES,
            }
            ray.init(address="local", include_dashboard=False, **own, **options)
            return self
        try:
            _knock(self._address)
            ray.init(address=self._address, **options)
        except Exception as error:  # Ray raises many kinds
            reason = (str(error).strip() or type(error).__name__).splitlines()[0]
            raise CommandError(
                f"flag --ray_address={self._address}: this machine is not part of a Ray cluster at "
                f"that address; `ray start` makes or joins one ({reason})"
            ) from error
        self.workers = self.workers or max(1, int(ray.cluster_resources().get("CPU", 1)))
        return self

    def __exit__(self, *_) -> None:
        import ray

        ray.shutdown()

    def execute(
        self,
        jobs: Sequence[Job],
        work: Work,
        hooks: Hooks,
        *,
        stop: StopSignal,
        again: Callable[[Job], Job],
    ) -> None:
        """Does what `local.execute` does, on the cluster.

        A job whose machine is lost begins again elsewhere, `MOST_LOSSES` times at most: the hooks
        hear WorkerLost; then what `again` makes of the job, to begin where its checkpoints stand,
        runs in its name. Machines see the logs and what `work` reads and writes at the same paths.
        """
        waiting = [(job, job) for job in jobs]
        running: list[_Attempt] = []
        losses = Counter[Job]()
        try:
            while (waiting or running) and stop.number is None:
                while waiting and len(running) < self.workers:
                    job, now = waiting.pop(0)
                    running.append(_Attempt(job, _submit(now, work, hooks.log(job))))
                for attempt in _ready(running):
                    message = _next(attempt.messages)
                    if isinstance(message, Finished | Failed | WorkerLost):
                        running.remove(attempt)
                    if isinstance(message, WorkerLost):
                        losses[attempt.job] += 1
                        message = _after_loss(attempt.job, message, losses, again, waiting)
                    hooks.on_message(attempt.job, message)
                hooks.on_poll()
        finally:
            _cancel(running)


def _after_loss(
    job: Job,
    lost: WorkerLost,
    losses: Counter[Job],
    again: Callable[[Job], Job],
    waiting: list[tuple[Job, Job]],
) -> WorkerLost | Failed:
    """Puts the job first in the queue, if it was not lost too often; what to tell about it."""
    if losses[job] > MOST_LOSSES:
        return Failed(f"lost {losses[job]} times with its machine: {lost.reason}")
    try:
        now = again(job)
    except (CommandError, OSError) as error:
        return Failed(f"lost with its machine, and its checkpoints cannot be used: {error}")
    waiting.insert(0, (job, now))
    return WorkerLost(f"{lost.reason}; resumes elsewhere from episode {now.start}")


def _search_path() -> str:
    """Where workers look for modules: here first, and where the launch looks."""
    own = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    return os.pathsep.join([str(_ROOT), *(str(Path(part).resolve()) for part in own if part)])


def _knock(address: str) -> None:
    """Raises at once where nothing listens: Ray itself would try for minutes."""
    if address != "auto":
        host, port = address.split(":")
        socket.create_connection((host, int(port)), timeout=10).close()


def _submit(job: Job, work: Work, log: Path) -> Any:
    import ray

    log.touch()  # there even if the machine dies before it can open it
    # No retries by Ray: it would begin the job where it began the first time.
    remote = ray.remote(num_cpus=1, max_retries=0, num_returns="streaming")(_watch)
    return remote.options(name=job.name).remote(job, work, log.resolve())


def _ready(running: Sequence[_Attempt]) -> list[_Attempt]:
    """Those that have something to say, after a short wait for the first."""
    import ray

    streams = [attempt.messages for attempt in running]
    if not ray.wait(streams, timeout=_POLL_SECONDS)[0]:
        return []
    ready = ray.wait(streams, num_returns=len(streams), timeout=0)[0]
    return [attempt for attempt in running if attempt.messages in ready]


def _next(messages: Any) -> Any:
    """The next message; where the task ended without one, what became of it."""
    import ray

    try:
        return pickle.loads(ray.get(next(messages)))
    except StopIteration:
        return Failed("the task ended early")
    except ray.exceptions.RayTaskError as error:  # the worker could not even be started
        return Failed(f"{type(error.cause).__name__}: {error.cause}".splitlines()[0])
    except ray.exceptions.RayError as error:
        return WorkerLost(type(error).__name__)


def _cancel(running: Sequence[_Attempt]) -> None:
    """Ends what still runs, all at once: each may have a checkpoint to write first."""
    import ray

    with contextlib.suppress(ray.exceptions.RayError):  # the cluster is gone: nothing runs
        for attempt in running:
            ray.cancel(attempt.messages)
        ends = [attempt.messages.completed() for attempt in running]
        if ends:
            ray.wait(ends, num_returns=len(ends), timeout=local.GRACE_SECONDS)


def _watch(job: Job, work: Work, log: Path) -> Iterator[bytes]:
    """What a Ray task does: runs the job in a process of its own; yields its messages, pickled."""
    with contextlib.closing(local.messages_of(job, work, log)) as messages:
        for message in messages:
            yield pickle.dumps(message)
