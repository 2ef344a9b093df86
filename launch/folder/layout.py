"""A task's run folder: its layout, its lock, and which seeds are finished in it."""

import contextlib
import fcntl
import glob
import json
import os
import shutil
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from analysis.program import CommandError
from analysis.reading import names
from analysis.reading.files import leftovers
from launch.folder import results
from launch.folder.agents import Agent, Job

POLICY_SUFFIXES = (".json", ".safetensors")  # the weights last: they are what a reader looks for


def policy_files(path: Path) -> list[Path]:
    """The files of a policy, whose path has no suffix."""
    return [path.with_name(path.name + suffix) for suffix in POLICY_SUFFIXES]


class RunFolder:
    """`<out>/<task>/`, and nothing above it.

    Raises:
      CommandError: the task's name is not the name of a folder.
    """

    def __init__(self, out: Path, task: str) -> None:
        if task in ("", ".", "..") or "\0" in task or Path(task).name != task:
            raise CommandError(f"{task!r} cannot name a run folder")
        self.task = task
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

    def video(self, subgoal_layers: int) -> Path:
        return self.videos / f"{self.task}_{subgoal_layers}layers.mp4"

    def replay(self, subgoal_layers: int) -> Path:
        return self.replays / f"{self.task}_{subgoal_layers}layers.html"

    def checkpoints_of(self, subgoal_layers: int, seed: int) -> Path:
        """The folder of an unfinished seed's checkpoints."""
        return self.checkpoints / f"{self.task}_{subgoal_layers}layers_seed{seed}"

    def drop_checkpoints(self, runs: Iterable[tuple[int, int]]) -> None:
        """Removes the checkpoints of runs (subgoal_layers, seed) whose results are all here."""
        for run in runs:
            shutil.rmtree(self.checkpoints_of(*run), ignore_errors=True)
        with contextlib.suppress(OSError):  # others are unfinished, or there was none
            self.checkpoints.rmdir()

    def failure(self, job: Job) -> Path:
        return self.failures / f"{job.name}.txt"

    def log(self, job: Job) -> Path:
        """What a worker prints while it runs; becomes its failure file if it fails."""
        return self.path / f".{job.name}.log"

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        """Makes the folder and keeps other launches out of it; a dead launch's lock is void.

        Raises:
          CommandError: a launch is at work here, or the folder cannot be written.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            file = (self.path / ".lock").open("a+", encoding="utf-8")
        except OSError as error:
            raise CommandError(f"cannot write to {self.path}: {error.strerror}") from error
        with file:
            try:
                # The system drops this lock with the process, however that ends.
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise CommandError(self._held_message(file)) from error
            file.truncate(0)
            holder = {"pid": os.getpid(), "since": time.strftime("%Y-%m-%d %H:%M:%S")}
            json.dump(holder, file)
            file.flush()
            yield

    def _held_message(self, file) -> str:
        file.seek(0)
        try:
            holder = json.load(file)
            who = f"process {holder['pid']}, started {holder['since']}"
        except (ValueError, KeyError):
            who = "another process"
        return f"{self.path} is in use by {who}; wait for it, or give another --out"

    def finished(self, agent: Agent, periods: int) -> set[int]:
        """Seeds whose test periods 0 to `periods` and last policy are all here."""
        seen: dict[int, set[int]] = {}
        for row in results.read(self.results)[0]:
            if row["subgoal_layers"] == str(agent.subgoal_layers):
                seen.setdefault(int(row["seed"]), set()).add(int(row["period"]))
        return {
            seed
            for seed, tested in seen.items()
            if tested >= set(range(periods + 1)) and self.has_policy(agent.subgoal_layers, seed)
        }

    def has_policy(self, subgoal_layers: int, seed: int) -> bool:
        return all(file.is_file() for file in policy_files(self.policy(subgoal_layers, seed)))

    def prepare(self, runs: Mapping[tuple[int, int], Sequence[Mapping[str, Any]]]) -> int:
        """Makes the subfolders and drops what stands in the way of training these seeds.

        Args:
          runs: (subgoal_layers, seed) of each run that is about to start or to go on, with the
            rows of the test periods that are behind it: results.csv will hold those of its rows.

        Returns:
          How many lines of results.csv had been cut short by a kill, and were dropped.
        """
        for folder in (self.policies, self.videos):
            folder.mkdir(exist_ok=True)
        shutil.rmtree(self.failures, ignore_errors=True)
        doomed = [file for run in runs for file in policy_files(self.policy(*run))]
        doomed += self._stages_ahead(runs)
        for file in [*self._leftovers(), *doomed]:
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
        """What a kill can leave half written; files of other names are not ours to remove."""
        task = glob.escape(self.task)
        yield from self.path.glob(f".{task}_*layers_seeds*-*.log")
        for name in names.WRITTEN_WHOLE:
            yield from leftovers(self.path, name)
        for suffix in POLICY_SUFFIXES:
            yield from leftovers(self.policies, f"{task}_*layers_seed*{suffix}")
            yield from leftovers(self.stages, f"{task}_*layers_seed*{suffix}")
        yield from leftovers(self.videos, f"{task}_*layers.mp4")
        yield from leftovers(self.replays, f"{task}_*layers.html")

    def _set_rows(self, runs: Mapping[tuple[int, int], Sequence[Mapping[str, Any]]]) -> int:
        own = {(str(layers), str(seed)) for layers, seed in runs}
        rows, dropped = results.read(self.results)
        kept = [row for row in rows if (row["subgoal_layers"], row["seed"]) not in own]
        tested = [row for behind in runs.values() for row in behind]
        if dropped or tested or len(kept) != len(rows) or not results.is_current(self.results):
            results.rewrite(self.results, [*kept, *tested])
        return dropped

    def note_failure(self, job: Job, reason: str) -> None:
        """Keeps why a job failed whose worker goes on."""
        self.failures.mkdir(exist_ok=True)
        self.failure(job).write_text(f"{reason}\n", encoding="utf-8")

    def keep_failure(self, job: Job) -> Path:
        """Keeps what a failed worker printed, its traceback at the end; returns the file."""
        self.failures.mkdir(exist_ok=True)
        self.log(job).replace(self.failure(job))
        return self.failure(job)
