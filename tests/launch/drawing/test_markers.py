"""What is drawn over a picture: outlines in the levels' colours, trails that fade, signs."""

import numpy as np
import pytest
from PIL import Image

from launch.drawing import markers as markers_lib
from launch.drawing import tags
from launch.drawing.markers import Markers, goal_mark, hull, level_mark, nearest
from launch.drawing.view import View, points_of_interest

SIZE, GREY = (960, 540), 120


@pytest.fixture
def view(course) -> View:
    found = View(course.stage, None, SIZE)
    found.frame(points_of_interest(course))
    return found


def drawn(course, view, moment) -> np.ndarray:
    picture = Image.new("RGB", SIZE, (GREY,) * 3)
    Markers(course, view, 20.0, 1.0).draw(picture, moment)
    return np.asarray(picture).astype(int)


def count_of(picture, colour) -> int:
    return int((np.abs(picture - colour).max(-1) < 12).sum())


def test_every_level_has_an_outline_of_its_own(course, view):
    picture = drawn(course, view, 3.0)
    marks = [goal_mark(course), level_mark(course, 2), level_mark(course, 1)]
    assert len({mark.colour for mark in marks}) == 3
    for mark in marks:
        assert count_of(picture, mark.colour) > 200, mark.word


def test_a_marker_is_where_the_subgoal_is_that_is_pursued(course, view):
    """Of level 2, halfway through each of its subgoals."""
    mark, made = level_mark(course, 2), Markers(course, view, 20.0, 1.0)
    for subgoal in course.subgoals:
        if subgoal.level != 2:
            continue
        middle = (subgoal.step + subgoal.end_step) / 2
        outlines = [outline for outline, _ in made._outlines(mark, int(np.ceil(middle)))]
        gripper = view.pixels(np.array([subgoal.subgoal[0], 0.0, subgoal.subgoal[1]]))
        rod = view.pixels(np.array([subgoal.subgoal[2], 0.0, subgoal.subgoal[3]]))
        found = [(outline.min(0) + outline.max(0)) / 2 for outline in outlines]
        np.testing.assert_allclose(sorted(map(tuple, found)), sorted([tuple(gripper), tuple(rod)]),
                                   atol=3)  # fmt: skip


def test_trails_fade(course, view):
    made = Markers(course, view, 20.0, 1.0)
    (trail, *_) = made._trails(course.steps)
    assert len(trail) == course.steps + 1
    picture = drawn(course, view, course.steps)

    def brightness(step: int) -> float:
        x, y = trail[step].round().astype(int)
        return picture[y - 1 : y + 2, x - 1 : x + 2].mean()

    late, early = brightness(course.steps - 8), brightness(4)
    assert late > early > GREY + 5


def test_a_subgoal_that_has_just_ended_shows_what_became_of_it(course, view):
    ended = next(s for s in course.subgoals if s.level == 1 and s.outcome == "achieved")
    green = (26, 127, 55)
    at = count_of(drawn(course, view, ended.end_step), green)
    assert at > count_of(drawn(course, view, max(ended.end_step - 0.01, 0)), green)
    assert at > 100


def test_words_are_on_no_marker_nor_on_each_other(course, view):
    made = Markers(course, view, 20.0, 1.0)
    half = tags.ROOM / 2
    boxes = np.concatenate([made._boxes(mark) for mark in made._marks], axis=1)
    for step in range(1, course.steps + 1):
        words = [tag[step] for tag in made._tags]
        for index, word in enumerate(words):
            others = [np.stack([other - half, other + half]) for other in words[:index]]
            for low, high in [*boxes[step], *others]:
                assert not ((word + half > low) & (word - half < high)).all(), step


def test_words_are_drawn_where_they_were_placed_for_the_step_that_is_pursued(
    course, view, monkeypatch
):
    drawn_at = []
    monkeypatch.setattr(
        markers_lib.ink.Ink, "tag", lambda self, text, place, *_: drawn_at.append((text, place))
    )
    drawn(course, view, 20.5)
    made = Markers(course, view, 20.0, 1.0)
    expected = [(mark.word, tag[21]) for mark, tag in zip(made._marks, made._tags, strict=True)]
    assert [word for word, _ in drawn_at] == [word for word, _ in expected]
    np.testing.assert_array_equal([at for _, at in drawn_at], [at for _, at in expected])


def test_signs_of_levels_that_end_together_do_not_hide_each_other(course, view):
    """At the end the top level's subgoal is over, and the one below it."""
    made = Markers(course, view, 20.0, 1.0)
    last = [sign for sign, _ in made._fading(course.steps) if sign.step == course.steps]
    assert sorted(sign.level for sign in last) == [1, 2]
    gap = np.linalg.norm(last[0].middle - last[1].middle)
    assert gap >= last[0].radius + last[1].radius


def test_the_nearest_point_of_an_outline():
    square = np.array([[0, 0], [4, 0], [4, 4], [0, 4]], float)
    for point, expected in (((2, -3), (2, 0)), ((9, 9), (4, 4)), ((1, 2), (0, 2))):
        np.testing.assert_allclose(nearest(square, np.array(point, float)), expected)


def test_a_hull_has_the_corners_and_nothing_else():
    square = np.array([[0, 0], [4, 0], [4, 4], [0, 4]], float)
    inside = np.array([[1, 1], [2, 3], [3.9, 2]])
    found = hull(np.concatenate([inside, square]))
    assert {tuple(corner) for corner in found} == {tuple(corner) for corner in square}
    x, y = found.T
    area = abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2
    assert area == pytest.approx(16)  # in order, not crossing
