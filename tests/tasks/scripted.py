"""Hand-written controllers, one for each task, that show the goal to be reachable.

A controller is called before each control step with the `VectorEnv` and the `VectorStep` that it
last returned; it returns actions [N, A] in natural units and keeps nothing in between.
"""

from collections.abc import Callable

import numpy as np

from tests.tasks import scripted_cartpole, scripted_pendulum, scripted_ur5, scripted_worm

SOLUTIONS: dict[str, Callable] = {
    "pendulum_climb": scripted_pendulum.actions,
    "pendulum_balance": scripted_pendulum.actions,
    "ur5_reacher": scripted_ur5.actions,
    "cartpole_swingup": scripted_cartpole.actions,
    "pick_place": scripted_worm.actions,
}


def steps_to_goal(env, controller: Callable, seeds: np.ndarray) -> np.ndarray:
    """Plays test episodes to their ends.

    Returns:
      [N] control steps to the goal, infinite where an episode ran out of steps or diverged.
    """
    step = env.reset(seeds, test=True)
    taken = np.full(env.num_envs, np.inf)
    for t in range(env.max_steps):
        running = np.isinf(taken) & ~step.diverged
        step = env.step(controller(env, step), mask=running)
        achieved = env.goal_space.achieved(step.achieved_goal, step.desired_goal)
        taken[running & achieved & ~step.diverged] = t + 1
    return taken
