"""`python launch/run.py` as a person runs it: real training, exit statuses, no litter."""

import json
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

import hac_suite
from analysis.reading import schema
from analysis.reading.results import load

RUN = Path(__file__).resolve().parents[2] / "launch" / "run.py"


def run(folder: Path, *words: str) -> subprocess.CompletedProcess:
    command = [sys.executable, RUN, *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=240)


@pytest.fixture(scope="module")
def experiment(tmp_path_factory) -> Path:
    """A folder in which a small experiment was run; what that printed is in it."""
    folder = tmp_path_factory.mktemp("elsewhere")
    done = run(folder, *SMALL, "--novideo", "--workers=2")
    (folder / "stdout").write_text(done.stdout)
    (folder / "stderr").write_text(done.stderr)
    assert done.returncode == 0, done.stderr
    return folder


SMALL = (
    "--task=ur5_reacher", "--seeds=2", "--subgoal_layers=1", "--periods=1",
    "--config.episodes_per_period=4", "--config.test_episodes=2", "--config.updates_per_episode=1",
)  # fmt: skip


def test_a_small_experiment_from_another_folder(experiment):
    stdout, stderr = ((experiment / name).read_text() for name in ("stdout", "stderr"))
    assert "ur5_reacher, 1 subgoal layer: 2 seed(s), episodes 0/4" in stdout
    for printed in (stdout, stderr):  # no terminal: plain lines, no control characters
        assert all(character.isprintable() or character == "\n" for character in printed)
    folder = experiment / "runs" / "ur5_reacher"
    assert str(Path("runs") / "ur5_reacher" / "report.html") in stdout
    results = load(folder)
    assert results["train_episodes"].tolist() == [0, 4, 0, 4]
    assert results["level1_proposed"].iloc[1] > 0
    policy = hac_suite.Policy.load(folder / "policies" / "ur5_reacher_1layers_seed1")
    assert policy.metadata["seed"] == 1
    assert policy.metadata["success_rate"] == results["success_rate"].iloc[-1]
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["config"]["episodes_per_period"] == 4
    assert {path.name for path in folder.iterdir() if not path.name.startswith(".")} == {
        "manifest.json", "results.csv", "figure.png", "figure.csv", "report.html", "policies",
        "checkpoints", "videos",
    }  # fmt: skip


@pytest.mark.slow
def test_one_worker_gives_what_two_give(experiment, tmp_path):
    done = run(tmp_path, *SMALL, "--novideo", "--workers=1")
    assert done.returncode == 0, done.stderr
    two, one = (folder / "runs" / "ur5_reacher" for folder in (experiment, tmp_path))
    jobs = [json.loads((folder / "manifest.json").read_text())["jobs"] for folder in (two, one)]
    assert [sorted(job["seeds"] for job in own) for own in jobs] == [[[0], [1]], [[0, 1]]]
    rows = [load(folder).drop(columns=list(schema.CLOCKS)) for folder in (two, one)]
    pd.testing.assert_frame_equal(*rows)
    for file in sorted((two / "policies").iterdir()):
        assert file.read_bytes() == (one / "policies" / file.name).read_bytes(), file.name


@pytest.mark.slow
@pytest.mark.requires_gl
def test_the_same_command_adds_the_video_that_is_missing(experiment):
    folder = experiment / "runs" / "ur5_reacher"
    before = (folder / "results.csv").read_bytes()
    done = run(experiment, *SMALL)
    assert done.returncode == 0, done.stderr
    assert "2 of 2 seeds are finished already" in done.stdout
    assert [path.name for path in (folder / "videos").iterdir()] == ["ur5_reacher_1layers.mp4"]
    assert "videos/ur5_reacher_1layers.mp4" in (folder / "report.html").read_text()
    assert (folder / "results.csv").read_bytes() == before


@pytest.mark.slow
@pytest.mark.parametrize("word", ["--task=pick_plce", "--config.batch_sze=3"])
def test_a_wrong_command_exits_with_2_one_line_and_nothing_created(tmp_path, word):
    done = run(tmp_path, word)
    assert done.returncode == 2
    assert done.stderr.startswith("error: unknown") and done.stderr.count("\n") == 1
    assert "did you mean" in done.stderr and not done.stdout
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_help(tmp_path):
    done = run(tmp_path, "--help")
    assert done.returncode == 0 and "--task=pick_place" in done.stdout


OWN_TASK = '''"""A task of one's own: the pendulum, in another file."""

import tasks
from tasks import registry
from tasks.families import pendulum


@registry.add(tasks.spec("pendulum_climb"))
def swing(test: bool = False):
    return pendulum.pendulum_climb(test)
'''


@pytest.mark.slow
def test_a_task_in_a_file_of_ones_own_is_trained_as_one_of_the_suite(tmp_path):
    (tmp_path / "mine.py").write_text(OWN_TASK)
    words = [word for word in SMALL if not word.startswith("--task")]
    done = run(tmp_path, "--task=mine.py:swing", *words, "--seeds=1", "--novideo")
    assert done.returncode == 0, done.stderr
    assert "mine-swing, 1 subgoal layer: 1 seed(s)" in done.stdout
    results = load(tmp_path / "runs" / "mine-swing")
    assert set(results["task"]) == {"mine-swing"} and len(results) == 2
    # Another clone has the same file in another folder.
    (tmp_path / "clone").mkdir()
    (tmp_path / "clone" / "mine.py").write_text(OWN_TASK)
    done = run(tmp_path, "--task=clone/mine.py:swing", *words, "--seeds=1", "--novideo")
    assert (done.returncode, "are finished already" in done.stdout) == (0, True), done.stderr
    (tmp_path / "mine.py").write_text(OWN_TASK + "\n# changed\n")
    done = run(tmp_path, "--task=mine.py:swing", *words, "--seeds=2", "--novideo")
    assert done.returncode == 2 and "task_file is" in done.stderr
    done = run(tmp_path, "--task=mine.py:swign", *words)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "did you mean 'swing'?" in done.stderr
