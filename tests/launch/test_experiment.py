"""A launch from request to run folder, with work that takes no time in place of training."""

import functools
import io
import json
import os
import signal
import threading
import types

import pytest

from analysis.program import CommandError
from analysis.reading.results import load
from hac_suite import policy_files
from launch import experiment
from launch.asking import doubts, request
from launch.asking.console import Console
from launch.folder import manifest, results
from launch.folder.agents import Agent, Job
from launch.folder.layout import RunFolder
from launch.jobs import messages
from launch.jobs.checkpointing import ResumePoint
from launch.jobs.progress import Board
from launch.jobs.recorder import Recorder
from launch.pictures import scene, video
from tests.launch import fake_jobs
from tests.launch.launching import launch

BOTH = "--subgoal_layers=0,1"


def trained(out) -> list[tuple[int, int]]:
    """(subgoal_layers, seed) of every seed in results.csv, from the rows of period 0."""
    table = load(out / "pendulum_climb")
    first = table[table["period"] == 0]
    return list(zip(first["subgoal_layers"], first["seed"], strict=True))


def jobs(out) -> list[tuple[int, int]]:
    """(subgoal_layers, seed) of every training that ended well, so far."""
    recorded = json.loads((out / "pendulum_climb" / "manifest.json").read_text())
    return sorted(
        (job["subgoal_layers"], seed) for job in recorded["jobs"] for seed in job["seeds"]
    )


def leave_stages(folder: RunFolder, *kept: tuple[int, int]) -> None:
    """Leaves files as if the policies of these (seed, period) had been kept."""
    folder.stages.mkdir(exist_ok=True)
    for pair in kept:
        for file in policy_files.paths(folder.stage(1, *pair)):
            file.touch()


def test_policies_that_were_not_kept_in_time_are_named(tmp_path, capsys):
    assert launch(tmp_path, "--seeds=2", "--periods=2") == 0
    leave_stages(RunFolder(tmp_path, "pendulum_climb"), (0, 0), (0, 1), (1, 0))
    assert "--keep_policies comes" not in capsys.readouterr().out
    assert launch(tmp_path, "--seeds=3", "--periods=2", "--keep_policies=0") == 0
    assert "--keep_policies comes" not in capsys.readouterr().out
    assert launch(tmp_path, "--seeds=2", "--periods=2", "--keep_policies=0,1,2") == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "--keep_policies comes too late for test period(s) 1, 2 of 2 seed(s)" in said
    assert "give another --out to train them again" in said


def test_an_interrupted_seed_keeps_the_policies_that_it_has_before_it(tmp_path):
    folder, agent = RunFolder(tmp_path, "pendulum_climb"), Agent("pendulum_climb", 1)
    asked = request.parse(["run.py", f"--out={tmp_path}", "--periods=4", "--keep_policies=0,1,3"])
    point = ResumePoint(1, [{"period": 0}, {"period": 1}])
    seeds = experiment.AgentSeeds(agent, (), {0: point}, (), (), ())
    (line,) = experiment._not_kept(folder, seeds, asked)
    assert "test period(s) 0, 1 of 1 seed(s)" in line


def test_a_launch_leaves_a_whole_run_folder(tmp_path, capsys):
    assert launch(tmp_path, BOTH, "--seeds=2", "--periods=2") == 0
    folder = RunFolder(tmp_path, "pendulum_climb")
    results = load(folder.path)
    assert len(results) == 2 * 2 * 3
    assert trained(tmp_path) == [(0, 0), (0, 1), (1, 0), (1, 1)]
    for path in (folder.figure, folder.path / "figure.csv", folder.report):
        assert path.stat().st_size > 0
    recorded = json.loads(folder.manifest.read_text())
    assert recorded["horizons"]["1"] == [18, 18] and recorded["max_steps"] == 300
    assert recorded["config"]["discount"] == 0.98
    assert recorded["finished"] is not None
    assert {job["periods"] for job in recorded["jobs"]} == {2}
    assert jobs(tmp_path) == trained(tmp_path)
    shown = folder.report.read_text().replace("<span>", "").replace("</span>", "")
    assert "python launch/run.py --task=pendulum_climb" in shown
    printed = capsys.readouterr().out
    assert "pendulum_climb, 1 subgoal layer" in printed and str(folder.report) in printed
    assert not list(folder.path.glob("*.log")) and not list(folder.path.glob(".*.log"))


@pytest.mark.usefixtures("undrawn")
def test_the_same_command_again_repeats_nothing(tmp_path, capsys):
    assert launch(tmp_path, "--seeds=2", "--periods=1") == 0
    before = (tmp_path / "pendulum_climb" / "results.csv").read_bytes()
    assert launch(tmp_path, "--seeds=2", "--periods=1") == 0
    assert (tmp_path / "pendulum_climb" / "results.csv").read_bytes() == before
    assert len(jobs(tmp_path)) == 2
    assert "2 of 2 seeds are finished already" in capsys.readouterr().out


