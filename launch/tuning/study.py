"""A study: trials of one agent in a journal that workers and machines share, and its budget."""

import contextlib
import functools
import os
import re
import socket
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import optuna
from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
)
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock, JournalStorage
from optuna.trial import FrozenTrial, Trial, TrialState

import hac_suite
from analysis.program import CommandError
from launch.asking import settings
from launch.tuning.space import Parameter, Space, Values

SUFFIX = ".journal"
BEAT_SECONDS = 30.0  # so often a trial says that it is alive, and what it has cost
_SILENT_SECONDS = 15 * 60.0  # a trial of another machine that says nothing for so long is dead
_TRIES = 2  # of a trial whose process was killed: the trial may be what kills it
_PRUNING = {"n_startup_trials": 5, "n_warmup_steps": 2}  # trials; periods
_NO_JOURNAL = "{path} is not a journal of trials ({error}); move it elsewhere"
_DIFFERS = (
    "{path} holds trials of another study ({differences}); repeat the flags that it was begun "
    "with, or give another --out"
)


class Asked(NamedTuple):
    """What a study's trials have in common."""

    tasks: tuple[str, ...]
    subgoal_layers: int
    learner: str | None  # None: the only one there is
    seeds: tuple[int, ...]
    periods: int

    @property
    def name(self) -> str:
        # A learner of one's own is named by its file, as in my_learner.py:MyLearner.
        learner = "_" + re.sub(r"\W+", "-", self.learner).strip("-") if self.learner else ""
        return f"{'+'.join(self.tasks)}_{self.subgoal_layers}layers{learner}"


