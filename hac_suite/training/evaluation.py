"""Noise-free test episodes (Section 4.2)."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hac_suite.algorithm.hierarchy import StepView, collect
from hac_suite.algorithm.record import Round
from hac_suite.config import PAPER, Config
from hac_suite.policy import Policy
from hac_suite.types import VectorEnv, level_specs


class EpisodeStats(NamedTuple):
    """How each of N episodes ended."""

    success: np.ndarray  # bool [N]
    steps: np.ndarray  # int [N]: actions taken, to the goal where it was achieved
    diverged: np.ndarray  # bool [N]
    outcomes: np.ndarray  # int [levels, N, 4]: how many subgoals of a level came to each Outcome

    @classmethod
    def of(cls, run: Round) -> "EpisodeStats":
        return cls(run.success, run.steps, run.diverged, run.outcomes)


def run_episodes(
    env: VectorEnv,
    policy: Policy,
    seeds: np.ndarray,
    *,
    config: Config = PAPER,
    on_step: Callable[[StepView], None] | None = None,
) -> EpisodeStats:
    """Runs a policy from the test distribution, one episode in each environment.

    Args:
        seeds: int [N]; each determines its episode's start and goal.
        config: only `test_until_horizon` matters here.
        on_step: called before the first action and after each one.
    """
    actors = policy.actors(level_specs(env, policy.horizons))
    run = collect(
        env, actors, config, policy.horizons, None, np.asarray(seeds), test=True, on_step=on_step
    )
    return EpisodeStats.of(run)
