"""`launch/site.py`: the published results, their replays and the docs as one static folder."""

import shutil
from pathlib import Path

import pytest

from analysis.program import CommandError
from analysis.reading import grid
from launch import site
from launch.folder import policies

TASK = "pendulum_climb"


@pytest.fixture
def published(tmp_path):
    """Results, policies and docs, of one task and one agent."""
    shutil.copytree(grid.FOLDER / TASK, tmp_path / "grid" / TASK)
    chosen = tmp_path / "policies"
    chosen.mkdir()
    for file in policies.PUBLISHED.glob(f"{TASK}_1layers*"):
        shutil.copy(file, chosen)
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "index.html").write_text("the docs")
    return tmp_path


@pytest.mark.slow
def test_a_report_and_a_replay_for_each_task_and_the_docs(published):
    pytest.importorskip("viser")
    output = published / "site"
    page = site.build(
        output, published / "grid", published / "policies", published / "docs"
    ).read_text()
    for target in (f"{TASK}/report.html", f"{TASK}/figure.png", "docs/index.html"):
        assert f'"{target}"' in page and (output / target).is_file()
    report = (output / TASK / "report.html").read_text()
    replay = f"replays/{TASK}_1layers.html"
    assert replay in report and (output / TASK / replay).is_file()
    assert list((output / TASK / "policies").glob("*.safetensors"))
    assert not list(published.glob(".*"))  # nothing half made is left


@pytest.mark.parametrize(("words", "docs"), [([], None), (["--docs="], None), (["--docs=a"], "a")])
def test_without_docs_there_is_a_site_as_well(monkeypatch, words, docs):
    asked = []
    monkeypatch.setattr(site, "build", lambda *places: asked.append(places))
    assert site.main(["", *words]) == 0
    assert [docs and Path(docs)] == [places[3] for places in asked]


def test_what_cannot_be_made_is_refused_and_leaves_nothing(published):
    output, data, chosen = (published / name for name in ("site", "grid", "policies"))
    with pytest.raises(CommandError, match="run `make docs` to build them"):
        site.build(output, data, chosen, published / "nowhere")
    with pytest.raises(ValueError, match="holds results of none of the paper's tasks"):
        site.build(output, chosen, chosen, None)
    assert not output.exists()
    output.mkdir()
    (output / "thesis.tex").write_text("mine")
    with pytest.raises(CommandError, match="holds files that are no site"):
        site.build(output, data, chosen, None)
    assert (output / "thesis.tex").read_text() == "mine"
