"""One episode, framed: title above, bodies and markers, lanes below."""

from collections.abc import Iterator

import numpy as np
from PIL import Image, ImageDraw

from analysis.reading import paper
from launch.drawing import ink, lanes, pacing
from launch.drawing.cell import Cell, view_of
from launch.drawing.pacing import Pace
from launch.pictures.course import Course

_HIGH, _WIDE = 720, 960  # units that a sheet is high, and that it is wide at least
TITLE = 62  # height, in units


class Sheet:
    """Makes the frames of a film of one episode."""

    def __init__(
        self, course: Course, pace: Pace, size: tuple[int, int], camera: str | None, label: str = ""
    ):
        """`size` is width, height in pixels; `label` says which episode of several it is.

        Raises:
          CommandError: the task has no such camera.
        """
        self._pace, self._steps = pace, course.steps
        unit = min(size[1] / _HIGH, size[0] / _WIDE)  # a tall one has no more room for words
        rows = lanes.lanes_of(course)
        self._title = round(TITLE * unit)
        below = lanes.height(len(rows), unit)
        view = view_of([course], camera, (size[0], size[1] - self._title - below))
        self._cell = Cell(course, view, pace.speed / course.control_timestep, unit)
        self._strip = lanes.Strip(rows, course.steps, size[0], unit)
        self._blank = Image.new("RGB", size, ink.PAPER)
        write_title(self._blank, course, unit, label, pacing.in_words(pace.speed))

    def frames(self) -> Iterator[np.ndarray]:
        """The film, uint8 [height, width, 3] each."""
        return map(self.frame, self._pace.moments)

    def frame(self, moment: float) -> np.ndarray:
        """The frame of a moment in steps."""
        sheet = self._blank.copy()
        picture = self._cell.picture(moment)
        sheet.paste(picture, (0, self._title))
        sheet.paste(self._strip.at(moment), (0, self._title + picture.height))
        return np.asarray(sheet)

    def close(self) -> None:
        """Frees the rendering context."""
        self._cell.close()


def write_title(sheet: Image.Image, course: Course, unit: float, *facts: str) -> None:
    """Two lines: what is to be done; the task, the agent, the facts, and the key of outcomes."""
    metadata, layers = course.policy.metadata, course.policy.subgoal_layers
    about = paper.ABOUT.get(metadata["task"], course.title)
    said = [paper.agent_name(layers), f"seed {metadata['seed']}", *filter(None, facts)]
    draw, left = ImageDraw.Draw(sheet), 14 * unit
    ink.write_within(draw, about, (left, 19 * unit), 21 * unit, sheet.width - 2 * left)
    second = f"{paper.title(metadata['task'])}:  {',  '.join(said)}"
    key = lanes.draw_key(draw, sheet.width - left, 46 * unit, unit)
    ink.write_within(draw, second, (left, 46 * unit), 17 * unit, key - 2 * left, ink.QUIET)
