"""Trains agents with one choice changed at a time: `python launch/ablate.py --task=TASK`."""

import dataclasses
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

    from launch.asking import start

    start.for_training()

from absl import flags

import hac_suite
from analysis import program
from analysis.program import CommandError, unknown
from launch import experiment
from launch.asking import request
from launch.asking.request import Request

_OUT = "runs/ablations"
_SAME_WORK = ("batch_size", "updates_per_episode")  # not compared: the same in every variant

_HELP = """Runs ablations: trains the same agents once per variant, with one choice of HAC changed.

  python launch/ablate.py --task=pendulum_balance --subgoal_layers=1 --seeds=5 --periods=5

writes a run folder for each variant: {out}/VARIANT/TASK.
`python -m analysis.ablations --data={out}` compares them.

Variants: {variants}

Flags:
{flags}
  --config=launch/configs/paper.py    hyperparameters; each variant changes some

Keys for --config.KEY=VALUE are those of launch/run.py.

The same command resumes, and trains only what is missing. Exit status: the worst of those that
launch/run.py would give for the variants."""


def _choices_of(preset: str) -> dict[str, Any]:
    """A preset's values where presets differ, but for how much is learnt from an episode.

    So a variant is the same whichever preset --config gives.
    """
    every = [dataclasses.asdict(config) for config in hac_suite.PRESETS.values()]
    own = dataclasses.asdict(hac_suite.PRESETS[preset])
    differ = {name: own[name] for name in own if any(one[name] != own[name] for one in every)}
    return {name: value for name, value in differ.items() if name not in _SAME_WORK}


VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "paper": {},
    "release_2018": _choices_of("release_2018"),
    "release_2020": _choices_of("release_2020"),
    "no_subgoal_tests": {"subgoal_test_rate": 0.0},
    "no_hindsight_actions": {"hindsight_actions": False},
    "no_hindsight_goals": {"hindsight_goals": 0},
    "penalise_cut_short": {"penalise_cut_short": True},
    "bf16": {"precision": "bf16"},
}
"""What each variant changes in the config."""
_ONLY_ASKED = ("bf16",)  # not every processor has it

Run = Callable[[Request, Sequence[str]], int]


def main(argv: Sequence[str], *, run: Run = experiment.run) -> int:
    """Carries out a command; returns the exit status that --help states.

    Args:
      run: carries out a request, as `experiment.run` does.
    """

    def train() -> int:
        values = _flags()
        asked = request.read(values, argv, request.CONFIGS / "paper.py")
        return _train(asked, _named(values.variants), argv, run)

    return program.answer(train, _help_text)


def _help_text() -> str:
    own_flags, names = program.describe(_flags()), ", ".join(VARIANTS)
    return _HELP.format(flags=own_flags, out=_OUT, variants=names)


def _flags() -> flags.FlagValues:
    """Those of launch/run.py, with other defaults, and --variants."""
    values = request.define_flags()
    values.set_default("out", _OUT)
    values["out"].help = "folder for the variants' run folders"
    values.set_default("video", False)
    flags.DEFINE_list("variants", _usual(), "which to train", flag_values=values)
    return values


def _usual() -> list[str]:
    return [name for name in VARIANTS if name not in _ONLY_ASKED]


def _named(words: Sequence[str]) -> Sequence[str]:
    if not words:
        raise CommandError(f"flag --variants=: give one or more of {', '.join(VARIANTS)}")
    for word in words:
        if word not in VARIANTS:
            raise CommandError(unknown("variant", word, VARIANTS))
    return words


def _changed(config: hac_suite.Config, variant: str) -> hac_suite.Config:
    """Raises CommandError where the variant cannot have the rest of the config."""
    try:
        return dataclasses.replace(config, **VARIANTS[variant])
    except ValueError as error:
        raise CommandError(f"variant {variant}: {error}; leave it out of --variants") from error


def _train(asked: Request, variants: Sequence[str], command: Sequence[str], run: Run) -> int:
    """Carries out the request for each variant, in a folder of its own; the worst exit status."""
    worst, configs = 0, {variant: _changed(asked.config, variant) for variant in variants}
    for config in configs.values():
        request.check_precision(asked._replace(config=config))
    for variant, config in configs.items():
        print(f"==> {variant}", flush=True)
        own = asked._replace(config=config, out=asked.out / variant)
        status = run(own, [*command, f"--variants={variant}"])
        worst = max(worst, status)
        if status not in (0, 1):  # a signal is for all
            break
    return worst


if __name__ == "__main__":
    sys.exit(main(sys.argv))
