"""Reads tuning studies from their journals: trials, objectives, and which parameters mattered."""

import importlib.util
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy

from analysis.reading import paper

SHUFFLES = 200
LEAST_TRIALS = 8  # complete or pruned, for an importance to say anything
TOP = 0.25  # importance is for being among this share of the trials
_NOTHING = "{folder}: holds no journals of trials; `python launch/tune.py` writes them"
_NO_OPTUNA = (
    "journals are read with optuna, which is not installed; in the repository's folder, "
    "`python -m pip install -c constraints.txt -e '.[tune]'` adds it"
)


class Spread(NamedTuple):
    """A mean over seeds and its standard error (NaN for one seed)."""

    mean: float
    error: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        error = float(scipy.stats.sem(values)) if len(values) > 1 else float("nan")
        return cls(float(np.mean(values)), error)

    def text(self, scale: float = 1.0, digits: int = 3) -> str:
        error = "" if np.isnan(self.error) else f" ± {scale * self.error:.{digits}f}"
        return f"{scale * self.mean:.{digits}f}{error}"


class Trial(NamedTuple):
    """A trial as its journal has it."""

    number: int
    state: str  # complete, pruned, fail, running, waiting
    label: str | None  # default, candidate, ...: what the study began with
    value: float  # the objective; NaN for one that is not complete
    params: Mapping[str, Any]
    cpu_hours: float
    spent: float  # core-hours of the study when it ended
    seeds: Mapping[str, float]  # the objective of each, of complete trials
    final: tuple[float, ...]  # each seed's success at its last test, mean over tasks
    minutes: float  # core-minutes for each seed and task
    last: float  # the mean success that it reported last


class Study(NamedTuple):
    """A journal: trials in the order in which they ended, those that have not come last."""

    name: str
    asked: Mapping[str, Any]  # tasks, subgoal_layers, seeds, periods, ...
    hours: float  # its budget
    trials: tuple[Trial, ...]
    importance: Mapping[str, "Importance"]  # the greatest first; none from too few trials

    @property
    def complete(self) -> list[Trial]:
        return [trial for trial in self.trials if trial.state == "complete"]

    @property
    def best(self) -> Trial | None:
        return max(self.complete, key=lambda trial: trial.value, default=None)

    @property
    def title(self) -> str:
        learner = f", {self.asked['learner']}" if self.asked.get("learner") else ""
        names = " + ".join(paper.title(task) for task in self.asked["tasks"])
        return f"{names}, {paper.agent_name(self.asked['subgoal_layers'])}{learner}"

    def started_with(self) -> list[Trial]:
        """The complete trials that have labels, the latest of each."""
        return list({t.label: t for t in self.complete if t.label}.values())


class Importance(NamedTuple):
    """How much a parameter decides whether a trial is among the best, and what chance gives."""

    share: float  # of all parameters' importance
    noise: float  # the share that 95% of shuffled studies stay below
    p: float  # the share of shuffled studies that give as much


def read(folder: Path) -> list[Study]:
    """The studies of all journals in a folder.

    Raises:
      ValueError: there are none, optuna is missing, or a file is no journal.
    """
    paths = sorted(Path(folder).glob("*.journal"))
    if not paths:
        raise ValueError(_NOTHING.format(folder=folder))
    if importlib.util.find_spec("optuna") is None:
        raise ValueError(_NO_OPTUNA)
    return [_study(path) for path in paths]


def _study(path: Path) -> Study:
    import optuna
    from optuna.storages.journal import JournalFileBackend, JournalStorage

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    try:
        storage = JournalStorage(JournalFileBackend(str(path)))
        found = optuna.load_study(study_name=None, storage=storage)
        asked, hours = found.user_attrs["asked"], float(found.user_attrs["hours"])
        trials = _trials(found.get_trials(deepcopy=False))
    except (ValueError, KeyError, AttributeError, TypeError) as error:
        raise ValueError(f"{path} is not a journal of trials: {error}") from error
    return Study(path.stem, asked, hours, trials, _importance(found))


def _trials(frozen: Sequence[Any]) -> tuple[Trial, ...]:
    def ended(trial: Any) -> tuple[bool, float]:
        when = trial.datetime_complete
        return (when is None, when.timestamp() if when else trial.number)

    trials, spent = [], 0.0
    for trial in sorted(frozen, key=ended):
        hours = trial.user_attrs.get("cpu_seconds", 0.0) / 3600
        spent += hours
        curves = trial.user_attrs.get("curves", {}).values()
        tested = [curve for curve in curves if curve["success"]]
        trials.append(
            Trial(
                trial.number,
                trial.state.name.lower(),
                trial.user_attrs.get("label"),
                float("nan") if trial.values is None else trial.value,
                {name: trial.params[name] for name in trial.params},
                hours,
                spent,
                trial.user_attrs.get("objectives", {}),
                tuple(np.mean([c["success"][-1] for c in tested], axis=0)) if tested else (),
                float(np.mean([c["minutes"][-1] for c in tested])) if tested else float("nan"),
                max(trial.intermediate_values.items(), default=(0, float("nan")))[1],
            )
        )
    return tuple(trials)


def _importance(study: Any, shuffles: int = SHUFFLES) -> dict[str, Importance]:
    """PED-ANOVA (Watanabe et al. 2023): what sets the best of complete and pruned trials apart.

    Pruned trials count as worse than complete ones, and as worse the earlier they were pruned.
    Without them, parameters whose bad values the study avoids would look unimportant. With a few
    dozen trials some parameter always looks important, so shuffled trials show how important a
    parameter looks by chance.
    """
    from optuna.trial import TrialState

    tested = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.PRUNED))
    values = _ranks(tested)
    if len(values) < LEAST_TRIALS or np.ptp(values) == 0:
        return {}
    random = np.random.default_rng(0)
    found = _shares(tested, values)
    chance = [_shares(tested, random.permutation(values)) for _ in range(shuffles)]
    return {name: _beside_chance(share, [c[name] for c in chance]) for name, share in found.items()}


def _ranks(tested: Sequence[Any]) -> np.ndarray:
    """Places of trials, the best last: pruned ones, by period and success, before complete ones."""

    def worth(trial: Any) -> tuple[bool, int, float]:
        if trial.values is not None and trial.state.name == "COMPLETE":
            return (True, 0, trial.value)
        return (False, *max(trial.intermediate_values.items()))

    found = [worth(trial) for trial in tested]
    order = sorted(set(found))
    return np.array([order.index(one) for one in found], float)


def _shares(tested: Sequence[Any], values: np.ndarray) -> dict[str, float]:
    """Each parameter's share of the importance, were the trials worth these values."""
    import optuna
    from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances

    study = optuna.create_study(direction="maximize")
    study.add_trials(
        optuna.create_trial(params=t.params, distributions=t.distributions, value=float(value))
        for t, value in zip(tested, values, strict=True)
    )
    return get_param_importances(study, evaluator=PedAnovaImportanceEvaluator(target_quantile=TOP))


def _beside_chance(share: float, chance: Sequence[float]) -> Importance:
    as_much = 1 + sum(other >= share for other in chance)
    return Importance(share, float(np.quantile(chance, 0.95)), as_much / (1 + len(chance)))
