"""Words beside markers: on no marker and on no other word, and still while their marker is."""

import numpy as np
import pytest

from launch.drawing import tags
from launch.drawing.tags import Owner

SIZE, UNIT, STEPS = np.array([640, 360]), 1.0, 12
HALF = tags.ROOM * UNIT / 2
NOTHING = np.zeros((STEPS + 1, 0, 2, 2))


def standing(*boxes: tuple[float, float, float, float]) -> np.ndarray:
    """Boxes left, top, right, bottom that stay where they are: [steps + 1, B, 2, 2]."""
    return np.tile(np.reshape(boxes, (1, -1, 2, 2)).astype(float), (STEPS + 1, 1, 1, 1))


def pile(middle: tuple[float, float]) -> list[Owner]:
    """A goal, and in it the subgoals of two levels; the lowest level makes three attempts."""
    x, y = middle
    goal = standing((x - 40, y - 40, x + 40, y + 40))
    high = standing((x - 20, y - 22, x + 30, y + 22), (x - 5, y + 20, x + 5, y + 90))
    low = standing((x - 10, y - 10, x + 10, y + 10))
    low[5:, :, :, 0] += 30
    return [
        Owner(goal, [(0, STEPS)], (0, -1)),
        Owner(high, [(1, STEPS)], (1, 0)),
        Owner(low, [(1, 4), (5, 8), (9, STEPS)], (-1, 0)),
    ]


def covers(place: np.ndarray, box: np.ndarray) -> bool:
    return bool((place + HALF > box[0]).all() and (place - HALF < box[1]).all())


@pytest.mark.parametrize("middle", [(320, 180), (30, 30), (610, 330), (320, 10)])
def test_words_in_a_pile_cover_no_marker_and_no_other_word(middle):
    owners = pile(middle)
    fixed = np.array([[[250, 300], [390, 360]]], float)
    found = tags.middles(owners, NOTHING, fixed, SIZE, UNIT)
    for step in range(1, STEPS + 1):
        places = [own[step] for own in found]
        for index, place in enumerate(places):
            assert (place - HALF >= 0).all() and (place + HALF <= SIZE).all()
            for box in [*(box for owner in owners for box in owner.boxes[step]), *fixed]:
                assert not covers(place, box), (index, step)
            for other in places[:index]:
                assert not covers(place, np.stack([other - HALF, other + HALF]))


def test_a_word_stands_still_as_long_as_its_marker_does():
    """The other levels' markers come and go meanwhile."""
    goal, high, low = pile((320, 180))
    low.boxes[5:9, :, :, 1] -= 60  # where the goal's word was
    for owner, own in zip(
        (goal, high, low), tags.middles([goal, high, low], NOTHING, NOTHING[0], SIZE, UNIT),
        strict=True,
    ):  # fmt: skip
        for first, last in owner.attempts:
            assert (own[first : last + 1] == own[first]).all()


def test_a_word_goes_along_with_a_marker_that_moves():
    boxes = standing((100, 100, 120, 120))
    boxes[..., 0] += 10.0 * np.arange(STEPS + 1)[:, None, None]
    (own,) = tags.middles([Owner(boxes, [(0, STEPS)], (0, 1))], NOTHING, NOTHING[0], SIZE, UNIT)
    np.testing.assert_allclose(np.diff(own, axis=0), [[10, 0]] * STEPS)
    assert own[0][0] == 110 and 120 < own[0][1] - HALF[1] < 126  # below, as it should be


def test_a_sign_is_hidden_only_for_want_of_room():
    owner = Owner(standing((300, 170, 320, 190)), [(0, STEPS)], (1, 0))
    free, aside = (
        tags.middles([owner], signs, NOTHING[0], SIZE, UNIT)[0][0]
        for signs in (NOTHING, standing((340, 170, 360, 190)))
    )
    assert covers(free, np.array([[340, 170], [360, 190]]))
    assert not covers(aside, np.array([[340, 170], [360, 190]]))


def test_a_marker_that_is_not_seen_has_its_word_nowhere_and_is_in_nobodys_way():
    seen, unseen = pile((320, 180))[:2]
    unseen.boxes[:] = np.nan
    alone = tags.middles([seen], NOTHING, NOTHING[0], SIZE, UNIT)
    both = tags.middles([seen, unseen], NOTHING, NOTHING[0], SIZE, UNIT)
    np.testing.assert_array_equal(both[0], alone[0])
    assert np.isnan(both[1]).all()
