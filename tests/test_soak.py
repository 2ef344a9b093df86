"""Hours of use in minutes: nothing grows with the number of resets, frames or steps."""

import gc
import os
from pathlib import Path

import numpy as np
import pytest

import tasks

_RESETS = 10_000
_STEPS = 1_000_000
_MOST_GROWTH = 8  # MiB, of a process of several hundred


def memory() -> float:
    """Resident MiB."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def open_files() -> int:
    return len(os.listdir("/proc/self/fd"))


@pytest.mark.slow
@pytest.mark.requires_gl
@pytest.mark.parametrize("name", tasks.ALL)
def test_resets_and_frames_leave_nothing_behind(name):
    env = tasks.load(name, seed=0)
    resets = _RESETS // len(tasks.ALL)
    for reset in range(resets):
        env.reset()
        env.physics.render(height=48, width=64, camera_id=reset % 2)
        if reset == resets // 4:  # caches are full by now
            before = memory(), open_files()
    assert memory() - before[0] < _MOST_GROWTH
    assert open_files() == before[1]
    env.close()


@pytest.mark.slow
@pytest.mark.parametrize("name", tasks.ALL)
def test_steps_leave_nothing_behind(name):
    n = 64
    env = tasks.load_vector(name, n, seed=0)
    random, everyone = np.random.default_rng(0), np.ones(n, bool)
    steps = _STEPS // len(tasks.ALL) // n
    env.reset(np.arange(n))
    for step in range(steps):
        if step and step % env.max_steps == 0:
            env.reset(np.arange(step, step + n))
        env.step(
            random.uniform(env.action_low, env.action_high, (n, len(env.action_low))), everyone
        )
        if step == steps // 4:
            before = memory(), open_files()
    assert memory() - before[0] < _MOST_GROWTH
    assert open_files() == before[1]
    env.close()
