"""Ink: words are as long as they are said to be, and lines that fade have no beads."""

import numpy as np
import pytest
from PIL import Image, ImageDraw

from launch.drawing import ink

SAID = "A pendulum is to be swung up and to come to rest at the peak. It must swing first."


@pytest.mark.parametrize("size", [6.3, 8.0, 10.5, 14.25, 19.0])
def test_a_text_ends_where_its_length_says(size):
    picture = Image.new("L", (1200, 40))
    ink.write(ImageDraw.Draw(picture), SAID, (10.5, 20.0), size, 255)
    columns = np.flatnonzero(np.asarray(picture).max(0) > 40)
    assert abs(columns[0] - 10.5) < 2.5
    assert abs(columns[-1] + 1 - (10.5 + ink.length(SAID, size))) < 2.5
    assert ink.length(SAID, size) / size == pytest.approx(ink.length(SAID, 40.0) / 40, rel=0.04)


@pytest.mark.parametrize("width", [355, 600, 2000])
def test_a_text_that_is_too_long_is_smaller(width):
    picture = Image.new("L", (1200, 40))
    ink.write_within(ImageDraw.Draw(picture), SAID, (10.0, 20.0), 20, width, 255)
    last = np.flatnonzero(np.asarray(picture).max(0) > 40)[-1]
    assert last <= 10 + width
    assert last >= 10 + min(width, ink.length(SAID, 20)) - 8


def test_a_line_that_fades_is_even_where_its_parts_meet():
    picture = Image.new("RGB", (100, 40))
    points = np.array([[10, 20], [12, 24], [40, 20], [41, 21], [90, 20]], float)
    pen = ink.Ink(picture, points, 10)
    pen.fading_line(points, ink.WHITE, 4, np.full(4, 0.4))
    pen.finish()
    drawn = np.asarray(picture)[..., 0]
    assert drawn.max() == round(0.4 * 255)