@pytest.mark.usefixtures("undrawn")
def test_more_seeds_and_agents_train_only_what_is_missing(tmp_path):
    assert launch(tmp_path, "--seeds=1", "--periods=1") == 0
    assert launch(tmp_path, BOTH, "--seeds=2", "--periods=1") == 0
    assert trained(tmp_path) == jobs(tmp_path) == [(0, 0), (0, 1), (1, 0), (1, 1)]


@pytest.mark.usefixtures("undrawn")
def test_a_policy_of_fewer_periods_is_never_taken_for_that_of_more(tmp_path):
    assert launch(tmp_path, "--seeds=1", "--periods=2") == 0
    folder = RunFolder(tmp_path, "pendulum_climb")
    job = Job(Agent("pendulum_climb", 1), (0,))
    results.append(folder.results, [fake_jobs.row(job, 0, 3)])  # of an extension that was killed
    with pytest.raises(CommandError, match="finished after 2 periods, and no whole checkpoint"):
        launch(tmp_path, "--seeds=1", "--periods=3")
    assert load(folder.path)["period"].tolist() == [0, 1, 2, 3]
    assert folder.finished(job.agent, 2) == {0} and not folder.finished(job.agent, 3)


@pytest.mark.usefixtures("undrawn")
def test_one_failing_agent_leaves_the_others_and_is_tried_again_alone(tmp_path, capsys):
    (tmp_path / "fail").write_text("1")
    assert launch(tmp_path, BOTH, "--seeds=2", "--periods=2") == 1
    folder = RunFolder(tmp_path, "pendulum_climb")
    (failure,) = folder.failures.iterdir()
    assert "told to fail" in failure.read_text() and "Traceback" in failure.read_text()
    printed = capsys.readouterr().out
    assert "RuntimeError: told to fail" in printed and str(failure) in printed
    assert jobs(tmp_path) == [(0, 0), (0, 1)]
    (tmp_path / "fail").unlink()
    assert launch(tmp_path, BOTH, "--seeds=2", "--periods=2") == 0
    assert jobs(tmp_path) == trained(tmp_path) == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert len(load(folder.path)) == 2 * 2 * 3
    assert not folder.failures.exists()


@pytest.mark.usefixtures("undrawn")
def test_a_line_cut_by_a_kill_is_dropped_and_its_seed_trained_again(tmp_path, capsys):
    assert launch(tmp_path, "--seeds=1", "--periods=1") == 0
    results = tmp_path / "pendulum_climb" / "results.csv"
    whole = load(results)
    results.write_bytes(results.read_bytes()[:-7])
    assert launch(tmp_path, "--seeds=1", "--periods=1") == 0
    assert "dropped 1 line" in capsys.readouterr().out
    assert load(results).equals(whole)
    assert results.read_text().count("train_episodes") == 1


@pytest.mark.usefixtures("undrawn")
def test_another_configuration_is_refused_and_changes_nothing(tmp_path):
    assert launch(tmp_path, "--seeds=1", "--periods=1") == 0
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*") if path.is_file()}
    with pytest.raises(CommandError, match="batch_size is 256 there and 32 here"):
        launch(tmp_path, "--seeds=2", "--periods=1", "--config.batch_size=32")
    lock = tmp_path / "pendulum_climb" / ".lock"  # names who held it last
    after = {path: path.read_bytes() for path in tmp_path.rglob("*.*") if path.is_file()}
    assert after == {**before, lock: after[lock]}


def test_with_many_tasks_one_refused_folder_means_that_none_is_made(tmp_path):
    other = RunFolder(tmp_path, "ur5_reacher")
    with other.lock(), pytest.raises(CommandError, match="ur5_reacher is in use by"):
        launch(tmp_path, "--task=all", "--seeds=1", "--periods=1")
    assert [path.name for path in tmp_path.iterdir()] == ["ur5_reacher"]
    for file, text in ((other.manifest, "{"), (other.results, "a,b\n")):
        file.write_text(text)
        with pytest.raises(CommandError, match=file.name):
            launch(tmp_path, "--task=all", "--seeds=1", "--periods=1")
        assert [path.name for path in tmp_path.iterdir()] == ["ur5_reacher"]
        file.unlink()


