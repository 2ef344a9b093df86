"""Trains peers on our tasks: `python -m tests.bench.peers --task=ur5_reacher --seeds=100-102`.

One CSV file for each curve. A curve that is finished is not trained again, so the same command can
be given after an interruption, or with more of everything. `python -m analysis.peers` compares.
"""

import argparse
import itertools
import os
from collections.abc import Collection, Sequence
from pathlib import Path

# Read when numpy, torch and mujoco are imported.
os.environ["MUJOCO_GL"] = "disabled"
for library in ("OMP", "MKL", "OPENBLAS"):
    os.environ[f"{library}_NUM_THREADS"] = "1"

import tasks  # noqa: E402
from analysis.peers import FOLDER  # noqa: E402
from analysis.program import CommandError  # noqa: E402
from launch.asking import lists  # noqa: E402
from tests.bench.peers.agents import AGENTS, SETTINGS  # noqa: E402
from tests.bench.peers.curves import Run, train_all  # noqa: E402


def main(argv: Sequence[str] | None = None) -> None:
    """Command line: trains what is missing and says so; exit status 2 when it cannot."""
    parser = _parser()
    asked = parser.parse_args(argv)
    try:
        seeds = lists.seeds(asked.seeds)
        words = (
            _some_of("task", asked.task, tasks.ALL),
            _some_of("agent", asked.agent, AGENTS),
            _some_of("settings", asked.settings, SETTINGS),
        )
    except CommandError as error:
        parser.error(str(error))
    # All agents of a seed before the next seed: an interrupted table is one of fewer seeds.
    runs = [
        Run(task, agent, settings, seed)
        for seed, task, agent, settings in itertools.product(seeds, *words)
    ]
    every = {"minutes": asked.minutes, "episodes": asked.episodes, "test_every": asked.test_every}
    try:
        for run, trained, rows in train_all(runs, asked.output, **every):
            last = rows[-1]
            print(
                f"{run.name}: {'' if trained else 'is there already: '}"
                f"{last['success_rate']:.0%} after {last['train_episodes']} episodes, "
                f"{last['train_steps']:,} steps, {last['core_minutes']:.1f} core-minutes",
                flush=True,
            )
    except (OSError, ValueError) as error:
        parser.error(str(error))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m tests.bench.peers",
        description=__doc__,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--task", default="ur5_reacher", help=f"some of {','.join(tasks.ALL)}")
    parser.add_argument("--agent", default="sac,td3", help=f"some of {','.join(AGENTS)}")
    parser.add_argument("--settings", default="zoo,ours20", help=f"some of {','.join(SETTINGS)}")
    parser.add_argument(
        "--seeds", default="100-102", help="seeds, such as 100-102 or 3,5; 10: seeds 0 to 9"
    )
    parser.add_argument("--episodes", type=_at_least(int, 1), default=3000, help="of training")
    parser.add_argument(
        "--minutes", type=_at_least(float, 0.0), default=10.0, help="most core-minutes of a run"
    )
    parser.add_argument(
        "--test_every", type=_at_least(int, 1), default=300, help="training episodes between tests"
    )
    parser.add_argument("--output", type=Path, default=FOLDER, help="folder for the curves")
    return parser


def _at_least(kind: type, least: float):
    def convert(word: str):
        value = kind(word)
        if not value >= least:
            raise argparse.ArgumentTypeError(f"it takes a number of at least {least}, not {word}")
        return value

    return convert


def _some_of(name: str, words: str, known: Collection[str]) -> list[str]:
    chosen = words.split(",")
    for word in chosen:
        if word not in known:
            raise CommandError(f"flag --{name}={words}: give one or more of {','.join(known)}")
    return chosen


if __name__ == "__main__":
    main()
