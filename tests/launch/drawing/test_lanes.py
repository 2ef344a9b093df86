"""Lanes: every attempt is a bar where it was, in the colour of what became of it."""

import numpy as np

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
