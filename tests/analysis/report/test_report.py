"""report.html stands alone, shows what the folder has, and escapes what others wrote."""

import base64
import html
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import pytest

from analysis.reading import grid
from analysis.report import page
from analysis.report.__main__ import main
from analysis.report.run_report import write_report
from launch.asking import lists

# A mean of nothing, say, where an agent has no row yet.
pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")

CURVES = {0: [[0.0, 0.1], [0.0, 0.2]], 1: [[0.0, 0.9], [0.0, 1.0], [0.0, None]], 2: [[0.0]]}
VOID = {"meta", "img", "link", "br"}


@pytest.fixture(autouse=True)
def empty_pictures(monkeypatch):
    """To draw figures takes most of a report's time, and one test looks at them."""

    def of(figure, description, caption, dpi):
        width = figure.get_figwidth()
        return page.Picture("data:image/png;base64,", description, caption, width)

    monkeypatch.setattr(page.Picture, "of", of)


class Page(HTMLParser):
    """Collects tags, attributes and text, and checks that tags nest."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))
        assert self._open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        self.text += data

    def values(self, tag: str, attribute: str) -> list[str | None]:
        return [attrs[attribute] for name, attrs in self.tags if name == tag and attribute in attrs]


def _cells(path: Path) -> list[list[str]]:
    rows = re.findall(r"<tr [^>]*>(<td .*?)</tr>", path.read_text(encoding="utf-8"))
    return [re.findall(r"<td [^>]*>(.*?)</td>", row) for row in rows]


def test_figures_are_inside_the_page_and_nothing_is_fetched(make_run, monkeypatch):
    monkeypatch.undo()
    path = write_report(make_run(CURVES))
    shown = Page(path)
    sources = shown.values("img", "src")
    assert len(sources) == 4
    for source in sources:
        kind, data = source.split(",", 1)
        assert kind == "data:image/png;base64"
        assert base64.b64decode(data).startswith(b"\x89PNG")
    assert not {"script", "link", "iframe"} & {tag for tag, _ in shown.tags}
    assert "http" not in path.read_text(encoding="utf-8")


def test_table_gives_success_seeds_and_steps(make_run):
    rows = _cells(write_report(make_run(CURVES)))
    assert rows[0] == [
        "0 subgoal layers", "15.0% [10.0%, 20.0%]", "2", "1 (300)", "- (0 of 2 seeds)", "110",
    ]  # fmt: skip
    assert rows[1] == [
        "1 subgoal layer", "95.0% [90.0%, 100.0%]", "2 of 3 got this far", "1 (300)",
        "300 (2 of 3 seeds)", "110",
    ]  # fmt: skip
    assert rows[2][1:3] == ["0.0% (one seed, no interval)", "1"]
    assert rows[2][5] == "-"


def test_videos_and_policies_are_linked_by_relative_paths(make_run):
    folder = make_run(CURVES)
    for name in ("videos/pick_place_1layers.mp4", "policies/a b#1.safetensors"):
        (folder / name).parent.mkdir()
        (folder / name).touch()
    shown = Page(write_report(folder))
    assert shown.values("video", "src") == ["videos/pick_place_1layers.mp4"]
    links = shown.values("a", "href")
    assert "policies/a%20b%231.safetensors" in links
    assert "results.csv" in links and "figure.png" not in links
    assert all(not link.startswith(("/", "http")) for link in links)


def test_lacking_parts_are_said(make_run):
    text = Page(write_report(make_run(CURVES))).text
    assert "holds no videos" in text
    assert "No manifest.json here" in text
    assert "--task=pick_place --seeds=3 --subgoal_layers=0,1,2 --periods=1" in text


@pytest.mark.parametrize(
    ("seeds", "word"),
    [
        (range(4), "4"),
        ([0], "1"),
        (range(100, 104), "100-103"),
        ([3, 5], "3,5"),
        ([7], "7-7"),
        ([0, 1, 2, 8, 20, 21], "0-2,8,20-21"),
    ],
)
def test_the_inferred_command_trains_the_seeds_of_the_results(make_run, make_results, seeds, word):
    folder = make_run(CURVES)
    results = make_results({1: [[0.0, 0.5]] * len(seeds)})
    results["seed"] = results["seed"].map(dict(enumerate(seeds)))
    results.to_csv(folder / "results.csv", index=False)
    assert f"--seeds={word} --subgoal_layers=1" in Page(write_report(folder)).text
    assert lists.seeds(word) == tuple(seeds)


def _manifest(*commands: list[str]) -> dict:
    """A manifest of these launches, oldest first, in the shape that launching leaves."""
    *earlier, last = [
        {"command": command, "started": f"2026-01-0{day}", "commit": "abc"}
        for day, command in enumerate(commands, start=1)
    ]
    config = {"discount": 0.98, "hidden_sizes": [64, 64]}
    return {"task": "pick_place", "config": config, "earlier_launches": earlier, **last}


def _commands(path: Path) -> list[str]:
    blocks = re.findall(r"<pre>(.*?)</pre>", path.read_text(encoding="utf-8"), re.DOTALL)
    return [html.unescape(re.sub(r"</?span>", "", block)) for block in blocks]


def test_commands_and_configuration_come_from_the_manifest(make_run):
    folder = make_run(CURVES)
    first = ["python", "launch/run.py", "--task=pick_place", "--seeds=1"]
    second = ["python", "launch/run.py", "--task=pick_place", "--out=my runs"]
    (folder / "manifest.json").write_text(json.dumps(_manifest(first, second, first, second)))
    path = write_report(folder)
    assert _commands(path) == [
        "python launch/run.py --task=pick_place --seeds=1",
        "python launch/run.py --task=pick_place '--out=my runs'",
    ]
    entries = _cells(path)
    assert ["config.discount", "0.98"] in entries
    assert ["config.hidden_sizes", "[64, 64]"] in entries
    assert ["earlier_launches.1.started", "2026-01-02"] in entries


def test_the_command_of_a_single_launch_is_shown(make_run):
    folder = make_run(CURVES)
    words = ["python", "launch/run.py", "--seeds=7"]
    (folder / "manifest.json").write_text(json.dumps(_manifest(words)))
    assert _commands(write_report(folder)) == ["python launch/run.py --seeds=7"]


@pytest.mark.parametrize(
    "content", ["{", "[1]", '{"earlier_launches": [1, {}]}', '{"command": "python x"}']
)
def test_a_broken_manifest_does_not_cost_the_report(make_run, content):
    folder = make_run(CURVES)
    (folder / "manifest.json").write_text(content)
    assert "python launch/run.py --task=pick_place" in Page(write_report(folder)).text


def test_markup_in_names_and_manifest_is_escaped(make_run, make_results, tmp_path):
    evil = "<script>alert('x')</script>\"&"
    folder = make_run(CURVES)
    make_results(CURVES, task=evil).to_csv(folder / "results.csv", index=False)
    (folder / "manifest.json").write_text(
        json.dumps({evil: evil, "command": [evil], "config": {"a": {"b": evil}}})
    )
    for name in ("videos", "policies"):
        (folder / name).mkdir()
    (folder / "videos" / "<b>'\".mp4").touch()
    (folder / "policies" / "<i>.safetensors").touch()
    path = write_report(folder)
    shown = Page(path)
    assert not {"script", "b", "i"} & {tag for tag, _ in shown.tags}
    assert shown.values("video", "src") == ["videos/%3Cb%3E%27%22.mp4"]
    assert evil in shown.text


def test_command_line(make_run, capsys, tmp_path):
    folder = make_run(CURVES)
    assert main(["", str(folder)]) == 0
    assert capsys.readouterr().out.strip() == str(folder / "report.html")
    assert main(["", str(tmp_path / "nothing")]) == 2
    assert "no results.csv here" in capsys.readouterr().err


def test_everything_can_be_read_without_eyes_or_a_mouse(make_run):
    folder = make_run(CURVES)
    for name in ("videos/pick_place_1layers.mp4", "replays/pick_place_1layers.html"):
        (folder / name).parent.mkdir()
        (folder / name).touch()
    shown = Page(write_report(folder))
    assert all(shown.values("img", "alt")) and len(shown.values("img", "alt")) == 4
    assert shown.values("video", "aria-label") == ["video of the agent with 1 subgoal layer"]
    assert [tag for tag, _ in shown.tags].count("h1") == 1
    assert set(shown.values("th", "scope")) == {"col"}
    assert shown.values("html", "lang") == ["en"]
    # What scrolls sideways can be reached by the keyboard, and says what it is.
    regions = [attrs for tag, attrs in shown.tags if attrs.get("class") == "scroll"]
    assert all(attrs["tabindex"] == "0" and attrs["aria-label"] for attrs in regions)
    anchors = {link for link in shown.values("a", "href") if link.startswith("#")}
    assert {f"#{name}" for name in shown.values("section", "id")} == anchors
    assert "replays/pick_place_1layers.html" in shown.values("a", "href")


def test_wide_pictures_scroll_by_themselves_and_cells_name_their_column(make_run):
    """So that a phone can show both; test_report_in_browser.py looks at that."""
    path = write_report(make_run(CURVES))
    regions = [attrs for _, attrs in Page(path).tags if attrs.get("class") == "scroll"]
    text = path.read_text(encoding="utf-8")
    wide = re.findall(r'<img [^>]*alt="([^"]*)" style="--full: [\d.]+in">', text)
    assert len(wide) == 3 and set(wide) <= {attrs["aria-label"] for attrs in regions}
    assert text.count("Move it sideways") == 3  # but not the first one, which a phone has room for
    assert '<td role="cell" data-heading="steps to goal">110</td>' in text
    assert re.search(r"pre \{[^}]*white-space: pre-wrap", text)  # and commands are wrapped


def _luminance(colour: str) -> float:
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_text_stands_out_from_its_ground_in_both_schemes(make_run):
    """WCAG 2 AA: 4.5 to 1."""
    style = write_report(make_run(CURVES)).read_text(encoding="utf-8")
    light, dark = (
        dict(re.findall(r"--(\w+): (#[0-9a-f]{6})", block))
        for block in re.findall(r":root \{(.*?)\}", style, re.DOTALL)
    )
    for colours in (light, dark):
        for text in ("text", "quiet", "link", "accent"):
            for ground in ("page", "panel"):
                pair = sorted(_luminance(colours[name]) for name in (text, ground))
                assert (pair[1] + 0.05) / (pair[0] + 0.05) >= 4.5, (text, ground)


def test_the_verdict_and_the_best_agent_are_in_the_first_lines(make_run):
    curves = {0: [[0.0, 0.1, 0.2, 0.2]] * 6, 1: [[0.0, 0.8, 0.8, 0.9]] * 6}
    text = " ".join(Page(write_report(make_run(curves))).text.split())
    assert "After 900 training episodes, the agent with 1 subgoal layer achieves 90.0%" in text
    assert "Hierarchy against the flat agent: with 1 subgoal layer it helps at equal " in text
    alone = make_run({1: [[0.0, 0.5]]}, task="ur5_reacher")
    text = " ".join(Page(write_report(alone)).text.split())
    assert "This cannot be decided yet: this folder holds results of 1 subgoal layer only" in text


def test_few_seeds_are_flagged(make_run):
    few = Page(write_report(make_run({1: [[0.0, 0.5]] * 4}))).text
    assert "fewer than 5 seeds: little more than their range" in few
    enough = Page(write_report(make_run({1: [[0.0, 0.5]] * 5}, task="ur5_reacher"))).text
    assert "fewer than" not in enough


def test_the_heading_speaks_of_failing_tests_only_where_they_are_shown(make_run):
    published, folder = grid.FOLDER / "pick_place", make_run(CURVES)
    heading = "What was learnt, and which tests fail"
    shutil.copy(published / "subgoals.csv", folder)
    page = Page(write_report(folder))
    assert "What was learnt" in page.text and heading not in page.text
    assert "level 2 of the agent with 2 subgoal layers" in page.values("img", "alt")[-1]
    shutil.copy(published / "anatomy.json", folder / "failures.json")
    assert Page(write_report(folder)).text.count(heading) == 2  # in the contents, and above them


def test_recorded_episodes_are_drawn(make_run):
    published = grid.FOLDER / "pick_place"
    folder = make_run(CURVES)
    shutil.copy(published / "anatomy.json", folder)
    pictures = Page(write_report(folder)).values("img", "alt")
    assert pictures[3:-1] == [f"one test episode of the agent with {k} subgoal layer{s}"
                            for k, s in ((0, "s"), (1, ""), (2, "s"))]  # fmt: skip
    (folder / "anatomy.json").write_text("{")
    assert len(Page(write_report(folder)).values("img", "alt")) == 4
    record = json.loads((published / "anatomy.json").read_text())
    deep = max(record["episodes"], key=lambda episode: episode["subgoal_layers"])
    deep["subgoals"][0]["subgoal"] = []  # it can be read, and not be drawn
    (folder / "anatomy.json").write_text(json.dumps(record))
    assert len(Page(write_report(folder)).values("img", "alt")) == 4
