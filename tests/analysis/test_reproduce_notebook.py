"""The notebook runs from top to bottom on a run folder and draws its figure."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

NOTEBOOK = Path(__file__).parents[2] / "analysis" / "notebooks" / "reproduce_figure.ipynb"


@pytest.fixture
def execute(monkeypatch):
    """Runs the notebook in a kernel of its own, on a run folder or on what it takes itself."""
    monkeypatch.setenv("PYTHONPATH", str(NOTEBOOK.parents[2]))

    def run(folder: Path | None) -> nbformat.NotebookNode:
        notebook = nbformat.read(NOTEBOOK, as_version=4)
        (parameters,) = [
            cell for cell in notebook.cells if "parameters" in cell.metadata.get("tags", [])
        ]
        assert "run_folder = None" in parameters.source
        if folder is not None:
            parameters.source = f"run_folder = {str(folder)!r}"
        resources = {"metadata": {"path": str(NOTEBOOK.parent)}}
        return NotebookClient(notebook, timeout=120, resources=resources).execute()

    return run


def _outputs(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def test_draws_the_figure_of_a_run_folder(execute, make_run):
    folder = make_run({0: [[0.0, 0.1], [0.0, 0.0]], 1: [[0.0, 0.9], [0.1, 1.0]]})
    outputs = _outputs(execute(folder))
    pictures = [output for output in outputs if "image/png" in output.get("data", {})]
    assert len(pictures) == 1
    printed = "".join(output.text for output in outputs if output.output_type == "stream")
    assert f"{folder}: 8 test periods of 4 runs" in printed


def test_draws_the_published_results_if_told_nothing(execute):
    outputs = _outputs(execute(None))
    printed = "".join(output.text for output in outputs if output.output_type == "stream")
    assert "pick_place: 330 test periods of 30 runs" in printed
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 1


def test_stops_at_a_folder_without_results(execute, tmp_path):
    with pytest.raises(CellExecutionError, match=r"no results\.csv here"):
        execute(tmp_path)
