"""Trains agents with one choice changed at a time: `python launch/ablate.py --task=TASK`."""

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from absl import flags

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from launch import run
from launch.asking import program
from launch.asking.errors import CommandError, unknown

_OUT = "runs/ablations"
# The releases differ from the text in a number of choices at once; batches and updates are not
# among those compared, and are the same everywhere.
_SAME_WORK = ("--config.batch_size=256", "--config.updates_per_episode=20")
_CONFIGS = os.path.relpath(Path(__file__).parent / "configs")
VARIANTS: Mapping[str, tuple[str, ...]] = {
    "paper": (),
    "release_2018": (f"--config={_CONFIGS}/release_2018.py", *_SAME_WORK),
    "release_2020": (f"--config={_CONFIGS}/release_2020.py", *_SAME_WORK),
    "no_subgoal_tests": ("--config.subgoal_test_rate=0",),
    "no_hindsight_actions": ("--config.hindsight_actions=False",),
    "no_hindsight_goals": ("--config.hindsight_goals=0",),
    "penalise_cut_short": ("--config.penalise_cut_short=True",),
}

_HELP = """Trains the same agents again and again, each time with one choice of HAC changed.

  python launch/ablate.py --task=pendulum_balance --subgoal_layers=1 --seeds=5 --periods=5

leaves a run folder for each variant: {out}/VARIANT/TASK. Flags that are not named here are those of
launch/run.py. `python -m analysis.ablations --data={out}` compares what there is.

Variants: {variants}

Flags:
{flags}

The same command again finishes what is missing. Exit status: as launch/run.py, the worst of all."""


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = _flags()
    own = [word for word in argv[1:] if _name(word) in values]
    rest = [word for word in argv[1:] if word not in own]
    try:
        program.parse(values, [argv[0], *own, *(w for w in rest if w in ("--help", "-h"))])
        for variant in values.variants:
            if variant not in VARIANTS:
                raise CommandError(unknown("variant", variant, VARIANTS))
    except program.HelpRequested:
        own_flags, names = program.describe(values), ", ".join(VARIANTS)
        print(_HELP.format(flags=own_flags, out=_OUT, variants=names))
        return 0
    except CommandError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    worst = 0
    for variant in values.variants:
        print(f"==> {variant}", flush=True)
        words = [*rest, f"--out={values.out}/{variant}", "--video=false", *VARIANTS[variant]]
        status = run.main(["launch/run.py", *words])
        worst = max(worst, status)
        if status not in (0, 1):  # a wrong command is wrong for all; a signal is for all
            break
    return worst


def _flags() -> flags.FlagValues:
    values = flags.FlagValues()
    flags.DEFINE_string("out", _OUT, "holds a folder for each variant", values)
    flags.DEFINE_list("variants", list(VARIANTS), "which to train", values)
    return values


def _name(word: str) -> str:
    return word.lstrip("-").partition("=")[0]


if __name__ == "__main__":
    run.set_environment()
    sys.exit(main(sys.argv))
