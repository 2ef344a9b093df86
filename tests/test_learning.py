"""A real task is learnt by the real engine, to a bar: minutes, so among the slow tests."""

import functools

import numpy as np
import pytest

import hac_suite
import tasks

TASK = "pendulum_climb"


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("subgoal_layers", [1, 2])
def test_agents_learn_to_swing_the_pendulum_up(subgoal_layers):
    max_steps = tasks.load_vector(TASK, 1).max_steps
    results = hac_suite.train(
        functools.partial(tasks.load_vector, TASK),
        hac_suite.PRESETS["paper"],
        [0, 1, 2],
        subgoal_layers=subgoal_layers,
        horizons=hac_suite.horizons(max_steps, subgoal_layers),
        periods=2,
    )
    first, *_, last = (np.mean([row["success_rate"] for row in r.rows]) for r in results)
    assert first < 0.1
    assert last > 0.7
