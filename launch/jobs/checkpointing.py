"""Finds where interrupted runs stand, and saves checkpoints while a worker trains."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import hac_suite
from analysis.program import CommandError
from hac_suite import checkpoint
from hac_suite.config import completed
from launch.asking import settings
from launch.folder import manifest, results
from launch.folder.agents import Agent
from launch.folder.layout import RunFolder

MOST_SECONDS_BETWEEN = 300.0
# A checkpoint waits until those before it have cost no more than this share of the time.
MOST_SHARE = 0.04
# But no longer than this: the machine may have slept, or been paused, while one was written.
MOST_SECONDS_SAVED_UP = 1800.0

_OTHER_RUN = "{file} is a checkpoint of another run ({differences}); move it elsewhere"
_LONGER_RUN = (
    "{agent}, seed {seed}: interrupted after test period {period} of a longer run; "
    "give --periods={least} or more, or remove {file}"
)
_NO_ROWS = (
    "{file} is not a checkpoint of this version: its rows do not match results.csv; remove it"
)
_OTHER_VERSIONS = (
    "{agent}: interrupted with {versions}, and with other versions the rest may differ"
)
_NO_STATE = (
    "{agent}, seed(s) {seeds}: finished after {ended} periods, and no whole checkpoint is kept to "
    "extend it to {periods}{why}; give another --out to train all {periods} periods there, or "
    "--periods={ended} to keep what there is"
)
_WITHOUT_FINAL = "more --periods will extend an earlier checkpoint, if there is one"
_RESULTS_DEPEND_ON = ("dm-control", "mujoco", "numpy", "torch")


class ResumePoint(NamedTuple):
    """An interrupted run (an agent and a seed) as its newest whole checkpoint has it."""

    train_episodes: int
    rows: list[dict[str, Any]]  # of results.csv, of the test periods so far


class Setup(NamedTuple):
    """What all seeds of an agent have in common: a checkpoint of another setup is not theirs."""

    agent: Agent
    horizons: tuple[int, ...]
    config: hac_suite.Config

    def about(self, seed: int) -> dict[str, Any]:
        """What the checkpoints of a seed say about whose they are."""
        return {
            "task": self.agent.task,
            "subgoal_layers": self.agent.subgoal_layers,
            "seed": seed,
            "horizons": list(self.horizons),
            "config": manifest.without_folders(settings.as_json(self.config)),
            "versions": manifest.versions(),
        }


class Interrupted(NamedTuple):
    """Those of an agent's seeds that have a whole checkpoint."""

    points: dict[int, ResumePoint]  # by seed
    warnings: list[str]  # what a person should know of damaged checkpoints, and of versions


def interrupted(
    folder: RunFolder,
    setup: Setup,
    seeds: Sequence[int],
    periods: int,
    *,
    other_versions: bool,
    ended: Mapping[int, int] | None = None,
) -> Interrupted:
    """Where those of the seeds stand that have a whole checkpoint.

    Args:
      periods: until which they are to be trained.
      ended: the period until which a seed is finished that was to have no more: it cannot begin
        from nothing, which would take its results away.
      other_versions: whether to go on, with a warning, from what other versions of the libraries
        left.

    Raises:
      CommandError: a checkpoint is of another run, of one that was asked for more periods, or of
        other versions that are not wanted; or a seed that has ended has none.
    """
    found, warnings, differing = {}, list[str](), set[str]()
    stuck: dict[int, list[str]] = {}  # what is wrong with the checkpoints of seeds that have ended
    for seed in seeds:
        file = folder.checkpoints_of(setup.agent.subgoal_layers, seed)
        newest, complaints = checkpoint.newest(file)
        begins = newest.train_episodes if newest else 0
        warnings += _of_damage(setup.agent, seed, begins, complaints)
        if newest is not None and begins:
            differing |= _check(file, newest, setup.about(seed))
            found[seed] = ResumePoint(begins, _rows(file, newest, setup.agent, seed))
            _check_length(file, found[seed], setup, seed, periods)
        elif ended and seed in ended:
            stuck[seed] = complaints
    if ended and stuck:
        raise CommandError(_no_state(setup.agent, stuck, ended, periods))
    if differing:
        message = _OTHER_VERSIONS.format(agent=setup.agent, versions=", ".join(sorted(differing)))
        if not other_versions:
            raise CommandError(f"{message}; install those, or resume with --other_versions")
        warnings.append(f"warning: {message}")
    return Interrupted(found, warnings)


def _of_damage(agent: Agent, seed: int, begins: int, complaints: Sequence[str]) -> list[str]:
    """Messages about a seed's damaged checkpoints."""
    if not complaints:
        return []
    then = f"resumes from episode {begins}" if begins else "no checkpoint is whole; it starts again"
    return [*(f"warning: {complaint}" for complaint in complaints), f"{agent}, seed {seed}: {then}"]


def _check_length(file: Path, point: ResumePoint, setup: Setup, seed: int, periods: int) -> None:
    """Raises CommandError where a seed has gone beyond the periods that are asked for."""
    if point.train_episodes > periods * setup.config.episodes_per_period:
        tested = len(point.rows)
        raise CommandError(
            _LONGER_RUN.format(
                agent=setup.agent, seed=seed, period=tested - 1, least=tested, file=file
            )
        )