def test_a_skipped_refresh_of_the_figure_is_made_up_for(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr("launch.jobs.recorder.write_figure", lambda path: drawn.append(path))
    clock = [1000.0]
    monkeypatch.setattr(
        "launch.jobs.recorder.time", types.SimpleNamespace(monotonic=lambda: clock[0])
    )
    folder = RunFolder(tmp_path, "pendulum_climb")
    job = Job(Agent("pendulum_climb", 0), (0,))
    with folder.lock():
        recorder = Recorder(
            {folder.task: folder}, {folder.task: manifest.new("", 0, {})}, Console()
        )
        recorder.prepare(folder.task, {})
        with Board([job], 8, Console(file=io.StringIO())) as board:
            for period in range(3):
                rows = [fake_jobs.row(job, 0, period)]
                recorder.receive(board, job, messages.Tested(period, rows))
                recorder.tick()
    assert len(drawn) == 1  # a burst
    clock[0] += 100
    recorder.tick()
    recorder.tick()
    assert len(drawn) == 2


@pytest.mark.usefixtures("undrawn")
def test_a_stopped_launch_goes_on_with_the_same_command(tmp_path, capsys):
    threading.Timer(4.0, os.kill, (os.getpid(), signal.SIGTERM)).start()
    words = ("--seeds=1", "--periods=1", "--subgoal_layers=0")
    assert launch(tmp_path, *words, work=fake_jobs.train_for_ever) == 128 + 15
    assert "the same command resumes" in capsys.readouterr().out
    manifest_file = tmp_path / "pendulum_climb" / "manifest.json"
    assert json.loads(manifest_file.read_text())["finished"] is None
    assert launch(tmp_path, *words) == 0
    assert load(tmp_path / "pendulum_climb")["period"].tolist() == [0, 1]


@pytest.mark.slow
def test_a_page_over_all_runs_links_the_report(tmp_path):
    assert launch(tmp_path, "--seeds=1", "--periods=1") == 0
    page = (tmp_path / "index.html").read_text()
    assert 'href="pendulum_climb/report.html"' in page and "At work" not in page


def test_pictures_that_fail_do_not_harm_training(tmp_path, capsys, monkeypatch):
    def broken(_):
        raise ValueError("no ink")

    no_backend = functools.partial(video.render, backends=("nonsense",))
    monkeypatch.setattr("launch.jobs.recorder.write_figure", broken)
    monkeypatch.setattr("launch.pictures.summary.write_report", broken)
    monkeypatch.setattr("launch.pictures.summary.video.render", no_backend)
    monkeypatch.setattr("launch.pictures.summary.scene.load", lambda: None)
    monkeypatch.setattr("launch.pictures.summary.replay.render", lambda *_: broken(_))
    assert launch(tmp_path, "--seeds=1", "--periods=1", "--video") == 0
    printed = capsys.readouterr().out
    assert "no replay of pendulum_climb, 1 subgoal layer: no ink" in printed
    assert "figure.png was not updated: no ink" in printed
    assert "report.html was not written: no ink" in printed
    assert "no video of pendulum_climb, 1 subgoal layer" in printed and "libegl1" in printed
    assert list((tmp_path / "pendulum_climb" / "videos").iterdir()) == []
    assert len(trained(tmp_path)) == 1


@pytest.mark.usefixtures("undrawn")
def test_without_the_viewer_a_line_says_that_there_are_no_replays(tmp_path, capsys, monkeypatch):
    def missing() -> None:
        raise scene.ViewerMissing(scene.LACKING)

    monkeypatch.setattr(scene, "load", missing)
    monkeypatch.setattr("launch.pictures.summary.video.render", lambda *_, **__: [])
    assert launch(tmp_path, "--seeds=1", "--periods=1", "--video") == 0
    printed = capsys.readouterr().out
    assert printed.count("no 3-D replays") == 1 and "pip install 'hac-suite[viewer]'" in printed
    assert "no replay of" not in printed
    assert not (tmp_path / "pendulum_climb" / "replays").exists()


@pytest.mark.usefixtures("undrawn")
def test_a_damaged_policy_costs_a_warning_and_a_damaged_number_is_refused(tmp_path, capsys):
    words = ("--seeds=1", "--periods=1", "--subgoal_layers=0")
    assert launch(tmp_path, *words) == 0
    folder = RunFolder(tmp_path, "pendulum_climb")
    folder.policy(0, 0).with_suffix(".json").write_text("{")
    assert launch(tmp_path, *words, "--video") == 0
    printed = capsys.readouterr().out
    assert "warning: no video of pendulum_climb, 0 subgoal layers: " in printed
    assert printed.count("test period") == 2  # the heading of each launch's summary
    folder.results.write_text(folder.results.read_text().replace(",0.25,", ",often,"))
    with pytest.raises(CommandError, match=r"results.csv, line 3: success_rate is 'often'"):
        launch(tmp_path, *words)


def test_attempts_that_span_too_few_steps_are_warned_of():
    asked = request.parse(["", "--task=pendulum_climb"])
    short = asked._replace(attempts={1: (20, 8), 2: (20, 5, 3)})
    (warning,) = doubts.short(short)
    assert "1 subgoal layer: T = [20, 8] allows only 160 of the 300 steps" in warning
