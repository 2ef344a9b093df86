"""Toys made, and episodes played in them, for the tests of others' environments."""

import numpy as np

import hac_suite
import tasks
from hac_suite.algorithm import hierarchy
from tests.tasks.worlds import toys

SEEDS = np.arange(6)


def world(num_envs=6, *, steps=30, **options):
    """Toys with these habits, and options of `from_gymnasium` (which begin with `with_`)."""
    asked = {name.removeprefix("with_"): options.pop(name) for name in [*options]
             if name.startswith("with_")}  # fmt: skip
    return tasks.from_gymnasium(lambda: toys.Point(**options), num_envs, max_steps=steps, **asked)


def towards_goal(env):
    """The actor of a flat agent that walks straight to the goal."""

    def act(observation, goal):
        return np.clip(4 * (goal - observation[:, :2] - observation[:, 2:4]), -1, 1)

    return [act]


def played(env, actors, *, config=None, draws=None, test=False, seeds=SEEDS, on_step=None):
    config = config or hac_suite.Config()
    horizons = (env.max_steps,)
    return hierarchy.collect(
        env, actors, config, horizons, draws, seeds, test=test, on_step=on_step
    )
