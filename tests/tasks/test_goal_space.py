"""Goal spaces: achievement by threshold in every dimension, and scaling to [-1, 1]."""

import numpy as np
import pytest

from tasks.goal_space import GoalSpace


def _space(**changes):
    fields = {
        "names": ("x", "speed"),
        "units": ("m", "rad/s"),
        "low": [-1.0, 0.0],
        "high": [3.0, 10.0],
        "threshold": [0.5, 2.0],
    }
    return GoalSpace(**(fields | changes))


def test_achieved_needs_every_dimension_within_its_threshold():
    space = _space()
    goal = np.array([1.0, 5.0])
    achieved = np.array([[1.5, 7.0], [1.5, 7.1], [0.49, 5.0], [0.5, 3.0]])
    np.testing.assert_array_equal(space.achieved(achieved, goal), [True, False, False, True])


def test_achieved_broadcasts_over_leading_axes():
    space = _space()
    achieved = np.zeros((4, 1, 2))
    goals = np.array([[0.0, 0.0], [0.6, 0.0], [0.0, 2.5]])
    result = space.achieved(achieved, goals)
    assert result.shape == (4, 3)
    np.testing.assert_array_equal(result, np.tile([True, False, False], (4, 1)))


def test_normalise_maps_the_bounds_to_plus_and_minus_one():
    space = _space()
    values = np.array([[-1.0, 0.0], [3.0, 10.0], [1.0, 5.0], [2.0, 2.5]])
    expected = np.array([[-1.0, -1.0], [1.0, 1.0], [0.0, 0.0], [0.5, -0.5]])
    np.testing.assert_allclose(space.normalise(values), expected)
    np.testing.assert_allclose(space.denormalise(expected), values)


@pytest.mark.parametrize(
    "changes",
    [
        {"names": ("x", "x")},
        {"units": ("m",)},
        {"low": [0.0]},
        {"low": [3.0, 0.0]},
        {"high": [np.inf, 10.0]},
        {"threshold": [0.5, 0.0]},
    ],
)
def test_inconsistent_fields_are_refused(changes):
    with pytest.raises(ValueError):
        _space(**changes)


def test_bounds_cannot_be_changed():
    with pytest.raises(ValueError):
        _space().low[0] = 7.0
