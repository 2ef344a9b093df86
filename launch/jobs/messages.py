"""Messages from a worker to the launch, beside `hac_suite.Progress`, and their receiver."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from launch.folder.agents import Job

Send = Callable[[Any], None]


class Hooks(NamedTuple):
    """What a launch has done while its jobs run."""

    log: Callable[[Job], Path]  # where a job's process is to write what it prints
    on_message: Callable[[Job, Any], None]
    on_poll: Callable[[], None] = lambda: None  # a few times a second


class Started(NamedTuple):
    """A worker is at work on the job."""


class Tested(NamedTuple):
    """One test period of the job's seeds: rows of results.csv."""

    period: int
    rows: list[dict]


class Warned(NamedTuple):
    """What a person should know at once, though the job goes on."""

    text: str


class SeedFailed(NamedTuple):
    """One of the job's seeds cannot go on; the others do."""

    seed: int
    reason: str


class Finished(NamedTuple):
    """The job's last message where all went well."""

    seconds: float


class Failed(NamedTuple):
    """The job's last message where it did not."""

    reason: str  # one line; what the worker printed is in its log


class WorkerLost(NamedTuple):
    """The job's machine died, or Ray's process on it: the job begins again elsewhere."""

    reason: str
