"""A picture of an episode at any moment: its bodies, and the overlays."""

from typing import Protocol

import numpy as np
from PIL import Image, ImageDraw, ImageOps

import hac_suite
from launch.drawing import ink
from launch.drawing.lens import Lens
from launch.drawing.markers import Markers
from launch.drawing.view import View, points_of_interest
from launch.pictures.course import Course
from launch.pictures.outcomes import COLOURS


class Bodies(Protocol):
    """What makes pictures of bodies: `Lens`, or an `Album`."""

    def picture(self, moment: float) -> np.ndarray: ...

    def close(self) -> None: ...


class Album:
    """Pictures that an environment made of itself."""

    def __init__(self, course: Course, size: tuple[int, int]):
        self._photos, self._size = course.photos, size

    def picture(self, moment: float) -> np.ndarray:
        """The latest one at a moment in steps, on black."""
        latest = max(step for step in self._photos if step <= max(moment, 0))
        photo = Image.fromarray(self._photos[latest])
        photo = ImageOps.contain(photo, self._size, Image.Resampling.BILINEAR)
        page = Image.new("RGB", self._size)
        left, top = (self._size[0] - photo.width) // 2, (self._size[1] - photo.height) // 2
        page.paste(photo, (left, top))
        return np.asarray(page)

    def close(self) -> None:
        """Nothing: there is no rendering context."""


def view_of(courses: list[Course], camera: str | None, size: tuple[int, int]) -> View:
    """A view that has in it all that these episodes of one task show.

    Raises:
      CommandError: the task has no such camera.
    """
    view = View(courses[0].stage, camera, size)
    points = np.concatenate([points_of_interest(course) for course in courses])
    if len(points):
        view.frame(points)
    return view


class Cell:
    """Makes the pictures of an episode, as a view shows them."""

    def __init__(self, course: Course, view: View, steps_a_second: float, unit: float):
        """An environment's own frames come first, unless a camera was asked for.

        Args:
          steps_a_second: of the film.
          unit: of lengths, in pixels.
        """
        self._course, self._unit = course, unit
        self._bodies: Bodies
        self._markers: Markers | None = None
        if course.photos and view.camera is None:
            self._bodies = Album(course, view.size)  # nobody knows where in them a marker is
        else:
            self._bodies = Lens(course, view)
            self._markers = Markers(course, view, steps_a_second, unit)
        self._last: tuple[float, Image.Image] | None = None

    def picture(self, moment: float, *, ended: bool = False) -> Image.Image:
        """At a moment in steps; the end is shown for all later ones, and says how it went.

        Args:
          ended: whether to say so though the end is not shown.
        """
        moment = min(moment, self._course.steps)
        if self._last is None or self._last[0] != moment:
            picture = Image.fromarray(self._bodies.picture(moment))
            if self._markers:
                self._markers.draw(picture, moment)
            self._last = moment, picture
        picture = self._last[1].copy()
        if ended or moment == self._course.steps:
            write_outcome(picture, self._course.success, self._course.steps, self._unit)
        return picture

    def close(self) -> None:
        """Frees the rendering context."""
        self._bodies.close()


def write_outcome(picture: Image.Image, success: bool, steps: int, unit: float) -> None:
    """Says in the picture how the episode ended."""
    outcome = hac_suite.Outcome.ACHIEVED if success else hac_suite.Outcome.MISSED
    said = f"goal {'reached' if success else 'not reached'} in {steps} steps"
    draw = ImageDraw.Draw(picture)
    size = 22 * unit
    size *= min(1, 0.84 * picture.width / (ink.length(said, size) + 2.6 * size))
    half = ink.length(said, size) / 2 + 1.3 * size
    x, y, tall = picture.width / 2, picture.height - 1.5 * size, 0.9 * size
    box = (x - half, y - tall, x + half, y + tall)
    draw.rounded_rectangle(
        box, tall, ink.colour(COLOURS[outcome]), ink.WHITE, max(1, round(size / 13))
    )
    ink.write(draw, said, (x + 0.5 * size, y), size, anchor="mm")
    sign = np.array([x - half + size, y])
    pen = ink.Ink(picture, sign[None], size)
    pen.sign(outcome, sign, 0.42 * size, ink.WHITE)
    pen.finish()
