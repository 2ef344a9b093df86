"""Trains agents on tasks: `python launch/run.py --task=pick_place --seeds=10`."""

import os
import sys
from pathlib import Path


def main(argv: list[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    from launch import experiment  # these import numpy, torch and mujoco
    from launch.asking import errors, program, request

    try:
        return experiment.run(request.parse(argv), argv)
    except program.HelpRequested:
        print(request.help_text())
        return 0
    except errors.CommandError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except OSError as error:  # such as a full disk
        print(f"error: {error}; what is finished is kept", file=sys.stderr)
        return 1


def set_environment() -> None:
    """Sets what numpy, torch and mujoco read when they are imported, here and in the workers."""
    os.environ["MUJOCO_GL"] = "disabled"  # training never renders
    for library in ("OMP", "MKL", "OPENBLAS"):  # many processes of one thread beat few of many
        os.environ[f"{library}_NUM_THREADS"] = "1"


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
    set_environment()
    sys.exit(main(sys.argv))
