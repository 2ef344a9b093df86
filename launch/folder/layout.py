"""A task's run folder: its layout, its lock, and its finished seeds."""

import contextlib
import glob
import itertools
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from analysis.program import CommandError
from analysis.reading import names
from analysis.reading.files import leftovers
from hac_suite import policy_files
from launch.folder import lock, policies, results
from launch.folder.agents import Agent, Job


class Ended(NamedTuple):
    """How far a seed is finished, not counting an interrupted extension."""

    period: int  # all rows until it are here, and the policy is of it or of a later one
    whole: bool  # no row is missing until the policy's period


class RunFolder:
    """`<out>/<task>/`, and nothing above it.

    Raises:
      CommandError: the task's name is not the name of a folder.
    """

    def __init__(self, out: Path, task: str) -> None:
        if task in ("", ".", "..") or "\0" in task or Path(task).name != task:
            raise CommandError(f"{task!r} cannot name a run folder")
        self.task = task
        self._lock: lock.Lock | None = None
        self.path = Path(out) / task
        self.results = self.path / names.RESULTS
        self.manifest = self.path / names.MANIFEST
        self.figure = self.path / names.FIGURE
        self.figure_numbers = self.path / names.FIGURE_NUMBERS
        self.report = self.path / names.REPORT
        self.policies = self.path / names.POLICIES
        self.stages = self.path / names.STAGES
        self.videos = self.path / names.VIDEOS
        self.replays = self.path / names.REPLAYS
        self.failures = self.path / names.FAILURES
        self.checkpoints = self.path / names.CHECKPOINTS

    def policy(self, subgoal_layers: int, seed: int) -> Path:
        """Path of a policy without its two suffixes."""
        return self.policies / f"{self.task}_{subgoal_layers}layers_seed{seed}"

    def stage(self, subgoal_layers: int, seed: int, period: int) -> Path:
        """Path of the policy of a test period, without its two suffixes."""
        return self.stages / f"{self.policy(subgoal_layers, seed).name}_period{period}"

    def unkept(
        self, subgoal_layers: int, behind: Mapping[int, int], periods: Iterable[int]
    ) -> list[tuple[int, int]]:
        """Seeds and test periods of which no policy was kept, although the period is over.

        Args:
          behind: how many test periods a seed has behind it.
        """
        return [
            (seed, period)
            for period in periods
            for seed, count in behind.items()
            if period < count
            and not all(
                file.is_file()
                for file in policy_files.paths(self.stage(subgoal_layers, seed, period))
            )
        ]

    def video(self, subgoal_layers: int) -> Path:
        return self.videos / f"{self.task}_{subgoal_layers}layers.mp4"

    def replay(self, subgoal_layers: int) -> Path:
        return self.replays / f"{self.task}_{subgoal_layers}layers.html"

    def checkpoints_of(self, subgoal_layers: int, seed: int) -> Path:
        """The folder of a seed's checkpoints: the last two, or the final one."""
        return self.checkpoints / f"{self.task}_{subgoal_layers}layers_seed{seed}"

    def drop_checkpoints(self, runs: Iterable[tuple[int, int]]) -> None:
        """Removes the checkpoints of runs (subgoal_layers, seed), whose results are all here."""
        for run in runs:
            shutil.rmtree(self.checkpoints_of(*run), ignore_errors=True)
        with contextlib.suppress(OSError):  # others are unfinished, or there was none
            self.checkpoints.rmdir()

    def checkpoint_bytes(self) -> int:
        """What all checkpoints take on the disk."""
        return sum(file.stat().st_size for file in self.checkpoints.glob("*/*") if file.is_file())

    def failure(self, job: Job) -> Path:
        return self.failures / f"{job.name}.txt"

    def log(self, job: Job) -> Path:
        """The output of a worker; it becomes the failure file if the worker fails."""
        return self.path / f".{job.name}.log"

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        """Makes the folder and keeps other launches out of it; a dead launch's lock is void.

        Raises:
          CommandError: another launch uses the folder, or it cannot be written.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise CommandError(f"cannot write to {self.path}: {error.strerror}") from error
        with lock.held(self.path) as self._lock:
            try:
                yield
            finally:
                self._lock = None

    def check_ours(self) -> None:
        """Raises lock.FolderTaken where this is not the folder any more that `lock` locked."""
        if self._lock is not None:
            self._lock.check()

    def finished(self, agent: Agent, periods: int) -> set[int]:
        """Seeds whose test periods 0 to `periods` and last policy are all here."""
        return {seed for seed, ended in self.ended(agent).items() if ended.period >= periods}

    def ended(self, agent: Agent) -> dict[int, Ended]:
        """How far each seed is finished that has a policy."""
        tested: dict[int, set[int]] = {}
        for row in results.read(self.results)[0]:
            if row["subgoal_layers"] == str(agent.subgoal_layers):
                tested.setdefault(int(row["seed"]), set()).add(int(row["period"]))
        found = {}
        for seed, periods in tested.items():
            run = agent.subgoal_layers, seed
            if 0 in periods and self.has_policy(*run):
                last = _last_without_gap(periods)
                of_policy = self._policy_period(run, last)
                found[seed] = Ended(min(last, of_policy), last >= of_policy)
        return found

    def _policy_period(self, run: tuple[int, int], otherwise: int) -> int:
        """The test period of a run's policy, which a damaged or an old one does not say."""
        _, file = policy_files.paths(self.policy(*run))
        try:
            period = policies.read(file).period
        except CommandError:
            return otherwise
        return otherwise if period is None else period

    def has_policy(self, subgoal_layers: int, seed: int) -> bool:
        files = policy_files.paths(self.policy(subgoal_layers, seed))
        return all(file.is_file() for file in files)

    def prepare(self, runs: Mapping[tuple[int, int], Sequence[Mapping[str, Any]]]) -> int:
        """Makes the subfolders and removes files that are in the way of training these seeds.

        A policy, and the rows up to its period, stay until the training has replacements: finished
        results are never removed.

        Args:
          runs: (subgoal_layers, seed) of each run that is about to start or to go on, with the
            rows of the test periods that are behind it: results.csv will hold those of its rows.

        Returns:
          How many lines of results.csv had been cut short by a kill, and were dropped.
        """
        for folder in (self.policies, self.videos):
            folder.mkdir(exist_ok=True)
        shutil.rmtree(self.failures, ignore_errors=True)
        for file in [*self._leftovers(), *self._stages_ahead(runs)]:
            if not file.is_dir():
                file.unlink(missing_ok=True)
        return self._set_rows(runs)

    def _stages_ahead(self, runs: Mapping[tuple[int, int], Sequence]) -> Iterator[Path]:
        """Policies that were kept of test periods which these runs have still before them."""
        for run, behind in runs.items():
            own = glob.escape(f"{self.policy(*run).name}_period")
            for file in self.stages.glob(f"{own}*"):
                period = file.stem.rpartition("_period")[2]
                if period.isdecimal() and int(period) >= len(behind):
                    yield file

    def _leftovers(self) -> Iterator[Path]:
        """Files that a kill can leave incomplete; other files are not ours to remove."""
        task = glob.escape(self.task)
        yield from self.path.glob(f".{task}_*layers_seeds*-*.log")
        for name in names.WRITTEN_WHOLE:
            yield from leftovers(self.path, name)
        for suffix in policy_files.SUFFIXES:
            yield from leftovers(self.policies, f"{task}_*layers_seed*{suffix}")
            yield from leftovers(self.stages, f"{task}_*layers_seed*{suffix}")
        yield from leftovers(self.videos, f"{task}_*layers.mp4")
        yield from leftovers(self.replays, f"{task}_*layers.html")

    def _set_rows(self, runs: Mapping[tuple[int, int], Sequence[Mapping[str, Any]]]) -> int:
        until = {
            run: self._policy_period(run, sys.maxsize) for run in runs if self.has_policy(*run)
        }
        rows, dropped = results.read(self.results)
        kept, of_runs = list[results.Row](), set[tuple[tuple[int, int], int]]()
        for row in rows:
            run, period = (int(row["subgoal_layers"]), int(row["seed"])), int(row["period"])
            if run not in runs or period <= until.get(run, -1):
                kept.append(row)
                of_runs.add((run, period))
        behind = [
            row
            for run, own in runs.items()
            for row in own
            if (run, int(row["period"])) not in of_runs
        ]
        if dropped or behind or len(kept) != len(rows) or not results.is_current(self.results):
            results.rewrite(self.results, [*kept, *behind])
        return dropped

    def note_failure(self, job: Job, reason: str) -> None:
        """Records why a job failed while its worker continues."""
        self.failures.mkdir(exist_ok=True)
        self.failure(job).write_text(f"{reason}\n", encoding="utf-8")

    def keep_failure(self, job: Job) -> Path:
        """Keeps what a failed worker printed, its traceback at the end; returns the file."""
        self.failures.mkdir(exist_ok=True)
        self.log(job).replace(self.failure(job))
        return self.failure(job)


def _last_without_gap(periods: set[int]) -> int:
    """The last of the periods 0, 1, 2, ... before one is missing."""
    return next(period for period in itertools.count() if period + 1 not in periods)
