"""The progress display during training: one line per agent, from the first second."""

import time
from collections.abc import Iterable

from rich.live import Live
from rich.table import Table

from launch.asking.console import Console
from launch.folder.agents import Agent, Job

_SECONDS_BETWEEN_LINES = 15.0  # where the output is a file, not a terminal


class _JobState:
    """Episodes of one job, and the clock that its time left is reckoned by."""

    def __init__(self, job: Job, episodes: int) -> None:
        self.job = job
        self.episodes, self.total = job.start, episodes
        self.success: float | None = None
        self.started: float | None = None
        self.outcome = ""

    def seconds_left(self, now: float) -> float | None:
        if self.outcome:
            return 0.0
        done = self.episodes - self.job.start
        if self.started is None or done == 0:
            return None
        return (now - self.started) * (self.total - self.episodes) / done


class Board:
    """Keeps the state of every agent and shows it, live on a terminal and as lines elsewhere."""

    def __init__(self, jobs: Iterable[Job], episodes: int, console: Console) -> None:
        self._states = {job: _JobState(job, episodes) for job in jobs}
        self._console = console
        self._live = Live(console=console, get_renderable=self._table, refresh_per_second=2)
        self._printed = -_SECONDS_BETWEEN_LINES  # long ago: the first tick prints

    def __enter__(self) -> "Board":
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_) -> None:
        if self._console.is_terminal:
            self._live.stop()

    def started(self, job: Job) -> None:
        state = self._states[job]
        state.started = state.started or time.monotonic()

    def progressed(self, job: Job, episodes: int, success: float) -> None:
        state = self._states[job]
        state.episodes, state.success = episodes, success

    def ended(self, job: Job, outcome: str) -> None:
        self._states[job].outcome = outcome
        own = [state for other, state in self._states.items() if other.agent == job.agent]
        if all(state.outcome for state in own) and not self._console.is_terminal:
            self._print_line(job.agent)

    def tick(self) -> None:
        """To be called often: prints the lines again when it is time."""
        due = time.monotonic() - self._printed >= _SECONDS_BETWEEN_LINES
        if due and not self._console.is_terminal:
            self._print_lines()

    def _print_lines(self) -> None:
        self._printed = time.monotonic()
        for agent in self._agents():
            self._print_line(agent)

    def _print_line(self, agent: Agent) -> None:
        name, seeds, episodes, success, left = self._cells(agent)
        self._console.say(
            f"{name}: {seeds} seed(s), episodes {episodes}, success {success}, {left}"
        )

    def _table(self) -> Table:
        table = Table(box=None, pad_edge=False, header_style="bold")
        for heading in ("agent", "seeds", "episodes", "success", "time left"):
            table.add_column(heading, justify="left" if heading == "agent" else "right")
        for agent in self._agents():
            table.add_row(*self._cells(agent))
        return table

    def _agents(self) -> list[Agent]:
        return sorted({job.agent for job in self._states})

    def _cells(self, agent: Agent) -> tuple[str, str, str, str, str]:
        """Agent, seeds, episodes of the slowest job, mean success in the last test, time left."""
        states = [state for job, state in self._states.items() if job.agent == agent]
        seeds = sum(len(state.job.seeds) for state in states)
        slowest = min(states, key=lambda state: state.episodes)
        tested = [state for state in states if state.success is not None]
        weight = sum(len(state.job.seeds) for state in tested)
        success = sum((state.success or 0.0) * len(state.job.seeds) for state in tested)
        return (
            str(agent),
            str(seeds),
            f"{slowest.episodes}/{slowest.total}",
            f"{success / weight:.0%}" if weight else "-",
            _status(states),
        )


def _status(states: list[_JobState]) -> str:
    outcomes = {state.outcome for state in states}
    if "" not in outcomes:
        return "failed" if "failed" in outcomes else "done"
    if all(state.started is None for state in states):
        return "waiting"
    left = [state.seconds_left(time.monotonic()) for state in states]
    known = [seconds for seconds in left if seconds is not None]
    return f"{duration(max(known))} left" if len(known) == len(left) else "training"


def duration(seconds: float) -> str:
    """`45 s`, `12 min` or `1 h 05 min`."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
