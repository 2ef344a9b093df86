"""`python launch/run.py` as a person runs it: real training, exit statuses, no litter."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import hac_suite
from analysis.load import load

RUN = Path(__file__).resolve().parents[2] / "launch" / "run.py"


def run(folder: Path, *words: str) -> subprocess.CompletedProcess:
    command = [sys.executable, RUN, *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=240)


def test_a_small_experiment_from_another_folder(tmp_path):
    done = run(
        tmp_path, "--task=pendulum_climb", "--seeds=2", "--subgoal_layers=1", "--periods=1",
        "--novideo", "--config.episodes_per_period=4", "--config.test_episodes=2",
        "--config.updates_per_episode=1",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "pendulum_climb, 1 subgoal layer: 2 seed(s), episodes 0/4" in done.stdout
    folder = tmp_path / "runs" / "pendulum_climb"
    assert str(Path("runs") / "pendulum_climb" / "report.html") in done.stdout
    results = load(folder)
    assert results["train_episodes"].tolist() == [0, 4, 0, 4]
    assert results["level1_proposed"].iloc[1] > 0
    policy = hac_suite.Policy.load(folder / "policies" / "pendulum_climb_1layers_seed1")
    assert policy.metadata["seed"] == 1
    assert policy.metadata["success_rate"] == results["success_rate"].iloc[-1]
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["config"]["episodes_per_period"] == 4
    assert {path.name for path in folder.iterdir() if not path.name.startswith(".")} == {
        "manifest.json", "results.csv", "figure.png", "figure.csv", "report.html", "policies",
        "videos",
    }  # fmt: skip


@pytest.mark.parametrize("word", ["--task=pick_plce", "--config.batch_sze=3"])
def test_a_wrong_command_exits_with_2_one_line_and_nothing_created(tmp_path, word):
    done = run(tmp_path, word)
    assert done.returncode == 2
    assert done.stderr.startswith("error: unknown") and done.stderr.count("\n") == 1
    assert "did you mean" in done.stderr and not done.stdout
    assert list(tmp_path.iterdir()) == []


def test_help(tmp_path):
    done = run(tmp_path, "--help")
    assert done.returncode == 0 and "--task=pick_place" in done.stdout
