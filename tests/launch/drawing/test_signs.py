"""Signs of what became of subgoals: those that end together are all seen."""

import numpy as np
import pytest

import hac_suite
from launch.drawing import signs
from launch.drawing.signs import Sign

SHOWN = 8.0  # steps


def sign(step: int, level: int, x: float, y: float = 50.0) -> Sign:
    return Sign(step, level, (9, 9, 9), hac_suite.Outcome.ACHIEVED, np.array([x, y]), 1.0)


def hidden(one: Sign, other: Sign) -> bool:
    boxes = one.box, other.box
    return bool((boxes[0][0] < boxes[1][1]).all() and (boxes[1][0] < boxes[0][1]).all())


@pytest.mark.parametrize("shift", [0.0, 6.0, -6.0])
def test_signs_of_levels_that_end_together_stand_side_by_side(shift):
    given = [sign(10, 1, 100 + shift), sign(10, 2, 100 - shift), sign(10, 3, 100)]
    found = signs.apart(given, SHOWN)
    assert [each.level for each in found] == [3, 2, 1]
    np.testing.assert_array_equal(found[0].middle, [100, 50])
    for index, one in enumerate(found):
        assert not any(hidden(one, other) for other in found[:index])


def test_a_sign_stands_where_its_marker_was_if_no_higher_one_is_there():
    given = [sign(3, 2, 100), sign(5, 1, 160), sign(6, 1, 161), sign(3 + int(SHOWN), 1, 100)]
    for one, other in zip(signs.apart(given, SHOWN), given, strict=True):
        np.testing.assert_array_equal(one.middle, other.middle)
