"""A replay opened from a file in headless Chromium: it draws, it scrubs, and nothing goes wrong."""

import contextlib
import time
from pathlib import Path

import numpy as np
import pytest

from launch.folder import policies
from launch.pictures import replay
from tests.launch import browser
from tests.launch.browser import Browser

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(browser.PATH is None, reason=browser.NONE),
]

SETTLED = 1.5  # seconds until a picture in software WebGL shows what was asked for


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> Path:
    pytest.importorskip("viser", exc_type=ImportError)
    path = tmp_path_factory.mktemp("replay") / "episode.html"
    found = policies.published("ur5_reacher")
    replay.render([p.path for p in found if p.subgoal_layers == 2], path)
    return path


@pytest.fixture(scope="module", params=[(1280, 720), (390, 844)], ids=["desktop", "phone"])
def page(request, file):
    with contextlib.closing(Browser(file.as_uri(), request.param)) as opened:
        opened.wait_for("window.replay")
        opened.run("replay.pause()")
        yield opened


def at(page: Browser, step: int) -> np.ndarray:
    """The picture at a step."""
    page.run(f"replay.show({step})")
    time.sleep(SETTLED)
    return page.picture()


def canvas(page: Browser, picture: np.ndarray) -> np.ndarray:
    """The part of a picture that viser draws and nothing covers."""
    box = page.run(
        "(() => { const c = document.querySelector('canvas').getBoundingClientRect();"
        "const over = document.getElementById('hac-what').getBoundingClientRect();"
        "return [c.left, over.bottom, c.right, c.bottom].map(Math.round) })()"
    )
    left, top, right, bottom = box
    return picture[top:bottom, left:right].astype(int)


def test_the_canvas_shows_something(page):
    shown = canvas(page, at(page, 0))
    assert shown.shape[0] > 250 and shown.shape[1] >= 380
    assert shown.std() > 10 and len(np.unique(shown.reshape(-1, 3), axis=0)) > 100
    for colour in ([255, 209, 13], [148, 51, 199], [38, 178, 64]):  # goal, levels 1 and 2
        towards = np.array(colour) - 128
        tint = (shown - shown.mean(-1, keepdims=True)) @ (towards - towards.mean())
        assert tint.max() > 0.25 * ((towards - towards.mean()) ** 2).sum(), colour


def test_the_scrubber_moves_bodies_there_and_back(page):
    start = canvas(page, at(page, 0))
    later = canvas(page, at(page, 40))
    again = canvas(page, at(page, 0))
    moved = np.abs(later - start).max(-1) > 40
    assert moved.mean() > 0.005
    assert (np.abs(again - start).max(-1) > 40).mean() < 0.1 * moved.mean()


def test_the_slider_itself_scrubs_and_pauses(page):
    page.run("replay.show(0); replay.resume()")
    page.run(
        "(() => { const t = document.getElementById('hac-time'); t.value = 30;"
        "t.dispatchEvent(new Event('input')) })()"
    )
    assert page.run("replay.step") == 30
    time.sleep(0.5)
    assert page.run("replay.step") == 30
    assert page.run("document.getElementById('hac-now').textContent").startswith("step 30 of")
    shown = float(page.run("document.querySelector('[role=slider]').ariaValueNow"))
    assert shown == pytest.approx(0.305)


def test_it_plays_to_its_end_and_stops_there(page):
    page.run("document.getElementById('hac-pace').value = 2")
    page.run("document.getElementById('hac-pace').dispatchEvent(new Event('change'))")
    page.run("replay.show(0); replay.resume()")
    steps = int(page.run("document.getElementById('hac-time').max"))
    page.wait_for(f"replay.step === {steps}")
    assert "Play" in page.run("document.getElementById('hac-play').textContent")


def test_outcomes_are_marked_on_the_timeline(page):
    kinds = page.run("[...document.querySelectorAll('.hac-attempt')].map(a => a.dataset.outcome)")
    assert kinds[0] == "achieved" and len(kinds) > 8
    widths = page.run(
        "[...document.querySelectorAll('.hac-lane')].map(l => [...l.children].reduce("
        "(sum, a) => sum + parseFloat(a.style.width), 0))"
    )
    np.testing.assert_allclose(widths, 100.0, atol=0.01)  # each lane is full
    text = page.run("document.getElementById('hac-lanes').innerText")
    assert "end goal" in text and "level 2's subgoals" in text and "level 1's subgoals" in text


def test_it_fits_the_window(page):
    assert page.run("document.documentElement.scrollWidth <= innerWidth")
    assert page.run("document.documentElement.scrollHeight <= innerHeight")
    bottom = page.run("document.getElementById('hac-bar').getBoundingClientRect().bottom")
    assert bottom <= page.run("innerHeight") + 1


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_the_page_is_as_dark_as_the_person_wants_it(file, dark):
    with contextlib.closing(Browser(file.as_uri(), dark=dark)) as opened:
        opened.wait_for("window.replay")
        shown = at(opened, 0)
        sky = canvas(opened, shown)[:20].mean()
        bar, letters = opened.run(
            "(() => { const style = getComputedStyle(document.getElementById('hac-bar'));"
            "return [style.backgroundColor, style.color].map(c => Number(c.match(/\\d+/)[0])) })()"
        )
        assert opened.problems == []
    assert (sky < 60, bar < 60, letters > 200) == (dark, dark, dark)


def test_nothing_went_wrong_and_nothing_was_asked_of_the_network(page):
    page.run("replay.show(5)")
    time.sleep(0.5)
    page.run("0")
    assert page.problems == []
    assert {address.split(":")[0] for address in page.requests} <= {"file", "data", "blob"}
