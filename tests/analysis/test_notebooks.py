"""The notebooks run from top to bottom, on the published results and on others."""

import json
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

from analysis.claims import judge
from analysis.reading import grid, names, paper

FOLDER = Path(__file__).parents[2] / "analysis" / "notebooks"
NAMES = ("author_a_task", "claims", "reproduce_figure5", "subgoal_anatomy")
CURVES = {0: [[0.0, 0.1], [0.0, 0.0]], 1: [[0.0, 0.9], [0.1, 1.0]]}


@pytest.fixture
def execute(monkeypatch):
    """Runs a notebook in a kernel of its own, with its parameter set to a folder or as it is."""
    monkeypatch.setenv("PYTHONPATH", str(FOLDER.parents[1]))
    monkeypatch.delenv("MUJOCO_GL", raising=False)

    def run(name: str, parameter: str = "data", folder: Path | None = None, timeout: int = 120):
        notebook = _read(name)
        (parameters,) = [
            cell for cell in notebook.cells if "parameters" in cell.metadata.get("tags", [])
        ]
        assert f"{parameter} = None" in parameters.source
        if folder is not None:
            parameters.source = f"{parameter} = {str(folder)!r}"
        resources = {"metadata": {"path": str(FOLDER)}}
        return NotebookClient(notebook, timeout=timeout, resources=resources).execute()

    return run


def _read(name: str) -> nbformat.NotebookNode:
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)


def _outputs(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def _printed(notebook: nbformat.NotebookNode) -> str:
    return "".join(o.text for o in _outputs(notebook) if o.output_type == "stream")


def _pictures(notebook: nbformat.NotebookNode) -> int:
    return sum("image/png" in output.get("data", {}) for output in _outputs(notebook))


def test_every_notebook_is_tested():
    assert sorted(path.stem for path in FOLDER.glob("*.ipynb")) == sorted(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_notebooks_are_kept_with_their_outputs_in_order(name):
    notebook = _read(name)
    counts = [cell.execution_count for cell in notebook.cells if cell.cell_type == "code"]
    assert counts == list(range(1, len(counts) + 1))
    assert _pictures(notebook) > 0
    assert not [output for output in _outputs(notebook) if output.output_type == "error"]
    assert str(FOLDER.parents[1]) not in json.dumps(notebook)  # nobody else has these folders


@pytest.mark.slow
def test_figure5_of_another_folder(execute, make_run):
    make_run(CURVES, task="ur5_reacher")
    notebook = execute("reproduce_figure5", folder=make_run(CURVES).parent)
    assert _pictures(notebook) == 2
    printed = _printed(notebook)
    assert "pick_place: 8 test periods of 4 runs" in printed
    assert "pendulum_climb: no runs yet" in printed


@pytest.mark.slow
def test_figure5_stops_at_a_folder_without_results(execute, tmp_path):
    with pytest.raises(CellExecutionError, match="holds results of none of the paper's tasks"):
        execute("reproduce_figure5", folder=tmp_path)


@pytest.mark.slow
def test_figure5_of_the_published_results(execute):
    printed = _printed(execute("reproduce_figure5"))
    for task, results in grid.load_grid(grid.FOLDER).items():
        assert f"{task}: {len(results)} test periods of " in printed


@pytest.mark.slow
def test_the_claims_about_the_published_results(execute):
    notebook = execute("claims")
    assert _pictures(notebook) >= 2
    printed = _printed(notebook)
    for claim in judge(grid.FOLDER):
        assert f"({claim.letter}) {claim.verdict}: {claim.reason}" in printed


@pytest.mark.slow
def test_claims_without_records_of_subgoals(execute, make_run):
    folder = make_run(CURVES).parent
    printed = _printed(execute("claims", folder=folder))
    assert printed.count(f"record_subgoals.py --task=pick_place --output={folder}/pick_place") == 2


@pytest.mark.slow
def test_the_anatomy_of_the_recorded_episodes(execute):
    notebook = execute("subgoal_anatomy")
    recorded = sorted(grid.FOLDER.glob(f"*/{names.ANATOMY}"))
    episodes = [json.loads(path.read_text())["episodes"] for path in recorded]
    assert _pictures(notebook) == sum(map(len, episodes)) > 0
    missing = len(paper.TITLES) - len(recorded)
    assert _printed(notebook).count("nothing recorded yet") == missing


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_task_is_authored_trained_and_filmed(execute, tmp_path):
    notebook = execute("author_a_task", "output", tmp_path / "new", timeout=600)
    lines = _printed(notebook).splitlines()
    first, *_, last = (line.rpartition("tests ")[2] for line in lines if " episodes: goals" in line)
    assert first == "0%, 0%"
    assert max(float(share.strip(" %")) for share in last.split(",")) >= 80
    written = {path.name for path in (tmp_path / "new").iterdir()}
    assert {"arm.xml", "arm_reach_1layers.json", "arm_reach_1layers.safetensors"} <= written
    if "rendering with disabled" not in lines:
        assert {"video.mp4", "strip.png"} <= written
