"""The sampling planner finds plans that work, in fewer steps than the scripted controller takes."""

import numpy as np
import pytest

import tasks
from tests.tasks import planner


@pytest.mark.slow
def test_a_shortened_plan_still_reaches_the_goal():
    script = planner.scripted_plan("pendulum_climb", seed=0)
    single = tasks.load_vector("pendulum_climb", 1)
    assert planner.play(single, 0, script[np.newaxis])[1] == len(script)
    env = tasks.load_vector("pendulum_climb", 32)
    plan = planner.shorten(env, 0, script, rounds=15, random_state=np.random.RandomState(0))
    assert len(plan) < 0.95 * len(script)
    assert np.abs(plan).max() <= 1.0
    nearest, steps = planner.play(single, 0, plan[np.newaxis])
    assert steps == len(plan) and nearest[0] <= 1.0
