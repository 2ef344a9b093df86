"""The page over all runs of a folder: what it lists, and what it says of what goes on."""

import re

from analysis.report.index import main, write_index
from tests.analysis.report.test_report import Page

CURVES = {0: [[0.0, 0.1], [0.0, 0.3]], 1: [[0.0, 0.9], [0.0, None]]}


def test_every_run_folder_is_listed_with_its_agents(make_run):
    folder = make_run(CURVES).parent
    (folder / "pick_place" / "figure.png").touch()
    (folder / "pick_place" / "report.html").touch()
    make_run({1: [[0.0, 1.0]]}, task="ur5_reacher")
    (folder / "nothing here").mkdir()
    page = Page(write_index(folder))
    assert "2 run folders." in page.text
    assert page.values("a", "href") == ["pick_place/report.html"]
    assert page.values("img", "src") == ["pick_place/figure.png"]
    rows = re.findall(r"<tr [^>]*><td [^>]*>(.*?)</tr>", (folder / "index.html").read_text())
    assert [re.sub(r"<.*?>", "|", row) for row in rows] == [
        "0 subgoal layers||2||300||20%|",
        "1 subgoal layer||2||0 to 300||45%|",
        "1 subgoal layer||1||300||100%|",
    ]


def test_what_is_at_work_is_said_and_the_page_loads_itself_again(make_run):
    folder = make_run(CURVES).parent
    page = Page(write_index(folder, {"pick_place"}))
    assert "1 run folder, 1 running." in page.text
    assert "0 subgoal layers after 300 episodes; 1 subgoal layer after 0 to 300" in page.text
    assert page.values("meta", "http-equiv") == ["refresh"]
    assert Page(write_index(folder)).values("meta", "http-equiv") == []


def test_a_damaged_run_folder_is_listed_with_the_reason(make_run):
    folder = make_run(CURVES).parent
    (folder / "broken").mkdir()
    (folder / "broken" / "results.csv").write_text("a,b\n1,2\n")
    (folder / "begun").mkdir()
    (folder / "begun" / "manifest.json").write_text("{}")
    text = Page(write_index(folder)).text
    assert "lacks the column(s)" in text and "no results.csv here" in text


def test_command_line(make_run, capsys, tmp_path):
    folder = make_run(CURVES).parent
    assert main(["", str(folder)]) == 0
    assert capsys.readouterr().out.strip() == str(folder / "index.html")
    (tmp_path / "empty").mkdir()
    assert main(["", str(tmp_path / "empty")]) == 2
    assert "holds no run folder" in capsys.readouterr().err
