"""Random streams of an experiment, and the noise they feed.

There is one stream per (seed, purpose). A round's draws are made ahead and indexed by time, so no
environment or seed shifts the draws of another.
"""

import enum
from typing import NamedTuple

import numpy as np

from hac_suite.config import Config
from hac_suite.types import LevelSpec


class Purpose(enum.IntEnum):
    """What a random stream is for."""

    INITIALISE = 0
    EXPLORE = 1
    TRAIN_EPISODE = 2
    TEST_EPISODE = 3
    REPLAY = 4
    DIAGNOSE = 5


def stream(seed: int, purpose: Purpose, level: int = 0) -> np.random.Generator:
    """The stream of one (seed, purpose, level)."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(purpose, level)))


def episode_seeds(seed: int, purpose: Purpose, first: int, count: int) -> np.ndarray:
    """Seeds of episodes first, first + 1, ...: int64 [count], each in [0, 2**32)."""
    return np.array(
        [
            np.random.SeedSequence(seed, spawn_key=(purpose, episode)).generate_state(1)[0]
            for episode in range(first, first + count)
        ],
        np.int64,
    )


class Draws(NamedTuple):
    """Draws of one round of N environments; lists hold one array per level."""

    normal: list[np.ndarray]  # [N, steps, A_i] Gaussian noise of the output chosen at a step
    uniform: list[np.ndarray]  # [N, steps, A_i] in [-1, 1]: the random action
    # [N, steps] in [0, 1): the random output below random_action_rate, above level 0 below
    # random_subgoal_rate.
    explore: list[np.ndarray]
    test: list[np.ndarray]  # [N, steps] in [0, 1): below subgoal_test_rate, a subgoal test
    hindsight: list[np.ndarray]  # [N, steps, K] in [0, 1): picks for what a step completed


def draw_round(
    generators: list[np.random.Generator],
    levels: tuple[LevelSpec, ...],
    config: Config,
    steps: int,
) -> Draws:
    """Draws a round for [seeds, episodes_per_round] environments, flattened to N."""
    n = config.episodes_per_round
    draws = Draws([], [], [], [], [])
    for level in levels:
        size = (n, steps, level.action_dim)
        draws.normal.append(np.concatenate([g.standard_normal(size) for g in generators]))
        draws.uniform.append(np.concatenate([g.uniform(-1, 1, size) for g in generators]))
        draws.explore.append(np.concatenate([g.random((n, steps)) for g in generators]))
        draws.test.append(np.concatenate([g.random((n, steps)) for g in generators]))
        picks = (n, steps, config.hindsight_goals)
        draws.hindsight.append(np.concatenate([g.random(picks) for g in generators]))
    return draws


def explore(output: np.ndarray, draws: Draws, level: int, time: int, config: Config) -> np.ndarray:
    """Adds Gaussian noise to a level's output [N, A], or replaces it by a uniform action."""
    sigma = config.subgoal_noise if level else config.action_noise
    rate = config.random_subgoal_rate if level else config.random_action_rate
    noisy = np.clip(output + sigma * draws.normal[level][:, time], -1, 1)
    random = draws.explore[level][:, time] < rate
    return np.where(random[:, None], draws.uniform[level][:, time], noisy)
