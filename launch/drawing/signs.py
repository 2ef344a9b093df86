"""Ticks, crosses and dashes: outcomes of subgoals, drawn where their markers were."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

import hac_suite
from launch.drawing import ink
from launch.pictures.outcomes import COLOURS

_LOWEST, _HIGHER = 11, 15  # radii in units, of level 1's and of others
_RIM = 1.25  # times a sign's radius: the ring around it


class Sign(NamedTuple):
    """The outcome of a subgoal."""

    step: int  # on which it ended
    level: int
    colour: ink.Colour  # of the level's marker
    outcome: hac_suite.Outcome
    middle: np.ndarray  # [2] pixels
    unit: float  # of lengths, in pixels

    @property
    def radius(self) -> float:
        return (_LOWEST if self.level == 1 else _HIGHER) * self.unit

    @property
    def box(self) -> np.ndarray:
        """[2, 2] the least and the most x and y."""
        return np.stack([self.middle - _RIM * self.radius, self.middle + _RIM * self.radius])


def apart(signs: Iterable[Sign], shown: float) -> list[Sign]:
    """The signs in the order in which they are drawn; each is shown for so many steps.

    A subgoal that ends ends those of lower levels too, often at the same place. Their signs stand
    to the right of its own, which they would cover.
    """
    found: list[Sign] = []
    for sign in sorted(signs, key=lambda sign: (sign.step, -sign.level)):
        for other in sorted(found, key=lambda other: float(other.middle[0])):
            reach = _RIM * (sign.radius + other.radius)
            seen = other.level > sign.level and sign.step - other.step < shown
            if seen and np.linalg.norm(sign.middle - other.middle) < reach:
                sign = sign._replace(middle=np.array([other.middle[0] + reach, sign.middle[1]]))
        found.append(sign)
    return found


def draw(pen: ink.Ink, sign: Sign, opacity: float) -> None:
    """A disc in the outcome's colour; the ring around it has the colour of the level's marker."""
    pen.disc(sign.middle, sign.radius, ink.colour(COLOURS[sign.outcome]), opacity)
    pen.ring(sign.middle, _RIM * sign.radius, (_RIM - 1) * sign.radius, sign.colour, opacity)
    pen.sign(sign.outcome, sign.middle, 0.56 * sign.radius, ink.WHITE, opacity)
