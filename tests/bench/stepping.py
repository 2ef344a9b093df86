"""Environment steps per second: fast path, Composer and raw MuJoCo, with the same random actions.

Raw MuJoCo does the physics of a control step and nothing else: no observations, no goals.
"""

import time
from collections.abc import Callable
from statistics import median
from typing import Any

import mujoco
import numpy as np
from dm_control import composer

import tasks
from tests.bench.repeats import REPEATS, entry, rounded

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
    """`mj_step` alone, as many times as a control step has physics steps, in each simulation."""
    env = tasks.load(name, seed=0)
    env.reset()
    spec = env.action_spec()
    actions = _actions(spec.minimum, spec.maximum, (100, NUM_ENVS))
    model, first, substeps = env.physics.model.ptr, env.physics.data.ptr, _substeps(env)
    simulations = [mujoco.MjData(model) for _ in range(NUM_ENVS)]
    max_steps = tasks.load_vector(name, 1).max_steps
    taken = 0

    def step() -> int:
        nonlocal taken
        for data, action in zip(simulations, actions[taken % len(actions)], strict=True):
            if taken % max_steps == 0:
                mujoco.mj_copyData(data, model, first)
            data.ctrl[:] = action
            mujoco.mj_step(model, data, substeps)
        taken += 1
        return NUM_ENVS

    return step


STEPPERS = {"fast path": fast_path, "Composer": composer_step, "raw mj_step": raw_mujoco}


def stepping(say: Callable[[str], None]) -> dict[str, Any]:
    """`steps_per_second` of each task, and `raw_step_ratio` of the task with the worst."""
    rates: dict[str, dict[str, list[float]]] = {}
    for name in tasks.ALL:
        say(f"environment steps, {name}")
        rates[name] = measure(name)
    ratios = {
        name: [raw / fast for raw, fast in zip(r["raw mj_step"], r["fast path"], strict=True)]
        for name, r in rates.items()
    }
    return {
        **entry("raw_step_ratio", max(ratios.values(), key=median)),
        "raw_step_environments": NUM_ENVS,
        "steps_per_second": {
            name: {kind: rounded(median(measured)) for kind, measured in of_task.items()}
            for name, of_task in rates.items()
        },
    }


def measure(name: str) -> dict[str, list[float]]:
    """Steps per second of each way to step: repeats that take turns."""
    steppers = {kind: make(name) for kind, make in STEPPERS.items()}
    rates: dict[str, list[float]] = {kind: [] for kind in steppers}
    for kind in steppers:
        _rate(steppers[kind], _SECONDS / 4)  # first steps fill caches
    for _ in range(REPEATS):  # in turn, so that a busy moment of the machine hits all alike
        for kind, step in steppers.items():
            rates[kind].append(_rate(step, _SECONDS))
    return rates


def _rate(step: Stepper, seconds: float) -> float:
    taken, start = 0, time.perf_counter()
    while (elapsed := time.perf_counter() - start) < seconds:
        taken += step()
    return taken / elapsed


def _actions(low: np.ndarray, high: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    return np.random.default_rng(0).uniform(low, high, (*shape, len(low)))


def _substeps(env: composer.Environment) -> int:
    return round(env.control_timestep() / env.physics.timestep())
