"""Outlined markers of goals and subgoals, the way that was taken, and what subgoals came to."""

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from PIL import Image

import hac_suite
from launch.drawing import ink
from launch.drawing.view import View, placed
from launch.pictures.course import Course
from launch.pictures.outcomes import COLOURS
from launch.pictures.subgoal_log import WORDS

_OUTCOMES = {word: outcome for outcome, word in WORDS.items()}
_FILL, _EDGE = 0.28, 0.55  # opacities
_TRAIL, _OLD_TRAIL = 0.95, 0.22  # of the latest and of the oldest part of the way
_TRAIL_SECONDS, _SIGN_SECONDS = 1.6, 0.8  # of the film, until they have faded
_MOST_EDGES = 12  # that help to see a shape: those of a box
_DIRECTIONS = 96  # in which a hull's corners are looked for
_NO_COLOUR = "#9aa0a6"
# Of a tag, in units: the middle's distance from its marker, the room it takes, its letters.
_TAG_AWAY, _TAG_ROOM, _TAG_LETTERS = np.array([36, 17]), np.array([66, 25]), 15


class Mark(NamedTuple):
    """What marks a goal: its bodies, its colour, and a word for it."""

    bodies: list[int]
    colour: ink.Colour
    word: str
    towards: tuple[float, float]  # where its tag is, from its middle


def goal_mark(course: Course) -> Mark:
    """Of the end goal."""
    return _mark(course, course.stage.goal, "goal", (0, -1))


def level_mark(course: Course, level: int) -> Mark:
    """Of what a level, 1 or higher, proposes."""
    stage = course.stage
    bodies = stage.subgoals[level - 1] if level <= len(stage.subgoals) else []
    return _mark(course, bodies, f"level {level}", (1, 0) if level > 1 else (-1, 0))


def _mark(course: Course, bodies: list[int], word: str, towards: tuple[float, float]) -> Mark:
    colour = ink.colour(course.stage.colour(bodies) or _NO_COLOUR)
    return Mark(bodies, ink.lighter(colour, 0.12), word, towards)


