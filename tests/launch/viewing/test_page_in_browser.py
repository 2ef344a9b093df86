"""The live page in headless Chromium: it draws, its buttons work, and the goal is dragged."""

import contextlib
import re
import subprocess
import sys
import time

import numpy as np
import pytest

from tests.launch import browser
from tests.launch.browser import Browser

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(browser.PATH is None, reason=browser.NONE),
]

GOAL = np.array([255, 209, 13]) / 255


@pytest.fixture(scope="module")
def page():
    pytest.importorskip("viser", exc_type=ImportError)
    process = subprocess.Popen(
        [sys.executable, "launch/view.py", "--task=pick_place"],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout
        address = re.search(r"http://\S+", process.stdout.readline())
        assert address
        with contextlib.closing(Browser(address[0])) as opened:
            opened.wait_for("document.body.innerText.includes('step 0 of 300')")
            yield opened
    finally:
        process.terminate()
        process.communicate(timeout=30)


def press(page: Browser, name: str) -> None:
    page.run(f"[...document.querySelectorAll('button')].find(b => b.innerText == {name!r}).click()")


def canvas_width(page: Browser) -> int:
    return int(page.run("document.querySelector('canvas').getBoundingClientRect().width"))


def goal_pixel(page: Browser) -> tuple[float, float]:
    """The middle of what is coloured as the goal, x and y."""
    shown = page.picture()[:, : canvas_width(page)].astype(float) / 255
    red, green, blue = shown[..., 0], shown[..., 1], shown[..., 2]
    yellow = (red > 0.5) & (green > 0.4) & (blue < 0.75 * green) & (np.abs(red - green) < 0.25)
    y, x = np.nonzero(yellow)
    assert len(x) > 200
    return float(np.median(x)), float(np.median(y))


def test_the_scene_is_drawn(page):
    time.sleep(3.0)
    shown = page.picture()[:, : canvas_width(page)].astype(int)
    assert shown.std() > 10 and len(np.unique(shown.reshape(-1, 3), axis=0)) > 100
    goal_pixel(page)


def test_steps_are_taken_and_told(page):
    for step in (1, 2):
        press(page, "Step")
        page.wait_for(f"document.body.innerText.includes('step {step} of 300')")
    assert "6 of 7" in page.run("document.body.innerText") or "5 of 7" in page.run(
        "document.body.innerText"
    )


def test_the_goal_is_dragged_in_the_picture(page):
    x, y = goal_pixel(page)
    page.mouse("mouseMoved", x, y, pressed=False)
    time.sleep(0.5)
    page.mouse("mousePressed", x, y, pressed=True)
    for part in np.linspace(0, 1, 10):
        page.mouse("mouseMoved", x + 80 * part, y - 60 * part, pressed=True)
        time.sleep(0.2)
    page.mouse("mouseReleased", x + 80, y - 60, pressed=False)
    page.wait_for("document.body.innerText.includes('step 0 of 300')")  # a new episode
    time.sleep(3.0)
    now = goal_pixel(page)
    np.testing.assert_allclose(now, (x + 80, y - 60), atol=25)


def test_it_plays_to_the_end(page):
    press(page, "Play")
    page.wait_for("/goal achieved|was not achieved/.test(document.body.innerText)")


def test_nothing_else_than_this_machine_was_asked(page):
    page.run("0")
    hosts = {re.sub(r"^\w+://([^/:]+).*", r"\1", a) for a in page.requests if "://" in a[:8]}
    assert hosts <= {"127.0.0.1"}
