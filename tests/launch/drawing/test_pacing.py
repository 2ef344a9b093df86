"""Films: long enough to be followed, at a speed that is said, with every moment shown."""

import numpy as np
import pytest

import tasks
from launch.drawing import pacing
from launch.drawing.pacing import FRAMES_PER_SECOND, pace


@pytest.mark.parametrize("task", tasks.ALL)
@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_an_episode_lasts_five_seconds_or_more_and_its_end_is_held(task, share):
    spec = tasks.spec(task)
    steps = round(share * spec.max_steps)
    shown = pace(steps, spec.control_timestep)
    held = int((shown.moments == steps).sum())
    assert (len(shown.moments) - held) / FRAMES_PER_SECOND >= 5
    assert held == FRAMES_PER_SECOND // 2 + 1
    assert shown.moments[0] == 0 and (np.diff(shown.moments) >= 0).all()
    seconds = steps * spec.control_timestep / shown.speed
    assert seconds < max(5 + spec.control_timestep / shown.speed, 10)
    if shown.speed < 1:
        assert float(1 / shown.speed).is_integer()


def test_a_speed_that_is_asked_for_is_kept():
    slow, fast = pace(100, 0.02, 0.25), pace(100, 0.02, 4.0)
    assert len(slow.moments) == 8 * FRAMES_PER_SECOND + 1 + 10
    assert len(fast.moments) == FRAMES_PER_SECOND // 2 + 1 + 10
    assert len(pace(0, 0.02).moments) >= 11  # an episode that is over at once


@pytest.mark.parametrize(
    ("speed", "words"),
    [
        (1.0, "real time"),
        (1 / 11, "slow motion, 11 times slower"),
        (0.4, "slow motion, 2.5 times slower"),
        (4.0, "4 times faster"),
    ],
)
def test_the_speed_is_said_in_words(speed, words):
    assert pacing.in_words(speed) == words
