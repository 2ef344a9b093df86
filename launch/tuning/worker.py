"""Workers: each carries out trials of the study, one after another, until the budget is used up."""

import math
import multiprocessing
import signal
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import torch
from optuna.trial import FrozenTrial, Trial

import hac_suite
import tasks
from launch.asking import settings
from launch.folder import manifest
from launch.jobs.local import StopSignal
from launch.tuning import space, trial
from launch.tuning.space import Space
from launch.tuning.study import BEAT_SECONDS, Asked, Buried, Study

_FAILURES = 3  # trials in a row that raise: then it is no setting that is wrong
_GRACE_SECONDS = 60.0


class Plan(NamedTuple):
    """What every worker of a launch is given."""

    path: Path  # the journal
    asked: Asked
    space: Space
    hours: float
    train: trial.Train
    horizons: dict[str, tuple[int, dict[int, tuple[int, ...]]]]  # by task: max_steps, T of its own
    commit: str | None


class _Stopped(Exception):
    """A signal ended the launch, or the process that began it is gone."""


class _OutOfBudget(Exception):
    """The trial in hand would cost more than the study has left."""


def horizons_of(names: tuple[str, ...]) -> dict[str, tuple[int, dict[int, tuple[int, ...]]]]:
    """By task, its control steps, and the T of its own that it has for some agents."""
    specs = {name: tasks.spec(name) for name in names}
    return {name: (spec.max_steps, dict(spec.horizons)) for name, spec in specs.items()}


def carry_out(plan: Plan, workers: int, stop: StopSignal) -> int:
    """Works on the study with this process and `workers - 1` more.

    Returns:
      How many trials failed, and workers with them.
    """
    study = Study(plan.path, plan.asked, plan.space, plan.hours)
    _say(f"{plan.path}: {len(study.trials())} trials, {_of_budget(study.core_hours(), plan.hours)}")
    context = multiprocessing.get_context("spawn")
    others = [context.Process(target=_other, args=(plan,)) for _ in range(workers - 1)]
    for process in others:
        process.start()
    failures = 0
    try:
        failures = _work(study, plan, lambda: stop.number is not None)
        while stop.number is None and any(process.is_alive() for process in others):
            time.sleep(0.2)
    finally:
        for process in others:
            process.terminate()
        for process in others:
            process.join(timeout=_GRACE_SECONDS)
            process.kill()
            process.join()
    for process in others:
        if process.exitcode not in (0, None):
            failures += 1
            _say(f"a worker ended early, with exit status {process.exitcode}")
    _say(_best_so_far(study))
    return failures