class Study:
    """The journal's study, as one worker sees it."""

    def __init__(
        self, path: Path, asked: Asked, space: Space, hours: float, *, retries: bool = True
    ):
        """Opens the journal, or begins it with the space's starts as its first trials.

        Args:
          retries: whether starts whose trials raised an error are to be tried again.

        Raises:
          CommandError: the journal is of other tasks, seeds, ... or no journal at all.
        """
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self.path, self.asked, self.space, self.hours = path, asked, space, hours
        self.parameters = space.of(asked.subgoal_layers)
        self._lock = JournalFileOpenLock(f"{path}.claim")
        with self._alone():
            _mend(path)
            self._study = _open(path, asked.name)
            self._check_same()
            self._enqueue_starts(retries)
            if self._study.user_attrs.get("hours") != hours:
                self._study.set_user_attr("hours", hours)

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Holds what only one worker at a time may do; a dead holder loses it in half a minute."""
        self._lock.acquire()
        try:
            yield
        finally:
            with contextlib.suppress(RuntimeError):  # this machine slept, another took it
                self._lock.release()

    def _check_same(self) -> None:
        wanted = {
            **{name: _plain(value) for name, value in self.asked._asdict().items()},
            "search": self.space.text,
            "config": settings.as_json(hac_suite.Config()),
        }
        found = self._study.user_attrs.get("asked")
        if found is None:
            self._study.set_user_attr("asked", wanted)
            return
        pairs = [(name, found.get(name), wanted[name]) for name in wanted]
        differences = [
            f"{name} is {old!r} there and {new!r} here"
            for name, old, new in _flat(pairs)
            if old != new and not _is_added_start(name, old)
        ]
        if differences:
            raise CommandError(_DIFFERS.format(path=self.path, differences="; ".join(differences)))

    def _enqueue_starts(self, retries: bool) -> None:
        last = {trial.user_attrs.get("label"): trial for trial in self.trials()}
        begun = {label for label, trial in last.items() if not (retries and _raised(trial))}
        asked: list[Values] = []
        for label in self.space.starts:
            values = self.space.start(label, self.asked.subgoal_layers)
            # What sets two starts apart may do nothing for an agent with few subgoal layers.
            if label not in begun and values not in asked:
                self._study.enqueue_trial(values, {"label": label})
            asked.append(values)

    def trials(self) -> list[FrozenTrial]:
        return self._study.get_trials(deepcopy=False)

    def core_hours(self, *, but: int = -1) -> float:
        """What all trials have cost in all launches; `but`: a trial to leave out."""
        return sum(cost(trial) for trial in self.trials() if trial.number != but) / 3600

    def best(self) -> FrozenTrial | None:
        done = [trial for trial in self.trials() if trial.state == TrialState.COMPLETE]
        return max(done, key=lambda trial: trial.value or 0.0, default=None)

    def claim(self, on_dead: Callable[[FrozenTrial], None]) -> Trial | None:
        """The next trial, this worker's own; None when the budget is used up.

        Args:
          on_dead: called for each trial found to have died with its process.
        """
        with self._alone():
            self._bury_dead(on_dead)
            if self.core_hours() >= self.hours:
                return None
            trial = self._study.ask({p.name: self._distribution(p) for p in self.parameters})
            trial.set_user_attr("worker", _worker())
            return trial

    def _distribution(self, parameter: Parameter) -> BaseDistribution:
        if not parameter.range:
            return CategoricalDistribution(list(parameter.choices))
        low, high, log = parameter.range
        if isinstance(getattr(hac_suite.Config(), parameter.name), int):
            return IntDistribution(int(low), int(high), log=log)
        return FloatDistribution(low, high, log=log)

    def _bury_dead(self, on_dead: Callable[[FrozenTrial], None]) -> None:
        for trial in self.trials():
            if trial.state == TrialState.RUNNING and not _lives(trial):
                with contextlib.suppress(optuna.exceptions.UpdateFinishedTrialError, ValueError):
                    self._study.tell(trial.number, state=TrialState.FAIL)
                    tries = trial.user_attrs.get("tries", 1)
                    if tries < _TRIES:
                        self._again(trial, tries + 1)
                    on_dead(trial)

    def beat(self, trial: Trial, cpu_seconds: float) -> None:
        """Notes that a trial is alive, and its cost so far.

        Raises:
          Buried: another worker took it for dead.
        """
        self._note(trial, cpu_seconds=cpu_seconds, alive=round(time.time()))

    def _note(self, trial: Trial, **notes: Any) -> None:
        try:
            for name, value in notes.items():
                trial.set_user_attr(name, value)
        except optuna.exceptions.UpdateFinishedTrialError as error:
            raise Buried from error

    def report(self, trial: Trial, period: int, success: float) -> bool:
        """Notes a test; returns whether the trial does worse than most did at that period.

        A trial that the study began with is always carried through.
        """
        try:
            trial.report(success, period)
        except optuna.exceptions.UpdateFinishedTrialError as error:
            raise Buried from error
        return "label" not in trial.user_attrs and trial.should_prune()

    def complete(self, trial: Trial, value: float, **notes: Any) -> None:
        self._note(trial, **notes)
        self._study.tell(trial, value)

    def prune(self, trial: Trial, **notes: Any) -> None:
        self._note(trial, **notes)
        self._study.tell(trial, state=TrialState.PRUNED)

    def fail(self, trial: Trial, *, again: bool, **notes: Any) -> None:
        """Ends a trial that came to nothing; `again`: it waits to be carried out from its start."""
        self._note(trial, **notes)
        self._study.tell(trial, state=TrialState.FAIL)
        if again:
            self._again(self.trials()[trial.number], trial.user_attrs.get("tries", 1))

    def _again(self, trial: FrozenTrial, tries: int) -> None:
        values = {p.name: trial.params[p.name] for p in self.parameters if p.name in trial.params}
        values = values or trial.system_attrs.get("fixed_params", {})
        own = {"label": trial.user_attrs["label"]} if "label" in trial.user_attrs else {}
        self._study.enqueue_trial(values, {**own, "retry_of": trial.number, "tries": tries})


class Buried(Exception):
    """Another worker has given up a trial that this one still works on."""


def cost(trial: FrozenTrial) -> float:
    """CPU seconds of a trial, also of one that was killed: as it last said."""
    return float(trial.user_attrs.get("cpu_seconds", 0.0))


def _raised(trial: FrozenTrial) -> bool:
    """Whether an error ended a trial; one that was killed too often does not say how it ended."""
    return trial.state == TrialState.FAIL and "ended" in trial.user_attrs


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _flat(pairs: Sequence[tuple[str, Any, Any]]) -> Iterator[tuple[str, Any, Any]]:
    """The pairs of which both are tables, key by key.

    A field of Config that only one of two versions has does not make their studies differ.
    """
    for name, old, new in pairs:
        if isinstance(old, Mapping) and isinstance(new, Mapping):
            keys = sorted(old.keys() & new.keys() if name == "config" else {*old, *new})
            yield from _flat([(f"{name}.{key}", old.get(key), new.get(key)) for key in keys])
        else:
            yield name, old, new


def _is_added_start(name: str, old: Any) -> bool:
    """Whether the search file has a start by now that the study has yet to try."""
    return old is None and re.fullmatch(r"search\.starts\.[^.]+", name) is not None


def _open(path: Path, name: str) -> optuna.Study:
    """The study in a journal; it is begun where there is none.

    Raises:
      CommandError: the file is no journal.
    """
    sampler = optuna.samplers.TPESampler(n_startup_trials=8, multivariate=True, constant_liar=True)
    pruner = optuna.pruners.MedianPruner(**_PRUNING)
    backend = JournalFileBackend(str(path), JournalFileOpenLock(str(path)))
    try:
        storage = JournalStorage(backend)
        there = name in optuna.get_all_study_names(storage)
        begin = optuna.load_study if there else _create
        return begin(study_name=name, storage=storage, sampler=sampler, pruner=pruner)
    except (ValueError, KeyError, AttributeError, TypeError) as error:
        raise CommandError(_NO_JOURNAL.format(path=path, error=error)) from error


_create = functools.partial(optuna.create_study, direction="maximize")


def _mend(path: Path) -> None:
    """Cuts off a line that a kill left half written: nothing could be read after it.

    Raises:
      CommandError: it is no journal.
    """
    if not path.exists():
        return
    lock = JournalFileOpenLock(str(path))
    lock.acquire()
    try:
        with path.open("rb+") as file:
            text = file.read()
            if text and not text.startswith(b"{"):
                raise CommandError(_NO_JOURNAL.format(path=path, error="it begins otherwise"))
            whole = text.rfind(b"\n") + 1
            if whole < len(text):
                file.truncate(whole)
    finally:
        lock.release()


def _worker() -> dict[str, Any]:
    """Which process this is, on which machine; its start tells it from a later one of that id."""
    return {**_machine(), "pid": os.getpid(), "started": _started(os.getpid())}


def _machine() -> dict[str, Any]:
    """This machine since it was booted: two of them can have one name."""
    boot = None
    with contextlib.suppress(OSError):
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="utf-8").strip()
    return {"host": socket.gethostname(), "boot": boot}


def _started(pid: int) -> str | None:
    """When a process began, in the system's own terms; None where it cannot say."""
    with contextlib.suppress(OSError, IndexError):
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        return None if fields[0] == "Z" else fields[19]  # Z: dead, its parent has not looked yet
    return None


def _lives(trial: FrozenTrial) -> bool:
    """Whether a running trial's process is still at it."""
    worker = trial.user_attrs.get("worker")
    if worker and _machine().items() <= worker.items():
        return _exists(worker["pid"]) and _started(worker["pid"]) == worker["started"]
    begun = trial.datetime_start.timestamp() if trial.datetime_start else 0.0
    return time.time() - trial.user_attrs.get("alive", begun) < _SILENT_SECONDS


def _exists(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True  # another user's
    return True
