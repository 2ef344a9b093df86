"""Chooses which policy and which test episodes of an agent to show."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

import hac_suite
import tasks
from hac_suite.algorithm import exploration
from launch.asking import settings

MOST_SEED = 2**32 - 1  # of an episode
_AT_ONCE = 8  # episodes played before it is looked whether they are enough


class Choice(NamedTuple):
    """What is shown: a policy, and the seeds of its episodes."""

    policy: hac_suite.Policy
    episodes: list[int]


def choose(paths: Sequence[str], count: int) -> Choice:
    """The first of these policies that succeeds in a test episode, else the first; its episodes.

    They are those of every test period of the policy's own seed, successful ones first.

    Raises:
      CommandError, KeyError, TypeError, ValueError: a policy cannot be loaded or run.
    """
    choices = []
    for path in paths:
        policy = hac_suite.Policy.load(path)
        seeds, success = _played(policy, count)
        order = np.argsort(~success, kind="stable")  # successes first
        choices.append(Choice(policy, [int(seed) for seed in seeds[order][:count]]))
        if success.any():
            return choices[-1]
    return choices[0]


def seeds_of_tests(policy: hac_suite.Policy, least: int = 0) -> np.ndarray:
    """Seeds of the episodes of the policy's test periods; at least so many."""
    config = settings.to_config(policy.metadata["config"])
    return exploration.episode_seeds(
        policy.metadata["seed"],
        exploration.Purpose.TEST_EPISODE,
        0,
        max(config.test_episodes, least),
    )


def _played(policy: hac_suite.Policy, enough: int) -> tuple[np.ndarray, np.ndarray]:
    """Seeds of test episodes and success in them: all, or the first with enough successes."""
    seeds = seeds_of_tests(policy, enough)
    success = np.zeros(0, bool)
    while len(success) < len(seeds) and success.sum() < enough:
        success = np.append(success, succeeds(policy, seeds[len(success) :][:_AT_ONCE]))
    return seeds[: len(success)], success


def succeeds(policy: hac_suite.Policy, seeds: np.ndarray) -> np.ndarray:
    """Whether the policy achieves the end goal in these test episodes: bool [N]."""
    env = tasks.load_vector(policy.metadata["task"], len(seeds))
    config = settings.to_config(policy.metadata["config"])
    stats = hac_suite.run_episodes(env, policy, seeds, config=config)
    env.close()
    return stats.success
