"""Replay rings and the layout of their rows."""

import numpy as np
import pytest
import torch

from hac_suite.algorithm.transitions import REGULAR, Transitions
from hac_suite.learning.replay import Replay, RowLayout
from hac_suite.types import LevelSpec
from tasks.goal_space import GoalSpace

GOALS = GoalSpace(("x",), ("m",), np.array([0.0]), np.array([4.0]), np.array([0.1]))
SPEC = LevelSpec(np.array([1.0, 10.0]), GOALS, action_dim=1, attempts=5)


def test_a_row_by_hand():
    made = Transitions(
        env=np.array([0]),
        kind=np.array([REGULAR]),
        observation=np.array([[0.5, 20.0]]),
        action=np.array([[0.25]]),
        reward=np.array([-1.0]),
        next_observation=np.array([[0.75, 30.0]]),
        goal=np.array([[1.0]]),
        discount=np.array([0.5]),
    )
    (row,) = RowLayout.of(SPEC).pack(made, SPEC)
    now, after = [0.25, 0.5, 2.0, -0.5, 1.0], [0.0, 0.75, 3.0, -0.5, 1.0]
    assert row.tolist() == [*now, *after, -1.0, 0.5]


def rows(*first_entries: int) -> np.ndarray:
    made = np.zeros((len(first_entries), RowLayout.of(SPEC).width), np.float32)
    made[:, 0] = first_entries
    return made


def test_the_oldest_rows_give_way():
    replay = Replay(2, 4, RowLayout.of(SPEC))
    replay.add(1, rows(1, 2, 3))
    replay.add(1, rows(4, 5))
    assert replay.rows[1, :, 0].tolist() == [5, 2, 3, 4]
    replay.add(1, rows(*range(6, 16)))  # more than a ring holds: the last four stay
    assert sorted(replay.rows[1, :, 0].tolist()) == [12, 13, 14, 15]
    replay.add(1, rows(16))
    assert sorted(replay.rows[1, :, 0].tolist()) == [13, 14, 15, 16]
    assert replay.sizes.tolist() == [0, 4]
    assert not replay.rows[0].any()


def test_samples_are_uniform_over_what_a_seed_holds():
    replay = Replay(2, 100, RowLayout.of(SPEC))
    replay.add(0, rows(*range(5)))
    replay.add(1, rows(*range(20)))
    chosen = replay.sample_indices([np.random.default_rng(s) for s in (1, 2)], 50, 40).numpy()
    first, second = chosen[:, 0], chosen[:, 1]
    assert np.bincount(first.ravel()) == pytest.approx(np.full(5, 400), rel=0.2)
    assert np.bincount(second.ravel()) == pytest.approx(np.full(20, 100), rel=0.4)


def test_batches_are_the_rows_of_the_seeds_chosen_from():
    replay = Replay(3, 10, RowLayout.of(SPEC))
    for seed in range(3):
        replay.add(seed, rows(*(100 * seed + n for n in range(10))))
    indices = torch.tensor([[[0, 9, 3], [1, 1, 2]], [[5, 5, 5], [8, 7, 6]]])
    found = [batch[..., 0].tolist() for batch in replay.batches(indices, start=1)]
    assert found == [
        [[100, 109, 103], [201, 201, 202]],
        [[105, 105, 105], [208, 207, 206]],
    ]
