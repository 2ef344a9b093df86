"""report.html stands alone, shows what the folder has, and escapes what others wrote."""

import base64
import html
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from analysis.report.__main__ import main
from analysis.report.run_report import write_report

CURVES = {0: [[0.0, 0.1], [0.0, 0.2]], 1: [[0.0, 0.9], [0.0, 1.0], [0.0, None]], 2: [[0.0]]}
VOID = {"meta", "img", "link", "br"}


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
    rows = re.findall(r"<tr>(<td>.*?)</tr>", path.read_text(encoding="utf-8"))
    return [re.findall(r"<td>(.*?)</td>", row) for row in rows]


def test_figures_are_inside_the_page_and_nothing_is_fetched(make_run):
    path = write_report(make_run(CURVES))
    page = Page(path)
    sources = page.values("img", "src")
    assert len(sources) == 2
    for source in sources:
        kind, data = source.split(",", 1)
        assert kind == "data:image/png;base64"
        assert base64.b64decode(data).startswith(b"\x89PNG")
    assert not {"script", "link", "iframe"} & {tag for tag, _ in page.tags}
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
    page = Page(write_report(folder))
    assert page.values("video", "src") == ["videos/pick_place_1layers.mp4"]
    links = page.values("a", "href")
    assert "policies/a%20b%231.safetensors" in links
    assert "results.csv" in links and "figure.png" not in links
    assert all(not link.startswith(("/", "http")) for link in links)


def test_lacking_parts_are_said(make_run):
    text = Page(write_report(make_run(CURVES))).text
    assert "holds no videos" in text
    assert "No manifest.json here" in text
    assert "--task=pick_place --seeds=3 --subgoal_layers=0,1,2 --periods=1" in text


def _manifest(*commands: list[str]) -> dict:
    """A manifest of these launches, oldest first, in the shape that launching leaves."""
    *earlier, last = [
        {"command": command, "started": f"2026-01-0{day}", "commit": "abc"}
        for day, command in enumerate(commands, start=1)
    ]
    config = {"discount": 0.98, "hidden_sizes": [64, 64]}
    return {"task": "pick_place", "config": config, "earlier_launches": earlier, **last}


def _commands(path: Path) -> list[str]:
    (block,) = re.findall(r"<pre>(.*?)</pre>", path.read_text(encoding="utf-8"), re.DOTALL)
    return html.unescape(block).splitlines()


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
    page = Page(path)
    assert not {"script", "b", "i"} & {tag for tag, _ in page.tags}
    assert page.values("video", "src") == ["videos/%3Cb%3E%27%22.mp4"]
    assert evil in page.text


def test_command_line(make_run, capsys, tmp_path):
    folder = make_run(CURVES)
    assert main(["", str(folder)]) == 0
    assert capsys.readouterr().out.strip() == str(folder / "report.html")
    assert main(["", str(tmp_path / "nothing")]) == 2
    assert "no results.csv here" in capsys.readouterr().err
