"""Tunes an agent within a budget: `python launch/tune.py --task=pick_place --subgoal_layers=1`."""

import importlib.util
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from absl import flags

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

    from launch.asking import start

    start.for_training()

import hac_suite
import tasks
from analysis import program
from analysis.program import CommandError
from analysis.reading import schema
from hac_suite.learning import learners
from launch.asking import lists, settings
from launch.folder import manifest
from launch.jobs.local import StopSignal
from launch.tuning import space
from launch.tuning.trial import Train

_OUT = "analysis/data/tuning"
_FIRST_SEED = 100  # those below are for published results, and those are not tuned on
_STOPPING = b"\nstopping: the trials in hand end, the journal is kept; once more quits at once\n"

_HELP = """Tunes an agent's hyperparameters, within a budget of core-hours that all launches share.

  python launch/tune.py --task=cartpole_swingup,pick_place --subgoal_layers=2 --hours=3

Each trial trains all seeds of the tasks with hyperparameters from the search space in
{search}. Its objective combines success against episodes and success against
CPU time. Trials worse than most are pruned. The first trials are those that the file lists as
starts, such as the defaults. OUT/TASKS_LAYERSlayers.journal keeps the trials; launches on other
machines may share it. `python -m analysis.tuning` shows which hyperparameters mattered.

Flags:
{flags}

The same command continues a study until its budget is used up; more --hours extend it. It tries
starts again whose trials failed.
Exit status: 0 the budget is used up; 1 some trials failed, the others are kept; 2 the command was
wrong; 128+n signal n stopped it (130 after Ctrl-C), finished trials are kept."""


class Request(NamedTuple):
    """What one launch is to do."""

    tasks: tuple[str, ...]
    subgoal_layers: int
    learner: str | None
    seeds: tuple[int, ...]
    periods: int
    hours: float
    workers: int
    out: Path
    space: space.Space


def main(argv: Sequence[str], *, train: Train = hac_suite.train) -> int:
    """Carries out a command; returns the exit status that --help states.

    Args:
      train: trains an agent, as `hac_suite.train` does; importable, since workers are spawned.
    """
    values = _flags()
    text = _HELP.replace("{search}", os.path.relpath(space.FILE))
    return program.carry_out(
        program.Program(text, values), argv, lambda _: tune(_request(values), train)
    )


def tune(asked: Request, train: Train) -> int:
    """Works on the study until its budget is used up; returns the exit status.

    Raises:
      CommandError: the journal is of another study.
    """
    from launch.tuning import worker  # these import optuna, which is optional
    from launch.tuning.study import SUFFIX, Asked

    study = Asked(asked.tasks, asked.subgoal_layers, asked.learner, asked.seeds, asked.periods)
    plan = worker.Plan(
        path=asked.out / f"{study.name}{SUFFIX}",
        asked=study,
        space=asked.space,
        hours=asked.hours,
        train=train,
        horizons=worker.horizons_of(asked.tasks),
        commit=manifest.commit(),
    )
    asked.out.mkdir(parents=True, exist_ok=True)
    with StopSignal(_STOPPING) as stop:
        failures = worker.carry_out(plan, asked.workers, stop)
        if stop.number is not None:
            print("stopped; finished trials are kept, and the same command resumes the study")
            return 128 + stop.number
    return 1 if failures else 0


def _flags() -> flags.FlagValues:
    values = flags.FlagValues()
    flags.DEFINE_list(
        "task",
        "cartpole_swingup",
        "one or more tasks; each trial trains on all of them",
        flag_values=values,
    )
    program.define_count(
        values,
        "subgoal_layers",
        1,
        "number of subgoal layers; 0: the flat agent",
        least=0,
        most=schema.MAX_LEVELS - 1,
    )
    flags.DEFINE_string(
        "learner", None, "ddpg, td3 or FILE.py:CLASS; default: that of the configuration", values
    )
    flags.DEFINE_string("seeds", "100-103", "seeds, such as 100-103 or 105,107", values)
    program.define_count(values, "periods", 5, "test periods per trial", least=1)
    flags.DEFINE_float(
        "hours", 1.0, "budget of the study in core-hours, over all launches", flag_values=values
    )
    program.define_count(
        values, "workers", 1, "trials that run at the same time", least=1, most=1000
    )
    flags.DEFINE_string("search", os.path.relpath(space.FILE), "what is varied", values)
    flags.DEFINE_string("out", _OUT, "folder for the journals of studies", values)
    return values


def _request(values: flags.FlagValues) -> Request:
    if importlib.util.find_spec("optuna") is None:
        raise CommandError(
            "optuna is not installed; in the repository's folder, "
            "`python -m pip install -c constraints.txt -e '.[tune]'` adds it"
        )
    if not 0 < values.hours < math.inf:
        raise CommandError(f"flag --hours={values.hours:g}: give a number of core-hours above zero")
    return Request(
        tasks=_tasks(values.task),
        subgoal_layers=values.subgoal_layers,
        learner=_learner(values.learner),
        seeds=_seeds(values.seeds),
        periods=values.periods,
        hours=values.hours,
        workers=values.workers,
        out=_out(values.out),
        space=space.read(Path(values.search)),
    )


def _tasks(words: Sequence[str]) -> tuple[str, ...]:
    names = tuple(name for word in words for name in lists.tasks_named(word.strip()))
    if own := [name for name in names if name not in tasks.ALL]:
        raise CommandError(f"flag --task: {own[0]} is in a file; give tasks of the suite")
    if not names or len(set(names)) < len(names):
        raise CommandError(f"flag --task={','.join(words)}: give each task once")
    return names


def _seeds(word: str) -> tuple[int, ...]:
    seeds = lists.seeds(word)
    if min(seeds) < _FIRST_SEED:
        raise CommandError(
            f"flag --seeds={word} names seed {min(seeds)}: seeds below {_FIRST_SEED} are for "
            "published results; tune on other seeds, as in "
            f"--seeds={_FIRST_SEED}-{_FIRST_SEED + 3}"
        )
    return seeds


def _learner(name: str | None) -> str | None:
    if name is None:
        return None
    settings.to_config({**settings.as_json(hac_suite.Config()), "learner": name})
    try:
        learners.find(name)
    except ValueError as error:
        raise CommandError(f"flag --learner={name}: {error}") from error
    return name


def _out(name: str) -> Path:
    if not name.isprintable() or not name:
        raise CommandError(f"flag --out={name!r}: give a name of printable characters")
    path = Path(name)
    for existing in (path, *path.parents):
        if existing.exists() and not existing.is_dir():
            raise CommandError(f"flag --out={name}: {existing} is no folder")
    return path


if __name__ == "__main__":
    sys.exit(main(sys.argv))
