"""`launch/status.py`: from a run folder's files alone, whatever became of the launch."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from launch import status
from launch.folder import results
from launch.folder import states as folder_states
from launch.folder.agents import Agent, Job
from launch.folder.layout import RunFolder
from tests.launch import fake_jobs
from tests.launch.launching import TASK, launch, words

ROOT = Path(__file__).resolve().parents[2]
BOTH = "--subgoal_layers=0,1"


pytestmark = pytest.mark.usefixtures("undrawn")


def states(out: Path) -> list[tuple[int, int, str]]:
    runs = folder_states.read(out / TASK).runs
    return [(run.subgoal_layers, run.seed, run.state) for run in runs]


def said(path: Path, capsys) -> list[str]:
    """What the command prints, on a success."""
    capsys.readouterr()
    assert status.main(["launch/status.py", str(path)]) == 0
    return capsys.readouterr().out.splitlines()


def test_a_finished_experiment(tmp_path, capsys):
    assert launch(tmp_path, BOTH, "--seeds=2", "--periods=2") == 0
    assert states(tmp_path) == [(k, seed, "done") for k in (0, 1) for seed in (0, 1)]
    headline, headings, *agents = said(tmp_path / TASK, capsys)
    assert "ended at 20" in headline and headline.endswith("4 of 4 runs done")
    assert headings.split()[:4] == ["agent", "seeds", "done", "running"]
    assert agents[1].split()[4:] == ["2", "2", "-", "-", "-", "-", "2/2", "50%", "-"]
    assert len(agents) == 2  # and nothing to go on with


@pytest.mark.slow
def test_what_failed_is_named_with_its_reason_and_the_command_that_tries_again(tmp_path, capsys):
    (tmp_path / "fail").write_text("1")
    assert launch(tmp_path, BOTH, "--seeds=2", "--periods=2", "--workers=1") == 1
    assert states(tmp_path) == [
        (0, 0, "done"), (0, 1, "done"), (1, 0, "failed"), (1, 1, "failed")
    ]  # fmt: skip
    printed = said(tmp_path / TASK, capsys)
    assert "ended" in printed[0] and "2 of 4 runs done" in printed[0]
    reason, file, command = printed[-3:]
    assert reason.startswith(f"failed: {TASK}, 1 subgoal layer, seeds 0, 1: RuntimeError: told to")
    assert Path(file.split()[1]).read_text().strip().endswith("told to fail")
    assert command == "to resume: python " + " ".join(
        words(tmp_path, BOTH, "--seeds=2", "--periods=2", "--workers=1")
    )
    (tmp_path / "fail").unlink()
    assert launch(tmp_path, BOTH, "--seeds=2", "--periods=2") == 0
    assert not any("failed:" in line for line in said(tmp_path / TASK, capsys))


def test_what_the_latest_launch_was_not_for_is_done_by_its_own_periods(tmp_path):
    assert launch(tmp_path, "--subgoal_layers=0", "--seeds=1", "--periods=1") == 0
    assert launch(tmp_path, "--subgoal_layers=1", "--seeds=1", "--periods=3") == 0
    assert states(tmp_path) == [(0, 0, "done"), (1, 0, "done")]


LAUNCH = """
import pathlib, sys
from tests.launch import fake_jobs, launching
launching.launch(pathlib.Path(sys.argv[1]), *sys.argv[2:], work=fake_jobs.train_for_ever,
                 method="spawn")
