"""Writes the workers' reports into the run folders; no other code writes results.csv."""

import contextlib
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import hac_suite
from analysis.figures.success import write_figure
from analysis.reading.schema import KEY
from analysis.report.index import INDEX, write_index
from launch.asking.console import Console
from launch.folder import manifest, results
from launch.folder.agents import Job
from launch.folder.layout import RunFolder
from launch.jobs.messages import Failed, Finished, SeedFailed, Started, Tested, Warned, WorkerLost
from launch.jobs.progress import Board

if TYPE_CHECKING:
    from launch.folder import scalars

_SECONDS_BETWEEN_FIGURES = 20.0


class Recorder:
    """The run folders of a launch while it trains.

    Attributes:
      failures: why each failed job failed, or each seed of its own.
    """

    def __init__(
        self,
        folders: Mapping[str, RunFolder],
        manifests: Mapping[str, manifest.Manifest],
        console: Console,
        tensorboard: bool = False,
        keep_final: bool = True,
    ) -> None:
        self.folders = dict(folders)
        self.manifests = dict(manifests)
        self.failures: dict[Job, str] = {}
        self._console = console
        self._tensorboard, self._keep_final = tensorboard, keep_final
        self._scalars: dict[str, scalars.Scalars] = {}
        self._drawn = dict.fromkeys(folders, -_SECONDS_BETWEEN_FIGURES)  # long ago
        self._outdated: set[str] = set()  # tasks whose figure lacks rows
        self._periods: dict[Job, int] = {}  # the last that each job tested
        self._at_work = {folder.path.name for folder in self.folders.values()}
        self._recorded: set[tuple] = set()  # keys of the rows that this launch's runs have

    def prepare(
        self, task: str, runs: Mapping[tuple[int, int], Sequence[Mapping[str, Any]]]
    ) -> None:
        """Readies a folder for the runs that are about to start or to go on, as it has them."""
        folder = self.folders[task]
        dropped = folder.prepare(runs)
        self._recorded |= {_key(row) for row in results.read(folder.results)[0]}
        if dropped:
            self._console.say(
                f"warning: dropped {dropped} line(s) of {folder.results}, cut short by a kill"
            )
        manifest.write(folder.manifest, self.manifests[task])
        if self._tensorboard:
            self._begin_scalars(task)

    def _begin_scalars(self, task: str) -> None:
        from launch.folder import scalars  # needs an optional package

        with self._warning_of_scalars(task):
            self._scalars[task] = scalars.Scalars(self.folders[task])

    @contextlib.contextmanager
    def _warning_of_scalars(self, task: str) -> Iterator[None]:
        """Curves that cannot be written are no reason to stop training."""
        try:
            yield
        except Exception as error:
            self._scalars.pop(task, None)
            self._console.say(f"warning: {task}: no more curves for TensorBoard: {error}")

    def receive(self, board: Board, job: Job, message: Any) -> None:
        """Records one message of a job."""
        if isinstance(message, Started):
            board.started(job)
        elif isinstance(message, hac_suite.Progress):
            board.progressed(job, message.train_episodes, message.success_rate)
        elif isinstance(message, Tested):
            self._tested(board, job, message)
        elif isinstance(message, Warned):
            self._console.say(f"warning: {job.agent}: {message.text}")
        elif isinstance(message, SeedFailed):
            self._seed_failed(job, message)
        elif isinstance(message, WorkerLost):
            self._console.say(f"warning: {job.agent}: lost with its machine ({message.reason})")
        elif isinstance(message, Finished):
            seeds = self.unfailed(job)
            board.ended(job, "done" if seeds else "failed")
            if seeds:
                self._finished(job._replace(seeds=seeds), message, self._periods[job])
        elif isinstance(message, Failed):
            board.ended(job, "failed")
            self._failed(job, message)
        else:
            raise TypeError(f"job {job.name} sent {message!r}")

    def tick(self) -> None:
        """To be called often: draws figures that lack rows, each every few seconds at most."""
        for task in sorted(self._outdated):
            if time.monotonic() - self._drawn[task] >= _SECONDS_BETWEEN_FIGURES:
                self._draw(task)

    def close(self, *, stopped: bool) -> None:
        """Draws the final figures; notes when the launch finished, if it was not stopped."""
        self._at_work = set()
        for task, folder in self.folders.items():
            self._draw(task)
            if task in self._scalars:
                self._scalars[task].close()
            if not stopped:
                self.manifests[task]["finished"] = manifest.now()
            manifest.write(folder.manifest, self.manifests[task])

    def _tested(self, board: Board, job: Job, message: Tested) -> None:
        self.add(job, message.rows)
        success = sum(row["success_rate"] for row in message.rows) / len(message.rows)
        board.progressed(job, message.rows[0]["train_episodes"], success)
        self._periods[job] = message.period

    def add(self, job: Job, rows: Sequence[Mapping[str, Any]]) -> None:
        """Adds those rows that are not there: a job that began again repeats some of its own."""
        folder = self.folders[job.agent.task]
        rows = [row for row in rows if _key(row) not in self._recorded]
        if not rows:
            return
        folder.check_ours()
        results.append(folder.results, rows)
        self._recorded |= {_key(row) for row in rows}
        self._outdated.add(folder.task)
        if folder.task in self._scalars:
            with self._warning_of_scalars(folder.task):
                self._scalars[folder.task].add(rows)

    def unfailed(self, job: Job) -> tuple[int, ...]:
        """The job's seeds, but for those that failed alone."""
        return tuple(s for s in job.seeds if job._replace(seeds=(s,)) not in self.failures)

    def _finished(self, job: Job, message: Finished, periods: int) -> None:
        task, subgoal_layers = job.agent
        record = {
            "subgoal_layers": subgoal_layers,
            "seeds": list(job.seeds),
            "from_episode": job.start,
            "periods": periods,
            "seconds": round(message.seconds, 1),
        }
        # Not before now: until its last rows are in the file, a run can be needed again.
        if not self._keep_final:
            self.folders[task].drop_checkpoints((subgoal_layers, seed) for seed in job.seeds)
        self.manifests[task]["jobs"].append(record)
        manifest.write(self.folders[task].manifest, self.manifests[task])

    def _seed_failed(self, job: Job, message: SeedFailed) -> None:
        alone = job._replace(seeds=(message.seed,))
        with contextlib.suppress(OSError):
            self.folders[job.agent.task].note_failure(alone, message.reason)
        self._add_failure(alone, message.reason)

    def _failed(self, job: Job, message: Failed) -> None:
        self.folders[job.agent.task].keep_failure(job)
        self._add_failure(job, message.reason)

    def _add_failure(self, job: Job, reason: str) -> None:
        task, subgoal_layers = job.agent
        self.failures[job] = reason
        record = {
            "subgoal_layers": subgoal_layers,
            "seeds": list(job.seeds),
            "reason": reason,
        }
        self.manifests[task]["failures"].append(record)
        with contextlib.suppress(OSError):  # a full disk failed it, and fails this: others go on
            manifest.write(self.folders[task].manifest, self.manifests[task])

    def _draw(self, task: str) -> None:
        """Refreshes the figure and the page over all runs.

        A figure that cannot be drawn does not stop training.
        """
        folder = self.folders[task]
        runs = folder.path.parent
        for path, draw in (
            (folder.figure, lambda: write_figure(folder.path)),
            (runs / INDEX, lambda: write_index(runs, self._at_work)),
        ):
            try:
                draw()
            except Exception as error:
                self._console.say(f"warning: {path} was not updated: {error}")
        self._outdated.discard(task)
        self._drawn[task] = time.monotonic()


def _key(row: Mapping[str, Any]) -> tuple:
    """What a row of results.csv is of; one that was read holds text."""
    task, *numbers = (row[column] for column in KEY)
    return (task, *map(int, numbers))
