"""How few control steps a task can take, by a sampling planner (`python -m tests.tasks.planner`).

The cross-entropy method over open-loop actions, warm-started with what the scripted controller
does, and asked again and again for one step fewer. Candidates are played in the vectorised
environments: the model, the goal and what happens on the way are those that agents meet, and a
rod that gets attached is carried, which `mujoco.rollout` does not know how to do.
"""

import os
import sys

os.environ.setdefault("MUJOCO_GL", "disabled")

import numpy as np

import tasks
from tests.tasks import scripted

CANDIDATES = 64  # plans played in each round
_ELITE = 8  # of them decide what the next round tries
_HOLDS = (1, 4, 16)  # steps for which a candidate's deviation from the mean stays the same
_FIRST_SPREAD, _LEAST_SPREAD = 0.5, 0.05  # standard deviations, of actions in [-1, 1]
_KNOTS, _MOST_SHIFT = 6, 10.0  # points at which a plan's timing moves, by how many steps
_SHARES = (0.0, 0.3, 1.0)  # of the usual deviation, for a plan whose timing has moved
_PATIENCE = 15  # rounds without success after which the search starts afresh from the best plan


def scripted_plan(name: str, seed: int) -> np.ndarray:
    """The scripted controller's actions [T, A], in [-1, 1], in a test episode up to its goal."""
    env = tasks.load_vector(name, 1)
    step = env.reset(np.array([seed]), test=True)
    middle, half = (env.action_high + env.action_low) / 2, (env.action_high - env.action_low) / 2
    plan: list[np.ndarray] = []
    while not env.goal_space.achieved(step.achieved_goal, step.desired_goal)[0]:
        if len(plan) == env.max_steps:
            raise RuntimeError(f"{name}: the scripted controller fails from test start {seed}")
        actions = scripted.SOLUTIONS[name](env, step)
        plan.append((actions[0] - middle) / half)
        step = env.step(actions)
    return np.array(plan)


def play(env, seed: int, plans: np.ndarray) -> tuple[np.ndarray, int | None]:
    """Plays plans [N, T, A] from the same test start until one of them reaches the goal.

    Returns:
      [N] how near each came, in thresholds in the worst dimension (at most 1 is the goal), and
      the number of steps to the goal; None if no plan reaches it.
    """
    middle, half = (env.action_high + env.action_low) / 2, (env.action_high - env.action_low) / 2
    step = env.reset(np.full(env.num_envs, seed), test=True)
    nearest = np.full(env.num_envs, np.inf)
    for t in range(plans.shape[1]):
        step = env.step(middle + half * plans[:, t])
        apart = np.abs(step.achieved_goal - step.desired_goal) / env.goal_space.threshold
        nearest = np.fmin(nearest, np.where(step.diverged, np.inf, apart.max(axis=-1)))
        achieved = env.goal_space.achieved(step.achieved_goal, step.desired_goal)
        if (achieved & ~step.diverged).any():
            return nearest, t + 1
    return nearest, None


def shorten(env, seed: int, plan: np.ndarray, rounds: int, random_state) -> np.ndarray:
    """Returns the shortest plan [T', A] found that reaches the goal of a test start as `plan` does.

    Args:
      env: vectorised environments, one for each candidate.
      seed: decides the test episode.
      plan: [T, A] in [-1, 1], which reaches the goal at its end.
      rounds: how often candidates are played.
      random_state: a numpy RandomState.
    """
    mean, spread, stale = plan, np.full(plan.shape, _FIRST_SPREAD), 0
    for _ in range(rounds):
        length = len(plan) - 1
        if stale == _PATIENCE:
            mean, spread, stale = plan, np.full(plan.shape, _FIRST_SPREAD), 0
        candidates = _candidates(plan, mean[:length], spread[:length], env.num_envs, random_state)
        nearest, steps = play(env, seed, candidates)
        order = np.argsort(nearest)
        stale += 1
        if steps is not None:
            plan, stale = candidates[order[0], :steps], 0
        elite = candidates[order[:_ELITE]]
        mean, spread = elite.mean(axis=0), np.maximum(elite.std(axis=0), _LEAST_SPREAD)
    return plan


def _candidates(plan, mean, spread, count: int, random_state) -> np.ndarray:
    """Plans [count, T, A]: half about the mean [T, A], half the best plan with another timing."""
    candidates = np.empty((count, *mean.shape))
    for i in range(count):
        hold = _HOLDS[i % len(_HOLDS)]
        drawn = random_state.normal(size=(-(-len(mean) // hold), mean.shape[1]))
        deviation = spread * np.repeat(drawn, hold, axis=0)[: len(mean)]
        if i % 2:
            candidates[i] = mean + deviation
        else:
            share = random_state.choice(_SHARES)
            candidates[i] = _retimed(plan, len(mean), random_state) + share * deviation
    return np.clip(candidates, -1.0, 1.0)


def _retimed(plan: np.ndarray, length: int, random_state) -> np.ndarray:
    """The plan [T, A] slowed here and hastened there, [length, A]: what swings up is all timing."""
    knots = np.linspace(0, len(plan) - 1, _KNOTS)
    shift = random_state.uniform(0, _MOST_SHIFT)
    moved = np.sort(knots + shift * random_state.normal(size=_KNOTS))
    source = np.interp(np.linspace(0, len(plan) - 1, length), moved, knots)
    return plan[np.rint(source).astype(int)]


def main(names, starts: int = 5, rounds: int = 90) -> None:
    """Prints a line for each task: medians over test starts of what script and planner take."""
    for name in names:
        env = tasks.load_vector(name, CANDIDATES)
        plans = [scripted_plan(name, seed) for seed in range(starts)]
        short = [
            shorten(env, seed, plan, rounds, np.random.RandomState(seed))
            for seed, plan in enumerate(plans)
        ]
        script, planner = [len(plan) for plan in plans], [len(plan) for plan in short]
        print(
            f"{name}: scripted {np.median(script):.0f} {script}, "
            f"planner {np.median(planner):.0f} {planner}",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:] or tasks.ALL)
