"""Places the labels of markers: off all markers, and still while their marker is.

It considers all steps of an episode in advance, so that no label jumps during an attempt when
another level's marker comes near. A box is [2, 2]: the least and the most x and y in pixels; NaN
where nothing is.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

ROOM = np.array([66, 25])  # that a word takes, in units
_GAP = np.array([3, 4.5])  # units between a marker and the room of its word
_FURTHER = (0, 18, 40, 70, 110, 160)  # units: perhaps added to the gap
_HALVES = (-1, -0.5, 0, 0.5, 1)
_SIDES = np.array([(x, y) for x in _HALVES for y in _HALVES if max(abs(x), abs(y)) == 1])
# What a place costs in addition to its distance in units. For each step on which it covers a marker
# or another word: too much. On average over the steps: for each sign that it covers, for a line to
# its marker that crosses something, and for another side than before.
_COVERS, _HIDES, _CROSSES, _ASIDE = 1000.0, 40.0, 25.0, 15.0
_ALONG = (0.5, 0.75)  # where such a line is looked at, on the way to the marker


class Owner(NamedTuple):
    """A marker over an episode."""

    boxes: np.ndarray  # [steps + 1, B, 2, 2] of its bodies; its word is beside the first
    attempts: list[tuple[int, int]]  # first and last step on which it shows the same goal
    towards: tuple[float, float]  # where its word is if there is room


def middles(
    owners: Sequence[Owner], signs: np.ndarray, fixed: np.ndarray, size: np.ndarray, unit: float
) -> list[np.ndarray]:
    """The middle of each owner's word, [steps + 1, 2] pixels; the first has the first choice.

    Args:
      signs: [steps + 1, K, 2, 2] what is better not covered.
      fixed: [F, 2, 2] what lies over the picture, on every step.
      size: of the picture, in pixels.
    """
    half = ROOM * unit / 2
    every = np.broadcast_to(fixed, (len(signs), *fixed.shape))
    taken = np.concatenate([*(owner.boxes for owner in owners), every], axis=1)
    found = []
    for owner in owners:
        places, before = np.full((len(signs), 2), np.nan), np.array(owner.towards)
        for first, last in owner.attempts:
            now = slice(first, last + 1)
            options = _options(owner.boxes[now, 0], half, size, unit)
            cost = _cost(options, owner.boxes[now, 0], taken[now], signs[now], half)
            cost += _ASIDE * (before != _SIDES).any(-1)
            far, side = np.unravel_index(cost.argmin(), cost.shape)
            before, places[now] = _SIDES[side], options[far, side]
        found.append(places)
        own = np.stack([places - half, places + half], axis=1)
        taken = np.concatenate([taken, own[:, None]], axis=1)
    return found


def _options(beside: np.ndarray, half: np.ndarray, size: np.ndarray, unit: float) -> np.ndarray:
    """Places beside boxes [S, 2, 2], the nearest first: [distances, sides, S, 2]."""
    middle, reach = beside.mean(1), (beside[:, 1] - beside[:, 0]) / 2 + half
    away = reach + np.add.outer(_FURTHER, _GAP)[:, None, None] * unit
    return np.clip(middle + away * _SIDES[:, None], half, size - half)


def _cost(
    places: np.ndarray, beside: np.ndarray, taken: np.ndarray, signs: np.ndarray, half: np.ndarray
) -> np.ndarray:
    """Of words at places [distances, sides, S, 2], but for their side: [distances, sides]."""
    cost = np.array(_FURTHER)[:, None] + _COVERS * _covered(places, taken, half).sum(-1)
    cost += _HIDES * _covered(places, signs, half).mean(-1)
    ends = np.clip(places, beside[:, 0], beside[:, 1])
    for share in _ALONG:
        cost += _CROSSES * _covered(places + share * (ends - places), taken, 0 * half).mean(-1)
    return cost


def _covered(places: np.ndarray, boxes: np.ndarray, half: np.ndarray) -> np.ndarray:
    """How many boxes [S, N, 2, 2] are covered, half a word's size around places [..., S, 2]."""
    low, high = boxes[:, :, 0] - half, boxes[:, :, 1] + half
    return ((places[..., None, :] > low) & (places[..., None, :] < high)).all(-1).sum(-1)