def _other(plan: Plan) -> None:
    """The whole life of a worker that the launch's own process began."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all; the parent ends its workers
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: ended.append(number))
    parent = multiprocessing.parent_process()
    assert parent is not None
    study = Study(plan.path, plan.asked, plan.space, plan.hours, retries=False)
    failures = _work(study, plan, lambda: bool(ended) or not parent.is_alive())
    raise SystemExit(1 if failures else 0)


def _work(study: Study, plan: Plan, stopped: Callable[[], bool]) -> int:
    """Carries out trials until the budget is used up; returns how many raised an error."""
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    failures = in_a_row = 0
    while not stopped() and in_a_row < _FAILURES:
        claimed = study.claim(_say_dead)
        if claimed is None:
            break
        failed = _Trial(study, plan, claimed, stopped).run()
        failures += failed
        in_a_row = in_a_row + 1 if failed else 0
    return failures


class _Trial:
    """A trial from its claim to its place in the journal."""

    def __init__(self, study: Study, plan: Plan, claimed: Trial, stopped: Callable[[], bool]):
        self._study, self._plan, self._claimed, self._stopped = study, plan, claimed, stopped
        self._name = f"trial {claimed.number}"
        self._began, self._beat = time.process_time(), time.monotonic()
        self._curves: list[trial.Curve] = []
        self._others = study.core_hours(but=claimed.number)

    def run(self) -> bool:
        """Carries it out; returns whether it raised an error."""
        claimed = self._claimed
        label = claimed.user_attrs.get("label")
        values = " ".join(f"{name}={_short(value)}" for name, value in claimed.params.items())
        _say(f"{self._name}{f' ({label})' if label else ''}: {values}")
        try:
            return self._carry_out()
        except Buried:
            _say(f"{self._name}: abandoned, because another worker declared it dead")
            return False

    def _carry_out(self) -> bool:
        study, claimed = self._study, self._claimed
        try:
            self._train()
        except _Stopped:
            study.fail(claimed, again=True, ended="stopped", **self._record())
            _say(f"{self._name}: stopped; the next launch starts it again")
        except _OutOfBudget:
            study.fail(claimed, again=True, ended="budget", **self._record())
            _say(f"{self._name}: ended, the budget is used up; with more --hours it starts again")
        except (Buried, OSError):  # OSError: the journal cannot be written, such as to a full disk
            raise
        except Exception as error:
            why = f"{type(error).__name__}: {error}".splitlines()[0]
            traceback.print_exc()
            study.fail(claimed, again=False, ended=why, **self._record())
            _say(f"{self._name}: failed: {why}")
            return True
        return False

    def _train(self) -> None:
        study, claimed, plan = self._study, self._claimed, self._plan
        study.beat(claimed, 0.0)
        periods = plan.asked.periods
        for curves in trial.train(self._agents(), plan.train, self._on_round):
            self._curves = curves
            self._on_round()
            period = len(curves[0].success) - 1
            success = sum(curve.mean() for curve in curves) / len(curves)
            if period == 0:
                continue
            study.beat(claimed, self._cpu_seconds())
            prune = study.report(claimed, period, success)
            _say(f"{self._name}: period {period} of {periods}: {self._line(success)}")
            if prune and period < periods:
                study.prune(claimed, **self._record())
                _say(f"{self._name}: pruned, below the median at period {period}")
                return
        values = trial.values(self._curves, plan.space.core_minutes * periods)
        value = sum(values.values()) / len(values)
        notes = {**self._record(), "objectives": {s: round(v, 4) for s, v in values.items()}}
        study.complete(claimed, value, **notes)
        _say(f"{self._name}: objective {value:.3f}; {_best_so_far(study)}")

    def _agents(self) -> list[trial.Agent]:
        asked = self._plan.asked
        chosen, attempts = space.settings_of(self._study.parameters, self._claimed.params)
        if asked.learner:
            chosen["learner"] = asked.learner
        config = settings.to_config({**settings.as_json(hac_suite.Config()), **chosen})
        layers = asked.subgoal_layers
        return [
            trial.Agent(
                task,
                layers,
                space.horizons(max_steps, layers, attempts, own),
                config,
                asked.seeds,
                asked.periods,
            )
            for task, (max_steps, own) in self._plan.horizons.items()
        ]

    def _on_round(self) -> None:
        if self._stopped():
            raise _Stopped
        if time.monotonic() - self._beat >= BEAT_SECONDS:
            self._beat = time.monotonic()
            self._study.beat(self._claimed, self._cpu_seconds())
            self._others = self._study.core_hours(but=self._claimed.number)
        if self._others + self._cpu_seconds() / 3600 >= self._plan.hours:
            raise _OutOfBudget

    def _cpu_seconds(self) -> float:
        """What it has cost, never nothing; it has no processes of its own."""
        return math.ceil(1000 * (time.process_time() - self._began)) / 1000

    def _record(self) -> dict:
        """What stays in the journal of a trial, however it ended."""
        own = {"commit": self._plan.commit, "versions": manifest.versions()}
        return {"curves": trial.as_json(self._curves), **own, "cpu_seconds": self._cpu_seconds()}

    def _line(self, success: float) -> str:
        each = ", ".join(f"{curve.agent.task} {curve.mean():.0%}" for curve in self._curves)
        tasks_said = f" ({each})" if len(self._curves) > 1 else ""
        spent = self._others + self._cpu_seconds() / 3600
        return f"success {success:.0%}{tasks_said}; {_of_budget(spent, self._plan.hours)}"


def _say(text: str) -> None:
    print(text, flush=True)


def _say_dead(dead: FrozenTrial) -> None:
    again = "" if dead.user_attrs.get("tries", 1) > 1 else "; it is started again"
    _say(f"trial {dead.number}: its process was killed{again}")


def _short(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value).replace(" ", "-")


def _of_budget(spent: float, hours: float) -> str:
    return f"{60 * spent:.1f} of {60 * hours:g} core-minutes used"


def _best_so_far(study: Study) -> str:
    best = study.best()
    if best is None:
        return f"no trial is finished; {_of_budget(study.core_hours(), study.hours)}"
    label = f" ({best.user_attrs['label']})" if "label" in best.user_attrs else ""
    return f"best so far {best.value:.3f} of trial {best.number}{label}"
