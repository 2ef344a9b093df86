"""How fast an episode is shown, and which moment of it each frame shows."""

import math
from typing import NamedTuple

import numpy as np

FRAMES_PER_SECOND = 20
_LEAST_SECONDS = 5.0  # that an episode is shown for, slowed down for it
_HOLD_SECONDS = 0.5  # that its end is shown for
_EVEN = 0.01  # speeds nearer than this to a whole factor are called by it


class Pace(NamedTuple):
    """The frames of an episode."""

    speed: float  # times real time
    moments: np.ndarray  # [frames] in steps, from 0 to the last; the end is held


def pace(steps: int, timestep: float, speed: float | None = None) -> Pace:
    """Frames of an episode of so many steps of `timestep` seconds.

    Args:
      speed: times real time; None: real time, or a whole number of times slower for an episode
        that would be over too soon.
    """
    seconds = steps * timestep
    if speed is None:
        speed = 1 / max(1, math.ceil(_LEAST_SECONDS / max(seconds, timestep)))
    shown = max(round(seconds / speed * FRAMES_PER_SECOND), 1)
    held = np.full(round(_HOLD_SECONDS * FRAMES_PER_SECOND), float(steps))
    return Pace(speed, np.append(np.linspace(0, steps, shown + 1), held))


def in_words(speed: float) -> str:
    """As in "slow motion, 11 times slower"."""
    times = speed if speed >= 1 else 1 / speed
    if abs(times - 1) < _EVEN:
        return "real time"
    said = f"{round(times)}" if abs(times - round(times)) < _EVEN else f"{times:.1f}"
    return f"{said} times faster" if speed > 1 else f"slow motion, {said} times slower"
