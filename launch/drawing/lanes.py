"""The strip under a picture: a lane for every level, a bar for every attempt, a cursor for now."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

import hac_suite
from launch.drawing import ink
from launch.drawing.markers import goal_mark, level_mark
from launch.pictures.course import Course
from launch.pictures.outcomes import COLOURS
from launch.pictures.subgoal_log import WORDS

_OUTCOMES = {word: outcome for outcome, word in WORDS.items()}
_LANE, _AXIS, _PADDING = 30, 26, 8  # heights, in units
_LABEL, _COUNT = 190, 150  # widths beside the bars, in units
_BADGE = 11  # radius of a number's patch, in units
_GROOVE: ink.Colour = (44, 44, 51)
_UNDECIDED = 0.25  # how much of a marker's colour a bar has that is not over yet


class Bar(NamedTuple):
    """An attempt at a goal."""

    step: int
    end_step: int
    outcome: hac_suite.Outcome


class Lane(NamedTuple):
    """The goals of one level, one after another."""

    name: str
    colour: ink.Colour  # of their marker
    bars: list[Bar]


def lanes_of(course: Course, layers: int | None = None) -> list[Lane]:
    """The end goal's lane, then the levels', the highest first; `layers` of them, perhaps empty."""
    reached = hac_suite.Outcome.ACHIEVED if course.success else hac_suite.Outcome.MISSED
    end = Lane("end goal", goal_mark(course).colour, [Bar(0, course.steps, reached)])
    layers = course.policy.subgoal_layers if layers is None else layers
    return [end, *(_of_level(course, level) for level in range(layers, 0, -1))]


def _of_level(course: Course, level: int) -> Lane:
    bars = [
        Bar(subgoal.step, subgoal.end_step, _OUTCOMES[subgoal.outcome])
        for subgoal in sorted(course.subgoals, key=lambda subgoal: subgoal.step)
        if subgoal.level == level
    ]
    return Lane(f"level {level}'s subgoals", level_mark(course, level).colour, bars)


def height(lanes: int, unit: float, key: bool = True) -> int:
    """Of a strip, in pixels."""
    return round((2 * _PADDING + lanes * _LANE + (_AXIS if key else 0)) * unit)


class Strip:
    """Draws the lanes of an episode at any moment of it."""

    def __init__(
        self,
        lanes: Sequence[Lane],
        steps: int,
        width: int,
        unit: float,
        *,
        names: bool = True,
        key: bool = True,
    ):
        """Makes what does not change.

        Args:
          lanes: top to bottom.
          steps: that the axis is long.
          width: in pixels.
          unit: of lengths, in pixels: 1 for a picture 720 high.
          names: whether the lanes' names and counts are beside them.
          key: whether the axis and the key of outcomes are below them.
        """
        self._lanes, self._steps, self._unit, self._names = lanes, max(steps, 1), unit, names
        self._left = round((_LABEL if names else _PADDING) * unit)
        self._right = width - round((_COUNT if names else _PADDING) * unit)
        size = width, height(len(lanes), unit, key)
        self._blank = Image.new("RGB", size, ink.PAPER)
        draw = ImageDraw.Draw(self._blank)
        for row, lane in enumerate(lanes):
            self._draw_groove(draw, row, lane)
        if key:
            self._draw_axis(draw)

    def _draw_groove(self, draw: ImageDraw.ImageDraw, row: int, lane: Lane) -> None:
        top, bottom, unit = *self._rows(row), self._unit
        if lane.bars:
            draw.rectangle((self._left, top, self._right, bottom), _GROOVE)
        if self._names:
            middle = (top + bottom) / 2
            box = (12 * unit, middle - 7 * unit, 26 * unit, middle + 7 * unit)
            draw.rounded_rectangle(box, 3 * unit, lane.colour)
            place = 34 * unit, middle
            ink.write(draw, lane.name, place, 17 * unit)
        elif lane.bars:
            draw.rectangle((2 * unit, top, 2 * unit + 4, bottom), lane.colour)

    def _draw_axis(self, draw: ImageDraw.ImageDraw) -> None:
        unit = self._unit
        y = (_PADDING + len(self._lanes) * _LANE + 3) * unit
        for step in range(0, self._steps + 1, _tick(self._steps)):
            x = self._x(step)
            draw.line((x, y, x, y + 4 * unit), ink.QUIET, max(1, round(unit)))
            said = "step 0" if step == 0 else f"{step}"
            ink.write(draw, said, (x, y + 5 * unit), 14 * unit, ink.QUIET, "ma")

    def at(self, moment: float, numbered: Sequence[float] | np.ndarray = ()) -> Image.Image:
        """The strip at a moment in steps; instead of a cursor, perhaps numbers at moments."""
        strip = self._blank.copy()
        draw = ImageDraw.Draw(strip)
        for row, lane in enumerate(self._lanes):
            for bar in lane.bars:
                if bar.step < moment or bar.step == 0:
                    self._draw_bar(draw, row, lane, bar, moment)
                if bar.end_step <= moment:
                    self._draw_outcome(draw, row, bar, numbered)
            if self._names:
                self._draw_count(draw, row, lane, moment)
        for number, cursor in enumerate(numbered, start=1):
            self._draw_cursor(draw, cursor, f"{number}")
        if not len(numbered):
            self._draw_cursor(draw, moment)
        return strip

    def _draw_cursor(self, draw: ImageDraw.ImageDraw, moment: float, number: str = "") -> None:
        x, unit = self._x(min(moment, self._steps)), self._unit
        bottom = (_PADDING + len(self._lanes) * _LANE) * unit
        draw.line((x, 2 * unit, x, bottom + 2 * unit), ink.WHITE, max(1, round(2 * unit)))
        if number:
            middle = x, (_PADDING + _LANE / 2) * unit
            draw.circle(middle, _BADGE * unit, ink.WHITE)
            ink.write(draw, number, middle, 16 * unit, ink.PAPER, "mm")

    def _draw_bar(
        self, draw: ImageDraw.ImageDraw, row: int, lane: Lane, bar: Bar, moment: float
    ) -> None:
        top, bottom = self._rows(row)
        left, right = self._x(bar.step), self._x(min(bar.end_step, moment))
        gap = min(1.5 * self._unit, (self._x(bar.end_step) - left) / 4)
        box = (left + gap, top + 1, max(right - gap, left + gap), bottom - 1)
        if moment < bar.end_step:
            draw.rectangle(box, _dim(lane.colour), lane.colour, max(1, round(self._unit)))
            return
        draw.rectangle(box, ink.colour(COLOURS[bar.outcome]))

    def _draw_outcome(
        self,
        draw: ImageDraw.ImageDraw,
        row: int,
        bar: Bar,
        numbered: Sequence[float] | np.ndarray,
    ) -> None:
        """The sign of a bar that has room for it: in its middle, or beside a number there."""
        left, right, size = self._x(bar.step), self._x(bar.end_step), 5.5 * self._unit
        middle, clear = (left + right) / 2, 1.7 * size
        beside = clear + (_BADGE * self._unit if row == 0 else 0)
        for cursor in map(self._x, numbered):
            if abs(middle - cursor) < beside:
                middle = cursor + beside if middle >= cursor else cursor - beside
        if left + clear < middle < right - clear:
            _draw_sign(draw, bar.outcome, (middle, sum(self._rows(row)) / 2), size)

    def _draw_count(self, draw: ImageDraw.ImageDraw, row: int, lane: Lane, moment: float) -> None:
        ended = [bar for bar in lane.bars if bar.end_step <= moment]
        if not ended:
            return
        made = sum(bar.outcome == hac_suite.Outcome.ACHIEVED for bar in ended)
        said = f"{made} of {len(ended)} achieved" if row else WORDS[ended[0].outcome]
        unit, away = self._unit, _BADGE + 5
        place = self._right + away * unit, sum(self._rows(row)) / 2
        ink.write_within(draw, said, place, 15 * unit, (_COUNT - away - 6) * unit, ink.QUIET)

    def _rows(self, row: int) -> tuple[float, float]:
        top = (_PADDING + row * _LANE) * self._unit
        return top + 2 * self._unit, top + (_LANE - 2) * self._unit

    def _x(self, step: float) -> float:
        return self._left + (self._right - self._left) * step / self._steps


def draw_names(
    draw: ImageDraw.ImageDraw, lanes: Sequence[Lane], left: float, middle: float, unit: float
) -> None:
    """Whose the lanes are, top to bottom, in a line that begins at `left`."""
    for lane in lanes:
        box = (left, middle - 7 * unit, left + 14 * unit, middle + 7 * unit)
        draw.rounded_rectangle(box, 3 * unit, lane.colour)
        left += 20 * unit
        ink.write(draw, lane.name, (left, middle), 15 * unit, ink.QUIET)
        left += ink.length(lane.name, 15 * unit) + 18 * unit


def draw_key(draw: ImageDraw.ImageDraw, right: float, middle: float, unit: float) -> float:
    """What the bars' colours mean, in a line that ends at `right`; returns where it begins."""
    for outcome in reversed(COLOURS):
        right = ink.write_right(draw, WORDS[outcome], right, middle, 15 * unit) - 24 * unit
        box = (right, middle - 8 * unit, right + 16 * unit, middle + 8 * unit)
        draw.rectangle(box, ink.colour(COLOURS[outcome]))
        _draw_sign(draw, outcome, (right + 8 * unit, middle), 5 * unit)
        right -= 18 * unit
    return right


def _draw_sign(
    draw: ImageDraw.ImageDraw, outcome: hac_suite.Outcome, middle: tuple[float, float], size: float
) -> None:
    for stroke in ink.SIGNS[outcome]:
        points = [(middle[0] + size * x, middle[1] + size * y) for x, y in stroke]
        draw.line(points, ink.WHITE, max(1, round(size / 2.6)))


def _dim(colour: ink.Colour) -> ink.Colour:
    """What is not decided yet: the colour on the way to the groove's."""
    red, green, blue = (
        round(_UNDECIDED * part + (1 - _UNDECIDED) * dark)
        for part, dark in zip(colour, _GROOVE, strict=True)
    )
    return red, green, blue


def _tick(steps: int) -> int:
    """Steps between two numbers of the axis: about six of them."""
    return next(
        (step for step in (1, 2, 5, 10, 20, 25, 50, 100, 200, 250, 500) if steps / step <= 7), 1000
    )