class Markers:
    """Draws what cannot be seen of an episode over pictures of what can."""

    def __init__(self, course: Course, view: View, steps_a_second: float, unit: float):
        """`steps_a_second` of the film, not of the task; `unit` is that of lengths, in pixels."""
        self._course, self._view = course, view
        self._rate, self._unit = steps_a_second, unit
        self._trail = view.pixels(course.trail)  # [steps + 1, B, 2]
        levels = range(course.policy.subgoal_layers, 0, -1)
        self._marks = [goal_mark(course), *(level_mark(course, level) for level in levels)]

    def draw(self, picture: Image.Image, moment: float) -> None:
        """Draws over the picture of a moment in steps."""
        now = min(max(1, math.ceil(moment)), self._course.steps)  # what is pursued on this step
        outlines = [(mark, list(self._outlines(mark, now))) for mark in self._marks]
        trails = self._trails(moment)
        points = [hull for _, hulls in outlines for hull, _ in hulls] + trails
        if not points:
            return
        pen = ink.Ink(picture, np.concatenate(points), 70 * self._unit)
        for trail in trails:
            self._draw_trail(pen, trail)
        for mark, hulls in outlines:
            self._draw_mark(pen, mark, hulls)
        self._draw_signs(pen, moment)
        self._draw_tags(pen, [(mark, hulls[0][0]) for mark, hulls in outlines if hulls])
        pen.finish()

    def _outlines(self, mark: Mark, step: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Of every body of a marker that is seen: its hull [N, 2], and edges [E, 2, 2]."""
        for body in mark.bodies:
            poses = self._course.poses[step]
            shapes = [shape for shape in self._course.stage.shapes if shape.body == body]
            if not poses.seen[body] or not shapes:
                continue
            corners = np.concatenate([shape.vertices for shape in shapes])
            edges = np.concatenate([shape.edges for shape in shapes])
            yield (
                hull(self._view.pixels(placed(corners, poses, body))),
                self._view.pixels(placed(edges[: _MOST_EDGES + 1], poses, body)),
            )

    def _draw_mark(self, pen: ink.Ink, mark: Mark, hulls: list) -> None:
        unit = self._unit
        for (one, _), (other, _) in itertools.pairwise(hulls):
            pen.line([one.mean(0), other.mean(0)], mark.colour, 1.5 * unit, _EDGE)
        for outline, edges in hulls:
            closed = [*outline, *outline[:2]]
            pen.area(outline, mark.colour, _FILL)
            if len(edges) <= _MOST_EDGES:
                for edge in edges:
                    pen.line(edge, mark.colour, 1.2 * unit, _EDGE)
            pen.line(closed, ink.PAPER, 5 * unit, 0.8)
            pen.line(closed, mark.colour, 2.8 * unit)

    def _draw_tags(self, pen: ink.Ink, marked: list[tuple[Mark, np.ndarray]]) -> None:
        """A word beside each marker; one that would cover another is moved down."""
        away, patch = _TAG_AWAY * self._unit, _TAG_ROOM * self._unit
        taken: list[np.ndarray] = []
        for mark, outline in marked:
            low, high = outline.min(0), outline.max(0)
            place = (low + high) / 2 + ((high - low) / 2 + away) * mark.towards
            place = np.clip(place, patch / 2, self._view.size - patch / 2)
            for other in sorted(taken, key=lambda other: other[1]):
                if (np.abs(place - other) < patch).all():
                    place = np.array([place[0], other[1] + patch[1]])
            taken.append(place)
            pen.tag(mark.word, place, _TAG_LETTERS * self._unit, mark.colour)

    def _trails(self, moment: float) -> list[np.ndarray]:
        """The way of each marked point until now: [N, 2] each."""
        step = int(moment)
        way = self._trail[: step + 1]
        if moment > step:
            last = self._trail[step] + (moment - step) * (self._trail[step + 1] - self._trail[step])
            way = np.concatenate([way, last[None]])
        return [way[:, body] for body in range(way.shape[1])]

    def _draw_trail(self, pen: ink.Ink, way: np.ndarray) -> None:
        age = np.arange(len(way) - 1)[::-1] / self._rate
        opacity = _OLD_TRAIL + (_TRAIL - _OLD_TRAIL) * np.clip(1 - age / _TRAIL_SECONDS, 0, 1)
        for start, end, seen in zip(way[:-1], way[1:], opacity, strict=True):
            pen.line([start, end], ink.WHITE, 3.2 * self._unit, seen)

    def _draw_signs(self, pen: ink.Ink, moment: float) -> None:
        """Ticks, crosses and dashes where subgoals have just ended."""
        for subgoal in self._course.subgoals:
            age = (moment - subgoal.end_step) / self._rate
            if not 0 <= age < _SIGN_SECONDS:
                continue
            mark = level_mark(self._course, subgoal.level)
            outline = next(self._outlines(mark, subgoal.end_step), None)
            if outline is not None:
                size = (11 if subgoal.level == 1 else 15) * self._unit
                outcome, fresh = _OUTCOMES[subgoal.outcome], 1 - age / _SIGN_SECONDS
                _draw_sign(pen, outcome, outline[0].mean(0), size, fresh)


def _draw_sign(
    pen: ink.Ink, outcome: hac_suite.Outcome, middle: np.ndarray, size: float, opacity: float
) -> None:
    pen.disc(middle, 1.12 * size, ink.WHITE, opacity)
    pen.disc(middle, size, ink.colour(COLOURS[outcome]), opacity)
    pen.sign(outcome, middle, 0.56 * size, ink.WHITE, opacity)


def hull(points: np.ndarray) -> np.ndarray:
    """Corners [M, 2] of the convex area that holds points [N, 2], in order."""
    angles = np.linspace(0, 2 * np.pi, _DIRECTIONS, endpoint=False)
    furthest = (points @ np.stack([np.cos(angles), np.sin(angles)])).argmax(0)
    return points[furthest[furthest != np.roll(furthest, 1)]]
