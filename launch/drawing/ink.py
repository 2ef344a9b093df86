"""Smooth lines, areas, words and signs over a picture."""

import functools
from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import hac_suite

Colour = tuple[int, int, int]

PAPER: Colour = (24, 24, 28)
WHITE: Colour = (255, 255, 255)
QUIET: Colour = (176, 178, 188)
_FINER = 2  # times: drawn so much larger, and reduced
_FINER_LETTERS = 4  # else small letters stand on whole pixels, some too near and some too far
SIGNS = {  # strokes in a square from -1 to 1, y downwards
    hac_suite.Outcome.ACHIEVED: [[(-0.8, 0.05), (-0.25, 0.6), (0.8, -0.6)]],
    hac_suite.Outcome.MISSED: [[(-0.6, -0.6), (0.6, 0.6)], [(-0.6, 0.6), (0.6, -0.6)]],
    hac_suite.Outcome.CUT_SHORT: [[(-0.7, 0.0), (0.7, 0.0)]],
}


def colour(hexadecimal: str) -> Colour:
    """Of "#rrggbb"."""
    red, green, blue = (int(hexadecimal[at : at + 2], 16) for at in (1, 3, 5))
    return red, green, blue


def lighter(of: Colour, share: float) -> Colour:
    """The colour on the way to white."""
    red, green, blue = (round(part + share * (255 - part)) for part in of)
    return red, green, blue


@functools.lru_cache
def font(size: float) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size=size)


def length(text: str, size: float) -> float:
    """Pixels from a text's left end to its right one."""
    return font(size * _FINER_LETTERS).getlength(text) / _FINER_LETTERS


def write(
    draw: ImageDraw.ImageDraw,
    text: str,
    place: Sequence[float] | np.ndarray,
    size: float,
    fill: Colour = WHITE,
    anchor: str = "lm",
) -> None:
    """A line of text; `anchor` says what of it is at the place, as Pillow's anchors do."""
    letters = font(size * _FINER_LETTERS)
    fine = np.array(place, float) * _FINER_LETTERS
    box = np.reshape(letters.getbbox(text, anchor=anchor), (2, 2)) + fine
    low = np.floor(box[0] / _FINER_LETTERS).astype(int)
    wide, tall = (np.ceil(box[1] / _FINER_LETTERS).astype(int) - low).tolist()
    mask = Image.new("L", (wide * _FINER_LETTERS, tall * _FINER_LETTERS))
    start = (fine - low * _FINER_LETTERS).tolist()
    ImageDraw.Draw(mask).text((start[0], start[1]), text, 255, letters, anchor)
    draw.bitmap(low.tolist(), mask.reduce(_FINER_LETTERS), fill)


def write_within(
    draw: ImageDraw.ImageDraw,
    text: str,
    place: tuple[float, float],
    size: float,
    width: float,
    fill: Colour = WHITE,
) -> None:
    """A line of text that begins at a place, its middle there; smaller where it is too long."""
    while (long := length(text, size)) > width and size > 1:
        size *= 0.995 * width / long  # a length is not quite in proportion to the size
    write(draw, text, place, size, fill)


def write_right(
    draw: ImageDraw.ImageDraw, text: str, right: float, middle: float, size: float
) -> float:
    """A line of quiet text that ends at `right`; returns where it begins."""
    left = right - length(text, size)
    write(draw, text, (left, middle), size, QUIET)
    return left


class Ink:
    """Draws on a part of a picture; coordinates are the picture's, in pixels."""

    def __init__(self, picture: Image.Image, points: np.ndarray, room: float):
        """Takes the part that holds the points [N, 2] with some room around them."""
        low = np.floor(np.clip(points.min(0) - room, 0, picture.size)).astype(int)
        high = np.ceil(np.clip(points.max(0) + room, 0, picture.size)).astype(int)
        self._picture, self._corner = picture, low
        self._empty = bool((high <= low).any())
        part = picture.crop((*low, *(low + 1 if self._empty else high)))
        self._part = part.resize([_FINER * side for side in part.size], Image.Resampling.NEAREST)
        self._draw = ImageDraw.Draw(self._part, "RGBA")

    def _own(self, points: Sequence | np.ndarray) -> list[tuple[float, float]]:
        own = (np.asarray(points, float).reshape(-1, 2) - self._corner) * _FINER
        return [(x, y) for x, y in own.tolist()]

    def line(self, points: Sequence | np.ndarray, fill: Colour, width: float, opacity: float = 1):
        """A line through points [N, 2]."""
        thick = max(1, round(width * _FINER))
        self._draw.line(self._own(points), (*fill, round(255 * opacity)), thick, joint="curve")

    def fading_line(
        self, points: np.ndarray, fill: Colour, width: float, opacity: np.ndarray
    ) -> None:
        """A line through points [N, 2], each of its N - 1 parts with an opacity of its own.

        Parts replace each other where they meet: a bend is no more opaque than what leads to it.
        """
        mask = Image.new("L", self._part.size)
        draw, thick = ImageDraw.Draw(mask), max(1, round(width * _FINER))
        own = self._own(points)
        for start, end, seen in zip(own[:-1], own[1:], opacity, strict=True):
            draw.circle(start, thick / 2, round(255 * seen))
            draw.line([start, end], round(255 * seen), thick)
        self._part.paste(fill, mask=mask)

    def area(self, corners: Sequence | np.ndarray, fill: Colour, opacity: float) -> None:
        """What is between corners [N, 2]."""
        if len(corners) > 2:
            self._draw.polygon(self._own(corners), (*fill, round(255 * opacity)))

    def disc(self, centre: Sequence | np.ndarray, radius: float, fill: Colour, opacity: float = 1):
        ((x, y),) = self._own(centre)
        size = radius * _FINER
        box = (x - size, y - size, x + size, y + size)
        self._draw.ellipse(box, (*fill, round(255 * opacity)))

    def ring(
        self,
        centre: Sequence | np.ndarray,
        radius: float,
        width: float,
        fill: Colour,
        opacity: float = 1,
    ) -> None:
        """What lies in a disc, no further than `width` from its edge."""
        ((x, y),) = self._own(centre)
        size, thick = radius * _FINER, max(1, round(width * _FINER))
        box = (x - size, y - size, x + size, y + size)
        self._draw.ellipse(box, outline=(*fill, round(255 * opacity)), width=thick)

    def sign(
        self,
        of: hac_suite.Outcome,
        centre: Sequence | np.ndarray,
        size: float,
        fill: Colour,
        opacity: float = 1,
    ) -> None:
        """A tick, a cross or a dash, as wide as two sizes."""
        for stroke in SIGNS[of]:
            self.line(np.array(stroke) * size + centre, fill, size / 2.6, opacity)

    def tag(self, text: str, centre: Sequence | np.ndarray, size: float, fill: Colour) -> None:
        """A word on a rounded patch of this colour."""
        ((x, y),) = self._own(centre)
        half = (length(text, size) / 2 + 0.4 * size) * _FINER
        tall = 0.72 * size * _FINER
        box = (x - half, y - tall, x + half, y + tall)
        self._draw.rounded_rectangle(box, tall, (*fill, 235))
        write(self._draw, text, (x, y), size * _FINER, _readable_on(fill), "mm")

    def finish(self) -> None:
        """Puts the part back into the picture."""
        if not self._empty:
            self._picture.paste(self._part.reduce(_FINER), tuple(self._corner.tolist()))


def _readable_on(fill: Colour) -> Colour:
    bright = 0.299 * fill[0] + 0.587 * fill[1] + 0.114 * fill[2]
    return (20, 20, 20) if bright > 125 else WHITE
