"""Lanes: every attempt is a bar where it was, in the colour of what became of it."""

import numpy as np
import pytest

import hac_suite
from launch.drawing import ink, lanes
from launch.pictures.outcomes import COLOURS

WIDTH = 1280


def pixels(strip, moment) -> np.ndarray:
    return np.asarray(strip.at(moment)).astype(int)


def shows(picture, strip, row, step, colour) -> bool:
    top, _ = strip._rows(row)
    here = picture[round(top) + 3, round(strip._x(step))]
    return bool(np.abs(here - colour).max() < 6)


def test_every_attempt_is_a_bar(course):
    rows = lanes.lanes_of(course)
    assert [row.name for row in rows] == ["end goal", "level 2's subgoals", "level 1's subgoals"]
    assert sum(len(row.bars) for row in rows) == 1 + len(course.subgoals)
    strip = lanes.Strip(rows, course.steps, WIDTH, 1.0)
    picture = pixels(strip, course.steps)
    for row, lane in enumerate(rows):
        assert lane.bars[0].step == 0 and lane.bars[-1].end_step == course.steps
        for bar in lane.bars:
            colour = ink.colour(COLOURS[bar.outcome])
            assert shows(picture, strip, row, (bar.step + bar.end_step) / 2, colour)


def test_what_is_not_over_has_no_outcome_and_what_is_to_come_is_not_told(course):
    rows = lanes.lanes_of(course)
    strip = lanes.Strip(rows, course.steps, WIDTH, 1.0)
    top = rows[1].bars[1]  # the second subgoal of level 2
    now = (top.step + top.end_step) / 2
    picture = pixels(strip, now)
    first = rows[1].bars[0]
    assert shows(picture, strip, 1, first.step + 1, ink.colour(COLOURS[first.outcome]))
    assert shows(picture, strip, 1, (top.step + now) / 2, lanes._dim(rows[1].colour))
    assert shows(picture, strip, 1, (now + top.end_step) / 2, lanes._GROOVE)
    top_edge = picture[3]  # above the lanes there is the cursor alone
    (cursor,) = {round(x) for x in np.flatnonzero((top_edge == 255).all(-1))[:1]}
    assert abs(cursor - strip._x(now)) <= 2


def test_an_agent_without_subgoals_has_a_lane_for_its_end_goal(course):
    flat = course._replace(subgoals=[])
    rows = lanes.lanes_of(flat, layers=2)
    assert [len(row.bars) for row in rows] == [1, 0, 0]
    lost = lanes.lanes_of(course._replace(success=False))[0].bars[0]
    assert lost.outcome == hac_suite.Outcome.MISSED


@pytest.mark.parametrize("unit", [0.3, 1.0, 1.5])
def test_numbers_lie_on_no_words(course, monkeypatch, unit):
    words = []

    def write(draw, text, place, size, fill=ink.WHITE, anchor="lm"):
        if not text.isdigit():
            words.append((place[0], place[0] + ink.length(text, size), place[1]))

    monkeypatch.setattr(ink, "write", write)
    width, moments = round(WIDTH * unit), np.linspace(0, course.steps, 6).round()
    strip = lanes.Strip(lanes.lanes_of(course), course.steps, width, unit)
    strip.at(course.steps, moments)
    middle, radius = sum(strip._rows(0)) / 2, lanes._BADGE * unit
    beside = [(left, right) for left, right, y in words if abs(y - middle) < radius]
    assert len(beside) == 2  # the lane's name, and what became of it
    for left, right in beside:
        for moment in moments:
            assert not left < strip._x(moment) + radius or not strip._x(moment) - radius < right


def test_signs_of_bars_lie_beside_numbers_and_their_lines(course, monkeypatch):
    """Where all bars end in the middle of the picture there is a number on the end goal's."""
    signs = []
    monkeypatch.setattr(
        lanes, "_draw_sign", lambda draw, outcome, middle, size: signs.append((*middle, size))
    )
    strip = lanes.Strip(lanes.lanes_of(course), course.steps, WIDTH, 1.0)
    moments = np.linspace(0, course.steps, 7)
    strip.at(course.steps, moments)
    top = sum(strip._rows(0)) / 2
    assert sum(y == top for _, y, _ in signs) == 1 and len(signs) > 15
    for x, y, size in signs:
        room = size + (lanes._BADGE if y == top else 0)
        assert min(abs(x - strip._x(moment)) for moment in moments) >= room


def test_a_count_keeps_to_the_picture(course):
    """However many subgoals there were."""
    bars = [lanes.Bar(step, step + 1, hac_suite.Outcome.ACHIEVED) for step in range(1200)]
    many = [lanes.Lane("end goal", (9, 9, 9), bars[:1]), lanes.Lane("level 1", (9, 9, 9), bars)]
    picture = pixels(lanes.Strip(many, 1200, WIDTH, 1.0), 1200)
    assert (picture[:, -4:] == ink.PAPER).all()
