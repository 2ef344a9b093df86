"""Several episodes from the same start side by side, each with its lanes below."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from PIL import Image, ImageDraw

from analysis.program import CommandError
from analysis.reading import paper
from launch.drawing import ink, lanes, pacing
from launch.drawing.cell import Cell, view_of
from launch.pictures.course import Course

_WIDTH = 1000  # in units
_GAP, _TITLE, _NAME, _KEY = 6, 34, 32, 34  # in units
_LEAST = 60  # units that a picture must be high, so that its outcome can be read
_LONGER = 1.4  # times the longest success: failures are not shown for longer


class Columns:
    """Makes the frames of a film of several episodes."""

    def __init__(
        self,
        courses: Sequence[Course],
        names: Sequence[str],
        size: tuple[int, int],
        camera: str | None,
        speed: float | None = None,
        said: str = "",
    ):
        """All episodes begin together; `size` is width, height in pixels.

        Args:
          said: of all of them, above them.

        Raises:
          CommandError: the task has no such camera, or the size leaves no room for pictures.
        """
        first = courses[0]
        steps = shown_steps(courses)
        self._pace = pacing.pace(steps, first.control_timestep, speed)
        self._unit = unit = size[0] / _WIDTH
        layers = max(course.policy.subgoal_layers for course in courses)
        gap = round(_GAP * unit)
        wide = (size[0] - gap * (len(courses) - 1)) // len(courses)
        self._top = round((_TITLE + _NAME) * unit)
        below = lanes.height(layers + 1, unit, key=False)
        around = self._top + below + round(_KEY * unit)
        least = 2 * math.ceil((around + _LEAST * unit) / 2)  # films are of even sizes
        if size[1] < least:
            raise CommandError(
                f"flag --size={size[0]}x{size[1]}: too low for its width; give a height of at "
                f"least {least}"
            )
        high = size[1] - around
        view = view_of(list(courses), camera, (wide, high))
        rate = self._pace.speed / first.control_timestep
        self._cells = [Cell(course, view, rate, 0.8 * unit) for course in courses]
        rows = [lanes.lanes_of(course, layers) for course in courses]
        self._strips = [lanes.Strip(own, steps, wide, unit, names=False, key=False) for own in rows]
        self._lefts = [index * (wide + gap) for index in range(len(courses))]
        self._blank = Image.new("RGB", size, ink.PAPER)
        facts = ",  ".join(filter(None, [said, pacing.in_words(self._pace.speed)]))
        self._write(first, names, rows[0], wide, facts)

    def _write(
        self,
        course: Course,
        names: Sequence[str],
        rows: Sequence[lanes.Lane],
        wide: int,
        facts: str,
    ) -> None:
        """What does not change: title, names of the columns, and the key below."""
        draw, unit = ImageDraw.Draw(self._blank), self._unit
        task = course.policy.metadata["task"]
        about = paper.ABOUT.get(task, course.title)
        width = ink.write_right(draw, facts, self._blank.width - 8 * unit, 19 * unit, 15 * unit)
        ink.write_within(draw, about, (8 * unit, 19 * unit), 19 * unit, width - 24 * unit)
        for left, name in zip(self._lefts, names, strict=True):
            place = left + wide / 2, (_TITLE + _NAME / 2) * unit
            ink.write(draw, name, place, 19 * unit, anchor="mm")
        middle = self._blank.height - _KEY / 2 * unit
        lanes.draw_key(draw, self._blank.width - 8 * unit, middle, unit)
        lanes.draw_names(draw, rows, 8 * unit, middle, unit)

    @property
    def moments(self) -> np.ndarray:
        return self._pace.moments

    def frames(self) -> Iterator[np.ndarray]:
        """The film, uint8 [height, width, 3] each."""
        return map(self.frame, self._pace.moments)

    def frame(self, moment: float) -> np.ndarray:
        """The frame of a moment in steps."""
        page = self._blank.copy()
        last = moment == self._pace.moments[-1]
        for left, cell, strip in zip(self._lefts, self._cells, self._strips, strict=True):
            picture = cell.picture(moment, ended=last)
            page.paste(picture, (left, self._top))
            page.paste(strip.at(moment), (left, self._top + picture.height))
        return np.asarray(page)

    def close(self) -> None:
        """Frees the rendering contexts."""
        for cell in self._cells:
            cell.close()


def shown_steps(courses: Sequence[Course]) -> int:
    """Steps until the last one has ended; of failures, little more than the longest success."""
    longest = max(course.steps for course in courses)
    won = [course.steps for course in courses if course.success]
    return min(longest, round(_LONGER * max(won))) if won else longest
