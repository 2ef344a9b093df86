"""What is drawn over a picture: outlines in the levels' colours, trails that fade, signs."""

import numpy as np
import pytest
from PIL import Image

from launch.drawing import markers as markers_lib
from launch.drawing.markers import Markers, goal_mark, hull, level_mark
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
    mark = level_mark(course, 2)
    for subgoal in course.subgoals:
        if subgoal.level != 2:
            continue
        middle = (subgoal.step + subgoal.end_step) / 2
        made = Markers(course, view, 20.0, 1.0)
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


@pytest.mark.slow
def test_words_do_not_cover_each_other(course, view, monkeypatch):
    places = []
    monkeypatch.setattr(
        markers_lib.ink.Ink, "tag", lambda self, text, centre, *_: places.append(np.array(centre))
    )
    for moment in range(course.steps):
        places.clear()
        drawn(course, view, float(moment))
        assert len(places) == 3
        for index, place in enumerate(places):
            for other in places[:index]:
                assert (np.abs(place - other) >= [50, 18]).any(), moment


def test_a_hull_has_the_corners_and_nothing_else():
    square = np.array([[0, 0], [4, 0], [4, 4], [0, 4]], float)
    inside = np.array([[1, 1], [2, 3], [3.9, 2]])
    found = hull(np.concatenate([inside, square]))
    assert {tuple(corner) for corner in found} == {tuple(corner) for corner in square}
    x, y = found.T
    area = abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2
    assert area == pytest.approx(16)  # in order, not crossing
