"""One episode as a still: numbered pictures from its start to its end, and its lanes below."""

import numpy as np
from PIL import Image, ImageDraw

from launch.drawing import ink, lanes
from launch.drawing.cell import Cell, view_of
from launch.films.sheet import TITLE, write_title
from launch.pictures.course import Course

_COLUMNS, _ROWS, _GAP = 3, 2, 6
_SHAPE = 0.66  # a picture's height, as a share of its width
_STEPS_A_SECOND = 10.0  # trails and signs fade as in a film this fast
_WIDTH = 1280  # in units


def board(course: Course, width: int, camera: str | None) -> np.ndarray:
    """The still, uint8 [height, width, 3].

    Raises:
      CommandError: the task has no such camera.
    """
    unit = width / _WIDTH
    gap, rows = round(_GAP * unit), lanes.lanes_of(course)
    wide = (width - (_COLUMNS - 1) * gap) // _COLUMNS
    high = round(_SHAPE * wide)
    top = round(TITLE * unit)
    moments = np.linspace(0, course.steps, _COLUMNS * _ROWS).round()
    strip = lanes.Strip(rows, course.steps, width, unit).at(course.steps, moments)
    page = Image.new("RGB", (width, top + _ROWS * (high + gap) + strip.height), ink.PAPER)
    write_title(page, course, unit)
    cell = Cell(course, view_of([course], camera, (wide, high)), _STEPS_A_SECOND, 0.9 * unit)
    for number, moment in enumerate(moments):
        row, column = divmod(number, _COLUMNS)
        picture = cell.picture(moment)
        _number(picture, number + 1, f"step {moment:.0f}", unit)
        page.paste(picture, (column * (wide + gap), top + row * (high + gap)))
    cell.close()
    page.paste(strip, (0, page.height - strip.height))
    return np.asarray(page)


def _number(picture: Image.Image, number: int, said: str, unit: float) -> None:
    draw = ImageDraw.Draw(picture)
    text, size = f"{number}   {said}", 18 * unit
    draw.rectangle((0, 0, ink.length(text, size) + 16 * unit, 28 * unit), ink.PAPER)
    ink.write(draw, text, (8 * unit, 14 * unit), size)
