"""A report in headless Chromium, as wide as a desktop and as a phone: all of it can be read."""

import contextlib
import json
import shutil

import pytest

from analysis.reading import grid
from analysis.report.run_report import write_report
from tests.launch import browser
from tests.launch.browser import Browser

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(browser.PATH is None, reason=browser.NONE),
]

TASK = "ur5_reacher"
WIDE, NARROW = (1280, 720), (390, 844)
LONG = ["python", "launch/run.py", f"--task={TASK}", *(f"--config.key_{i}={i}" for i in range(20))]


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / TASK
    shutil.copytree(grid.FOLDER / TASK, folder)
    manifest = json.loads((folder / "manifest.json").read_text())
    own = {"command": LONG, "earlier_launches": []}
    (folder / "manifest.json").write_text(json.dumps(manifest | own))
    return write_report(folder)


@pytest.fixture(scope="module", params=[WIDE, NARROW], ids=["desktop", "phone"])
def page(request, file):
    with contextlib.closing(Browser(file.as_uri(), request.param)) as opened:
        opened.wait_for("document.readyState === 'complete'")
        opened.run("document.querySelectorAll('details').forEach(each => { each.open = true })")
        yield opened


def test_the_page_itself_never_moves_sideways(page):
    assert page.run("document.documentElement.scrollWidth <= innerWidth")


def test_tables_fit(page):
    assert page.run("document.querySelectorAll('table').length") == 3
    assert page.run(
        "[...document.querySelectorAll('.scroll:has(table)')].every("
        "each => each.scrollWidth <= each.clientWidth)"
    )


def test_wide_pictures_keep_their_size_on_a_phone(page):
    sizes = page.run(
        "[...document.querySelectorAll('.scroll img')].map("
        "each => [each.width, 96 * parseFloat(each.style.getPropertyValue('--full'))])"
    )
    assert len(sizes) > 5
    for width, full in sizes:
        if page.run("innerWidth") == NARROW[0]:
            assert width == pytest.approx(full, abs=1)
        else:
            assert width <= 64 * 16  # what the page is wide at most


def test_commands_are_wrapped_and_whole(page):
    page.run("getSelection().selectAllChildren(document.querySelector('pre'))")
    assert page.run("getSelection().toString()").split() == LONG
    fits = "each => each.scrollWidth <= each.clientWidth"
    assert page.run(f"[...document.querySelectorAll('pre')].every({fits})")


def test_nothing_is_asked_of_the_network(page):
    assert page.problems == []
    assert {address.split(":")[0] for address in page.requests} <= {"file", "data"}
