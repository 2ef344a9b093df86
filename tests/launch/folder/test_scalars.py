"""--tensorboard: the same numbers as in results.csv, and only once, whatever was interrupted."""

import sys
from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from analysis.reading.results import load
from launch.folder import results
from launch.folder.agents import Agent, Job
from launch.folder.layout import RunFolder
from launch.folder.scalars import Scalars
from tests.launch import fake_jobs
from tests.launch.launching import TASK, launch

pytestmark = pytest.mark.usefixtures("undrawn")


def curve(out: Path, seed: int, tag: str) -> list[tuple[int, float]]:
    """Training episodes and value of each point."""
    folder = out / TASK / "tensorboard" / f"{TASK}_1layers_seed{seed}"
    events = EventAccumulator(str(folder))
    events.Reload()
    if tag not in events.Tags()["scalars"]:
        return []
    return [(event.step, event.value) for event in events.Scalars(tag)]


def test_each_seed_has_its_curves(tmp_path):
    assert launch(tmp_path, "--seeds=2", "--periods=2", "--tensorboard") == 0
    for seed in (0, 1):
        assert curve(tmp_path, seed, "success_rate") == [(0, 0.0), (4, 0.25), (8, 0.5)]
        assert curve(tmp_path, seed, "mean_steps_to_goal") == [(0, 30), (4, 30), (8, 30)]
        assert curve(tmp_path, seed, "level1/q_mean") == []  # empty in results.csv
    assert not (tmp_path / TASK / "tensorboard" / f"{TASK}_1layers_seed2").exists()


@pytest.mark.slow
def test_going_on_repeats_no_point_and_catches_up_with_what_was_not_watched(tmp_path):
    (tmp_path / "kill").write_text("1")
    assert launch(tmp_path, "--seeds=2", "--periods=3", "--tensorboard") == 1
    assert curve(tmp_path, 1, "success_rate") == [(0, 0.0), (4, 0.25)]
    (tmp_path / "kill").unlink()
    assert launch(tmp_path, "--seeds=2", "--periods=3") == 0
    assert launch(tmp_path, "--seeds=2", "--periods=3", "--tensorboard") == 0
    whole = [(0, 0.0), (4, 0.25), (8, 0.5), (12, 0.75)]
    assert curve(tmp_path, 0, "success_rate") == curve(tmp_path, 1, "success_rate") == whole


def test_the_diagnostics_of_each_level_are_there(tmp_path):
    folder = RunFolder(tmp_path, TASK)
    with folder.lock():
        folder.prepare({})
    job = Job(Agent(TASK, 1), (0,))
    rows = [
        {**fake_jobs.row(job, 0, period), "level0_q_mean": -2.5 * period, "level1_tested": 0.25}
        for period in (0, 1)
    ]
    results.append(folder.results, rows[:1])  # before, and then while it watches
    scalars = Scalars(folder)
    scalars.add(rows[1:])
    scalars.close()
    assert curve(tmp_path, 0, "level0/q_mean") == [(0, 0.0), (4, -2.5)]
    assert curve(tmp_path, 0, "level1/tested") == [(0, 0.25), (4, 0.25)]


def test_curves_that_cannot_be_written_do_not_harm_training(tmp_path, capsys, monkeypatch):
    def full(*_):
        raise OSError("No space left on device")

    monkeypatch.setattr("launch.folder.scalars.SummaryWriter.add_scalar", full)
    assert launch(tmp_path, "--seeds=2", "--periods=1", "--tensorboard") == 0
    assert capsys.readouterr().out.count("no more curves for TensorBoard: No space left") == 1
    assert len(load(tmp_path / TASK)) == 4


def test_without_the_flag_the_package_is_not_needed(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    assert launch(tmp_path, "--seeds=2", "--periods=1") == 0
    assert not (tmp_path / TASK / "tensorboard").exists()