def _no_state(
    agent: Agent, stuck: Mapping[int, Sequence[str]], ended: Mapping[int, int], periods: int
) -> str:
    """What is answered where seeds have ended from whose states nothing can be trained on."""
    least = min(ended[seed] for seed in stuck)
    own = [seed for seed in stuck if ended[seed] == least]
    why = [complaint for seed in own for complaint in stuck[seed]]
    return _NO_STATE.format(
        agent=agent,
        seeds=", ".join(map(str, own)),
        ended=least,
        periods=periods,
        why=f" ({'; '.join(why)})" if why else "",
    )


def _check(file: Path, found: checkpoint.Checkpoint, own: Mapping[str, Any]) -> set[str]:
    """Versions that differ; whatever else differs is refused."""
    there = dict(found.about)
    if isinstance(there.get("config"), dict):
        there["config"] = manifest.without_folders(completed(there["config"]))
    differences = [
        f"{name} is {there.get(name)!r} there and {own[name]!r} here"
        for name in own
        if name != "versions" and there.get(name) != own[name]
    ]
    if differences:
        raise CommandError(_OTHER_RUN.format(file=file, differences="; ".join(differences)))
    then, now = found.about.get("versions", {}), own["versions"]
    return {
        f"{name} {then.get(name)} (here {now[name]})"
        for name in _RESULTS_DEPEND_ON
        if then.get(name) != now[name]
    }


def _rows(
    file: Path, found: checkpoint.Checkpoint, agent: Agent, seed: int
) -> list[dict[str, Any]]:
    """The checkpoint's rows of results.csv; a stranger's file cannot put anything else there."""
    rows = found.numbers.get("rows")
    try:
        if not isinstance(rows, list) or not rows:
            raise ValueError("no rows")
        rows = [{"task": agent.task, **row} for row in rows]
        for period, row in enumerate(rows):
            results.check_columns(row, earlier=True)
            own = (row["task"], row["subgoal_layers"], row["seed"], row["period"])
            numbers = all(isinstance(row[name], int | float) for name in row if name != "task")
            if own != (*agent, seed, period) or not numbers:
                raise ValueError("other rows")
    except (KeyError, TypeError, ValueError) as error:
        raise CommandError(_NO_ROWS.format(file=file)) from error
    return rows


class Saver:
    """Saves the seeds that a worker trains: at test periods, and every few minutes in between."""

    def __init__(
        self,
        folder: RunFolder,
        setup: Setup,
        seeds: Sequence[int],
        start: int,
        warn: Callable[[str], None],
        *,
        keep_final: bool = True,
    ) -> None:
        """
        Args:
          start: the training episode that the seeds go on from, 0 for a new run.
          keep_final: whether the state that they end with is kept, for more periods later.
        """
        layers = setup.agent.subgoal_layers
        self._setup = setup
        self._folders = {seed: folder.checkpoints_of(layers, seed) for seed in seeds}
        self._start, self._warn, self._keep_final = start, warn, keep_final
        self._writer = self._new_writer(start or None)
        self._saved = time.monotonic()
        self._cost = 0.0  # seconds that the last checkpoint took
        self._stopping = False
        self._warned = False

    def _new_writer(self, last: int | None) -> checkpoint.Writer:
        about = [self._setup.about(seed) for seed in self._folders]
        return checkpoint.Writer(list(self._folders.values()), about, last)

    def leave_out(self, seed: int) -> None:
        """Saves this seed no more; its checkpoints stay as they are."""
        del self._folders[seed]
        self._writer = self._new_writer(self._writer.last)

    def states(self) -> Iterator[hac_suite.SeedState] | None:
        """The states to go on from, read one by one; None for a new run."""
        if not self._start:
            return None
        return (checkpoint.load(folder, self._start) for folder in self._folders.values())

    def stop(self, *_) -> None:
        """Ends the process at the next boundary, with a checkpoint. A signal handler."""
        self._stopping = True

    def at_boundary(self, boundary: hac_suite.Boundary) -> None:
        """Saves if it is time; the last time always, if that is to be kept."""
        if boundary.last:
            if self._keep_final:
                self._save(boundary)
            return
        waited = time.monotonic() - self._saved
        due = boundary.tested or waited >= MOST_SECONDS_BETWEEN
        affordable = waited >= min(self._cost / MOST_SHARE, MOST_SECONDS_SAVED_UP)
        if boundary.train_episodes and (self._stopping or (due and affordable)):
            self._save(boundary)
        if self._stopping:
            whole = self._writer.last == boundary.train_episodes
            until = "here" if whole else f"episode {self._writer.last or 0}, and nothing later"
            raise SystemExit(f"stopped by a signal; the checkpoint holds all until {until}")

    def _save(self, boundary: hac_suite.Boundary) -> None:
        """A checkpoint that cannot be written does not stop training."""
        started = time.monotonic()
        try:
            self._writer.save(boundary.states(), alone=boundary.last)
        except OSError as error:
            self._complain(boundary, error)
        self._saved = time.monotonic()
        self._cost = self._saved - started

    def _complain(self, boundary: hac_suite.Boundary, error: OSError) -> None:
        """Says once that there are no checkpoints, and always what that costs in the end."""
        before = f"from episode {self._writer.last}" if self._writer.last else "from the start"
        if boundary.last:
            self._warn(f"the final checkpoint could not be kept ({error}): {_WITHOUT_FINAL}")
        elif self._stopping:
            self._warn(
                f"stopped at episode {boundary.train_episodes}, which could not be saved "
                f"({error}); the same command resumes {before}"
            )
        elif not self._warned:
            self._warn(f"no checkpoint could be written ({error}); training continues")
        self._warned = True
