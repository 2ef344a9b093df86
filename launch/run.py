"""Trains agents on tasks: `python launch/run.py --task=pick_place --seeds=10`."""

import sys
from collections.abc import Sequence
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

    from launch.asking import start

    start.for_training()
    start.say_that_it_loads()

from analysis import program


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    from launch import experiment  # numpy, torch and mujoco: not what a worker's start needs
    from launch.asking import request

    return program.answer(lambda: experiment.run(request.parse(argv), argv), request.help_text)


if __name__ == "__main__":
    sys.exit(main(sys.argv))
