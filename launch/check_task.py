"""Checks a user's task: `python launch/check_task.py FILE:name`."""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from absl import flags, logging

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

    from launch.asking import start

    start.die_with_the_parent()  # where it is the one that renders
    if "--still_only" not in sys.argv:
        start.without_display()

import imageio.v3 as iio
import numpy as np

import tasks
from analysis import program
from analysis.program import CommandError
from launch.asking import start
from launch.asking.console import Console
from tasks.authoring.check import Finding, findings

_HELP = """Checks a dm_control task of your own before you train on it, and says how to fix it.

  python launch/check_task.py path/to/arm.py:arm_reach

It also renders one picture of a test episode's start, in the task's first camera.

Flags:
{flags}

Exit status: 0 nothing is wrong; 1 something is; 2 the command was wrong."""
_COLOURS = {"good": "green", "doubtful": "yellow", "wrong": "red"}
_BACKENDS = ("egl", "osmesa")
_SECONDS = 120


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = flags.FlagValues()
    flags.DEFINE_string("still", None, "file for the picture; default: NAME.png", values)
    flags.DEFINE_boolean("still_only", False, "only render, with the GL of MUJOCO_GL", values)
    check = program.Program(_HELP, values, words="one task, as in path/to/arm.py:arm_reach")
    return program.carry_out(check, argv, lambda words: _check(words[0], values))


def _check(word: str, values: flags.FlagValues) -> int:
    if word.startswith("gym:") or word.endswith(".toml"):
        raise CommandError(
            f"{word}: this program checks dm_control tasks; use `python launch/fit.py` for this one"
        )
    try:
        entry = tasks.find(word)
    except ValueError as error:
        raise CommandError(str(error)) from error
    still = Path(values.still or f"{entry.name}.png")
    if values.still_only:
        return _render(entry, still)
    console, wrong = Console(), False
    logging.set_verbosity(logging.ERROR)  # dm_control warns of what is a finding here
    for finding in findings(entry):
        _show(finding, console)
        wrong = wrong or finding.verdict == "wrong"
    if not wrong:
        finding = _still(word, still)
        _show(finding, console)
        wrong = finding.verdict == "wrong"
    return 1 if wrong else 0


def _show(finding: Finding, console: Console) -> None:
    console.print(finding.verdict, style=_COLOURS[finding.verdict], end="  ")
    console.say(finding.text)
    if finding.remedy:
        console.say(f"          {finding.remedy}")


def _still(word: str, path: Path) -> Finding:
    """Renders in a process of its own: what renders cannot be chosen once MuJoCo is imported."""
    problems = []
    for backend in _BACKENDS:
        command = [sys.executable, __file__, word, f"--still={path}", "--still_only"]
        environment = {**os.environ, "MUJOCO_GL": backend, "PYOPENGL_PLATFORM": backend}
        with start.child(command, environment) as process:
            try:
                _, printed = process.communicate(timeout=_SECONDS)
            except subprocess.TimeoutExpired:
                problems.append(f"{backend}: no picture within {_SECONDS} s")
                continue
        if process.returncode == 0:
            return Finding("good", f"{path}: a picture of a test start")
        if process.returncode == 1:
            return Finding(
                "wrong",
                f"{path}: the picture shows a single colour",
                "point the first camera at the scene, and add a light",
            )
        lines = printed.strip().splitlines() or [f"exit status {process.returncode}"]
        problems.append(f"{backend}: {lines[-1].strip()}")
    return Finding(
        "doubtful",
        f"no picture could be rendered: {'; '.join(problems)}",
        "`python launch/doctor.py` says what rendering needs",
    )


def _render(entry, path: Path) -> int:
    env = entry.load_vector(1)
    env.reset(np.array([0]), test=True)
    picture = env.render(0)
    env.close()
    path.parent.mkdir(parents=True, exist_ok=True)
    iio.imwrite(path, picture)
    return 0 if picture.std() > 2 else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv))