"""


@pytest.mark.slow
def test_a_running_experiment_and_the_same_one_killed(tmp_path, capsys):
    asked = [BOTH, "--seeds=2", "--periods=2", "--workers=1"]
    process = subprocess.Popen(
        [sys.executable, "-c", LAUNCH, tmp_path, *asked], cwd=ROOT, stdout=subprocess.DEVNULL
    )
    try:
        folder, deadline = RunFolder(tmp_path, TASK), time.monotonic() + 300
        while not results.read(folder.results)[0]:
            assert process.poll() is None and time.monotonic() < deadline
            time.sleep(0.2)
        queued = folder.checkpoints_of(0, 1)  # begun in an earlier launch, as it were
        queued.mkdir(parents=True)
        (queued / "000000300.json").write_text("{}")
        state = folder_states.read(folder.path)
        assert state.holder is not None and state.holder["pid"] == process.pid
        assert [run.state for run in state.runs] == ["waiting", "waiting", "running", "running"]
        headline = said(folder.path, capsys)[0]
        assert f"running (process {process.pid}, since 20" in headline
        assert "0 of 4 runs done; the time left is shown after the first test periods" in headline
    finally:
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    assert [state for _, _, state in states(tmp_path)] == ["waiting", *["stopped"] * 3]
    before = sorted(folder.path.rglob("*"))
    printed = said(folder.path, capsys)
    assert sorted(folder.path.rglob("*")) == before
    assert "interrupted, no process is running; 0 of 4 runs done" in printed[0]
    assert printed[-1].startswith("to resume: python ") and "--seeds=2" in printed[-1]


def folder_with(
    out: Path, measured: dict[tuple[int, int], list[float]], workers: int, planned=(), seeds=(0, 1)
) -> Path:
    """A folder of a killed launch: wall seconds at the test periods of each (layers, seed)."""
    folder = RunFolder(out, TASK)
    folder.policies.mkdir(parents=True)
    asked = {"subgoal_layers": [0, 1], "seeds": list(seeds), "periods": 4}
    text = {"task": TASK, "max_steps": 1, "horizons": {}, "config": {}, "jobs": []}
    latest = {"earlier_launches": [], "asked": asked, "failures": [], "workers": workers}
    latest["planned"] = [{"subgoal_layers": 0, "seeds": list(own)} for own in planned]
    folder.manifest.write_text(json.dumps({**text, **latest}))
    rows = []
    for (layers, seed), seconds in measured.items():
        job = Job(Agent(TASK, layers), (seed,))
        rows += [
            {**fake_jobs.row(job, seed, period), "wall_seconds": wall}
            for period, wall in enumerate(seconds)
        ]
    results.rewrite(folder.results, rows)
    return folder.path


@pytest.mark.parametrize(
    ("measured", "planned", "workers", "left"),
    [
        # One job of two seeds, 20 s a period, 2 periods to go; 2 seeds of twice the levels that
        # have not begun: 10 s a level, seed and period, 4 periods of 2 levels and 2 seeds.
        ({(0, 0): [1.0, 20, 40], (0, 1): [1.0, 20, 41]}, [(0, 1)], 1, 2 * 20 + 10 * 4 * 2 * 2),
        ({(0, 0): [1.0, 20, 40], (0, 1): [1.0, 20, 41]}, [(0, 1)], 2, (40 + 160) / 2),
        # No sooner than the slowest job, whatever the workers: 3 periods of 200 s.
        ({(0, 0): [1.0, 20], (0, 1): [1.0, 21], (1, 0): [1.0, 200], (1, 1): [1.0, 20]}, [], 9, 600),
        ({(0, 0): [1.0]}, [], 1, None),
        ({}, [], 1, None),
    ],
)
def test_the_time_left(tmp_path, measured, planned, workers, left):
    state = folder_states.read(folder_with(tmp_path, measured, workers, planned))
    assert state.seconds_left == (None if left is None else pytest.approx(left, rel=0.01))


def test_running_are_the_seeds_of_the_jobs_at_work_and_not_those_between(tmp_path, monkeypatch):
    path = folder_with(tmp_path, {}, 1, [(3, 5, 9), (4, 6)], seeds=(3, 4, 5, 6, 9))
    monkeypatch.setattr(folder_states.lock, "holder", lambda folder: {})
    log = path / f".{TASK}_0layers_seeds3-9.log"
    log.touch()
    running = {seed for layers, seed, state in states(tmp_path) if state == "running"}
    assert running == {3, 5, 9}
    log.rename(path / f".{TASK}_0layers_seeds3-5.log")  # begun again elsewhere, without seed 9
    assert {seed for _, seed, state in states(tmp_path) if state == "running"} == {3, 5, 9}


def test_a_checkpoint_is_where_a_stopped_run_goes_on_from(tmp_path, capsys):
    path = folder_with(tmp_path, {(0, 0): [1.0, 20]}, 1)
    checkpoints = RunFolder(tmp_path, TASK).checkpoints_of(0, 0)
    checkpoints.mkdir(parents=True)
    for episodes in (300, 450):
        (checkpoints / f"{episodes:09d}.json").write_text("{}")
    assert (0, 0, "stopped") in states(tmp_path) and (1, 0, "waiting") in states(tmp_path)
    assert "episode 450" in said(path, capsys)[2]


def test_within_the_run_folder_a_failure_is_found_as_well(tmp_path, capsys, monkeypatch):
    path = folder_with(tmp_path, {}, 1)
    about = json.loads((path / "manifest.json").read_text())
    about["failures"] = [{"subgoal_layers": 1, "seeds": [0, 1], "reason": "told to"}]
    (path / "manifest.json").write_text(json.dumps(about))
    for place, word in ((path, "."), (tmp_path, TASK)):
        monkeypatch.chdir(place)
        (file,) = [line.split()[1] for line in said(Path(word), capsys) if "see " in line]
        job = Job(Agent(TASK, 1), (0, 1))
        assert Path(file).absolute() == RunFolder(tmp_path, TASK).failure(job)
        assert not Path(file).is_absolute()


def test_what_is_no_run_folder_is_answered_in_one_line(tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    (tmp_path / "other" / TASK).mkdir(parents=True)
    (tmp_path / "other" / TASK / "manifest.json").write_text("{}")
    damaged = folder_with(tmp_path, {}, 1)
    (damaged / "results.csv").write_text("a,b\n")
    (tmp_path / "renamed").mkdir()
    (tmp_path / "renamed" / "manifest.json").write_text((damaged / "manifest.json").read_text())
    for word, answer in (
        ("nowhere", "there is no folder"),
        ("empty", "is not a run folder: it has no manifest.json"),
        ("other", f"it holds the run folders {TASK}"),
        (f"other/{TASK}", "is not a run folder's manifest"),
        (TASK, "lacks the column(s) task"),
        ("renamed", f"holds runs of '{TASK}'"),
    ):
        assert status.main(["launch/status.py", str(tmp_path / word)]) == 2
        printed = capsys.readouterr()
        assert answer in printed.err and printed.err.count("\n") == 1 and not printed.out
    for argv in ([], ["a", "b"]):
        assert status.main(["launch/status.py", *argv]) == 2
        assert "launch/status.py runs/pick_place" in capsys.readouterr().err
    assert status.main(["launch/status.py", "--help"]) == 0


@pytest.mark.slow
def test_from_the_shell_it_is_plain_text_and_quick(tmp_path):
    path = folder_with(tmp_path, {(0, 0): [1.0, 20]}, 1)
    command = [sys.executable, ROOT / "launch" / "status.py", path]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert all(character.isprintable() or character == "\n" for character in done.stdout)
    assert all(len(line) < 150 for line in done.stdout.splitlines()[1:])
