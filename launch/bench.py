"""Environment steps per second: fast path, Composer and raw MuJoCo (`python -m launch.bench`).

All step with the same random actions. Raw MuJoCo does the physics of a control step and nothing
else: no observations, no goals.
"""

import argparse
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Literal

os.environ["MUJOCO_GL"] = "disabled"

import mujoco
import numpy as np
from dm_control import composer
from rich.console import Console
from rich.table import Table

import tasks
from analysis.files import write_atomically
from launch import manifest

OUTPUT = Path(__file__).resolve().parent.parent / "analysis" / "data" / "bench_steps.json"
REPEATS = 7
NUM_ENVS = 64
_SECONDS = 0.4  # about how long one measurement takes

Stepper = Callable[[], int]  # takes some steps and returns how many


def fast_path(name: str) -> Stepper:
    """`tasks.load_vector`: what training runs on."""
    env = tasks.load_vector(name, NUM_ENVS)
    env.reset()
    actions = _actions(env.action_low, env.action_high, (100, NUM_ENVS))
    taken = 0

    def step() -> int:
        nonlocal taken
        if taken % env.max_steps == 0:
            env.reset()
        env.step(actions[taken % len(actions)])
        taken += 1
        return NUM_ENVS

    return step


def composer_step(name: str) -> Stepper:
    """`composer.Environment.step`, reset when an episode ends."""
    env = tasks.load(name, seed=0)
    spec = env.action_spec()
    actions = _actions(spec.minimum, spec.maximum, (100,))
    time_step = env.reset()
    taken = 0

    def step() -> int:
        nonlocal taken, time_step
        time_step = env.reset() if time_step.last() else env.step(actions[taken % len(actions)])
        taken += 1
        return 1

    return step


def raw_mujoco(name: str) -> Stepper:
    """`mj_step` alone, as many times as a control step has physics steps."""
    env = tasks.load(name, seed=0)
    env.reset()
    spec = env.action_spec()
    actions = _actions(spec.minimum, spec.maximum, (100,))
    model, data, substeps = env.physics.model.ptr, env.physics.data.ptr, _substeps(env)
    max_steps = tasks.load_vector(name, 1).max_steps
    start = data.qpos.copy(), data.qvel.copy()
    taken = 0

    def step() -> int:
        nonlocal taken
        if taken % max_steps == 0:
            data.qpos[:], data.qvel[:] = start
        data.ctrl[:] = actions[taken % len(actions)]
        mujoco.mj_step(model, data, substeps)
        taken += 1
        return 1

    return step


STEPPERS = {"fast path": fast_path, "Composer": composer_step, "raw mj_step": raw_mujoco}


def measure(name: str) -> dict[str, float]:
    """Steps per second of each way to step: medians of repeats that take turns."""
    steppers = {kind: make(name) for kind, make in STEPPERS.items()}
    rates: dict[str, list[float]] = {kind: [] for kind in steppers}
    for kind in steppers:
        _rate(steppers[kind], _SECONDS / 4)  # first steps fill caches
    for _ in range(REPEATS):  # in turn, so that a busy moment of the machine hits all alike
        for kind, step in steppers.items():
            rates[kind].append(_rate(step, _SECONDS))
    return {kind: median(measured) for kind, measured in rates.items()}


def main() -> None:
    """Prints a table and writes it, with the machine and the versions, as JSON."""
    parser = argparse.ArgumentParser(prog="python -m launch.bench", description=__doc__)
    parser.add_argument("--output", type=Path, default=OUTPUT, help="default: %(default)s")
    output = parser.parse_args().output
    console = Console()
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in ("task", *STEPPERS, "/ Composer", "/ raw"):
        justify: Literal["left", "right"] = "left" if heading == "task" else "right"
        table.add_column(heading, justify=justify, no_wrap=True)
    measured = {}
    for name in tasks.ALL:
        console.print(f"measuring {name}")
        measured[name] = rates = measure(name)
        fast, slow, raw = rates.values()
        cells = [f"{rate:,.0f}" for rate in rates.values()]
        table.add_row(name, *cells, f"{fast / slow:.1f}", f"{fast / raw:.2f}")
    console.print(table)
    report = {
        "unit": "control steps per second on one core",
        "environments": NUM_ENVS,
        "repeats": REPEATS,
        "machine": manifest.machine(),
        "versions": manifest.versions(),
        "steps_per_second": measured,
    }
    output.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(output, lambda path: path.write_text(json.dumps(report, indent=2) + "\n"))
    console.print(f"wrote {output}", soft_wrap=True)


def _rate(step: Stepper, seconds: float) -> float:
    taken, start = 0, time.perf_counter()
    while (elapsed := time.perf_counter() - start) < seconds:
        taken += step()
    return taken / elapsed


def _actions(low: np.ndarray, high: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    return np.random.default_rng(0).uniform(low, high, (*shape, len(low)))


def _substeps(env: composer.Environment) -> int:
    return round(env.control_timestep() / env.physics.timestep())


if __name__ == "__main__":
    main()
