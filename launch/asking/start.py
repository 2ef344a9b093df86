"""What a program sets before numpy, torch and mujoco are imported: they read it only once."""

import os
import sys


def without_display() -> None:
    """For programs that load tasks: what renders does so in a process of its own."""
    os.environ["MUJOCO_GL"] = "disabled"


def for_training() -> None:
    """For programs that train, here and in their workers."""
    without_display()
    for library in ("OMP", "MKL", "OPENBLAS"):  # many processes of one thread beat few of many
        os.environ[f"{library}_NUM_THREADS"] = "1"


def say_that_it_loads() -> None:
    """Tells a person at a terminal why nothing is seen at first."""
    if sys.stderr.isatty():
        print("loading torch and MuJoCo, which takes some seconds", file=sys.stderr, flush=True)
