"""Outlined markers of goals and subgoals, trails, and outcomes of subgoals."""

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from PIL import Image

from launch.drawing import ink, signs, tags
from launch.drawing.signs import Sign
from launch.drawing.tags import Owner
from launch.drawing.view import View, placed
from launch.pictures.course import Course
from launch.pictures.subgoal_log import WORDS

_OUTCOMES = {word: outcome for outcome, word in WORDS.items()}
_FILL, _EDGE = 0.28, 0.55  # opacities
_TRAIL, _OLD_TRAIL = 0.95, 0.22  # of the latest and of the oldest part of the way
_TRAIL_SECONDS, _SIGN_SECONDS = 1.6, 0.8  # of the film, until they have faded
_MOST_EDGES = 12  # that help to see a shape: those of a box
_DIRECTIONS = 96  # in which a hull's corners are looked for
_NO_COLOUR = "#9aa0a6"
_LETTERS = 15  # of a tag, in units
_NUMBER, _OUTCOME = (125, 32), 53  # what a board and a cell write over it: width, height; in units


class Mark(NamedTuple):
    """What marks a goal: its bodies, its colour, and a word for it."""

    bodies: list[int]
    colour: ink.Colour
    word: str
    towards: tuple[float, float]  # where its tag is if there is room


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
        self._levels = list(range(course.policy.subgoal_layers, 0, -1))
        self._marks = [goal_mark(course), *(level_mark(course, level) for level in self._levels)]
        self._signs = signs.apart(self._what_became(), _SIGN_SECONDS * self._rate)
        self._tags = self._places_of_tags()

    def _what_became(self) -> Iterator[Sign]:
        """Of every subgoal whose marker is seen."""
        for subgoal in self._course.subgoals:
            mark = level_mark(self._course, subgoal.level)
            outline = next(self._outlines(mark, subgoal.end_step), None)
            if outline is not None:
                yield Sign(subgoal.end_step, subgoal.level, mark.colour,
                           _OUTCOMES[subgoal.outcome], outline[0].mean(0), self._unit)  # fmt: skip

    def _places_of_tags(self) -> list[np.ndarray]:
        """The middles of each marker's word, [steps + 1, 2] pixels."""
        course, size = self._course, np.array(self._view.size)
        attempts = [[(0, course.steps)]]  # at the end goal
        for level in self._levels:
            own = [subgoal for subgoal in course.subgoals if subgoal.level == level]
            attempts.append([(subgoal.step + 1, subgoal.end_step) for subgoal in own])
        owners = [
            Owner(self._boxes(mark), spans, mark.towards)
            for mark, spans in zip(self._marks, attempts, strict=True)
        ]
        seen = np.full((course.steps + 1, len(self._signs), 2, 2), np.nan)
        for column, sign in enumerate(self._signs):
            faded = sign.step + math.ceil(_SIGN_SECONDS * self._rate)
            seen[sign.step : faded + 1, column] = sign.box
        return tags.middles(owners, seen, _over(size, self._unit), size, self._unit)

    def _boxes(self, mark: Mark) -> np.ndarray:
        """Around each body that is seen, [steps + 1, B, 2, 2]; NaN in place of others, the last."""
        boxes = np.full((self._course.steps + 1, max(len(mark.bodies), 1), 2, 2), np.nan)
        for step, row in enumerate(boxes):
            for column, (corners, _) in enumerate(self._seen(mark, step)):
                row[column] = corners.min(0), corners.max(0)
        return boxes

    def draw(self, picture: Image.Image, moment: float) -> None:
        """Draws over the picture of a moment in steps."""
        now = min(max(1, math.ceil(moment)), self._course.steps)  # what is pursued on this step
        outlines = [(mark, list(self._outlines(mark, now))) for mark in self._marks]
        trails, fading = self._trails(moment), list(self._fading(moment))
        points = [hull for _, hulls in outlines for hull, _ in hulls] + trails
        if not points:
            return
        tagged = [
            (mark, hulls[0][0], tag[now])
            for (mark, hulls), tag in zip(outlines, self._tags, strict=True)
            if hulls and not np.isnan(tag[now]).any()
        ]
        points += [sign.box for sign, _ in fading] + [tag[None] for _, _, tag in tagged]
        pen = ink.Ink(picture, np.concatenate(points), 70 * self._unit)
        for trail in trails:
            self._draw_trail(pen, trail)
        for mark, hulls in outlines:
            self._draw_mark(pen, mark, hulls)
        for mark, outline, tag in tagged:
            self._draw_leader(pen, mark, outline, tag)
        for sign, opacity in fading:
            signs.draw(pen, sign, opacity)
        for mark, _, tag in tagged:
            pen.tag(mark.word, tag, _LETTERS * self._unit, mark.colour)
        pen.finish()

    def _outlines(self, mark: Mark, step: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Of every body of a marker that is seen: its hull [N, 2], and edges [E, 2, 2]."""
        return ((hull(corners), edges) for corners, edges in self._seen(mark, step))

    def _seen(self, mark: Mark, step: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Of every body of a marker that is seen: corners [N, 2] and edges [E, 2, 2]."""
        for body in mark.bodies:
            poses = self._course.poses[step]
            shapes = [shape for shape in self._course.stage.shapes if shape.body == body]
            if not poses.seen[body] or not shapes:
                continue
            corners = np.concatenate([shape.vertices for shape in shapes])
            edges = np.concatenate([shape.edges for shape in shapes])
            yield (
                self._view.pixels(placed(corners, poses, body)),
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

    def _draw_leader(self, pen: ink.Ink, mark: Mark, outline: np.ndarray, tag: np.ndarray) -> None:
        """The line from a word to its marker."""
        end, unit = nearest(outline, tag), self._unit
        pen.line([tag, end], ink.PAPER, 4 * unit, 0.8)
        pen.line([tag, end], mark.colour, 2 * unit)
        pen.disc(end, 3 * unit, mark.colour)

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
        pen.fading_line(way, ink.WHITE, 3.2 * self._unit, opacity)

    def _fading(self, moment: float) -> Iterator[tuple[Sign, float]]:
        """Signs of subgoals that have just ended, each with its opacity."""
        for sign in self._signs:
            age = (moment - sign.step) / self._rate
            if 0 <= age < _SIGN_SECONDS:
                yield sign, 1 - age / _SIGN_SECONDS


def _over(size: np.ndarray, unit: float) -> np.ndarray:
    """Boxes [2, 2, 2] of what a tag would be under: a number and, at the end, the outcome."""
    number = np.array([(0, 0), _NUMBER]) * unit
    outcome = np.array([(0, size[1] - _OUTCOME * unit), size])
    return np.stack([number, outcome])


def nearest(outline: np.ndarray, point: np.ndarray) -> np.ndarray:
    """The point [2] of a closed line through points [N, 2] that is nearest to `point`."""
    along = np.roll(outline, -1, axis=0) - outline
    share = ((point - outline) * along).sum(1) / np.maximum((along**2).sum(1), 1e-9)
    found = outline + np.clip(share, 0, 1)[:, None] * along
    return found[np.linalg.norm(found - point, axis=1).argmin()]


def hull(points: np.ndarray) -> np.ndarray:
    """Corners [M, 2] of the convex area that holds points [N, 2], in order."""
    angles = np.linspace(0, 2 * np.pi, _DIRECTIONS, endpoint=False)
    furthest = (points @ np.stack([np.cos(angles), np.sin(angles)])).argmax(0)
    return points[furthest[furthest != np.roll(furthest, 1)]]
