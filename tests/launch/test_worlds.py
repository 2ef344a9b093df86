"""Others' environments from the command line: trained, resumed, refused, played, fitted."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import hac_suite
import tasks
from analysis.program import CommandError
from analysis.reading import schema
from launch import fit
from launch.asking import lists, request
from launch.films import rendering
from launch.pictures import video
from tasks.worlds import settings as settings_lib
from tasks.worlds.making import NoFrames

ROOT = Path(__file__).resolve().parents[2]
POINT = "gym:tests.tasks.worlds.toys:HacToy/Point-v0"
_SMALL = (
    "--subgoal_layers=1", "--config.episodes_per_period=4", "--config.test_episodes=2",
    "--config.updates_per_episode=1",
)  # fmt: skip


def program(name: str, folder: Path, *words: str) -> subprocess.CompletedProcess:
    command = [sys.executable, str(ROOT / "launch" / f"{name}.py"), *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=240)


ARGS = '--task_args={"terminates": true}'


@pytest.fixture(scope="module")
def trained(tmp_path_factory) -> Path:
    """A folder in which a world was trained by two workers."""
    folder = tmp_path_factory.mktemp("elsewhere")
    words = (f"--task={POINT}", ARGS, *_SMALL, "--seeds=2", "--periods=1", "--workers=2")
    done = program("run", folder, *words, "--novideo")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "its spaces are estimated from random episodes" in done.stdout
    return folder


def run_folder(trained: Path) -> Path:
    (folder,) = (trained / "runs").glob("Point-v0-*")
    return folder


@pytest.mark.slow
def test_a_world_is_trained_by_workers_and_its_manifest_says_what_it_was(trained):
    folder = run_folder(trained)
    results = pd.read_csv(folder / "results.csv")
    assert sorted(zip(results.seed, results.period, strict=True)) == [
        (0, 0),
        (0, 1),
        (1, 0),
        (1, 1),
    ]
    origin = json.loads((folder / "manifest.json").read_text())["task_file"]
    assert origin["task"] == POINT + '?{"args":{"terminates":true}}'
    assert origin["settings"]["max_steps"] == 30 and len(origin["package"]) > 3


@pytest.mark.slow
def test_the_same_command_finds_it_finished_and_other_spaces_are_refused(trained):
    words = (f"--task={POINT}", ARGS, *_SMALL, "--seeds=2", "--periods=1", "--novideo")
    again = program("run", trained, *words)
    assert (again.returncode, "2 of 2 seeds are finished already" in again.stdout) == (0, True)
    file = run_folder(trained) / "manifest.json"
    text = file.read_text()
    manifest = json.loads(text)
    manifest["task_file"]["settings"]["goal"]["low"][0] -= 1
    file.write_text(json.dumps(manifest))
    other = program("run", trained, *words)
    played = program("play", trained, f"--task={POINT}", ARGS, "--output=strip.png")
    held = program("final_success", trained, f"--task={POINT}", ARGS)
    file.write_text(text)
    assert held.returncode == 2 and "trained on another version of the task" in held.stderr
    assert played.returncode == 2 and "trained on another version of the task" in played.stderr
    assert other.returncode == 2 and "goal (estimated) is" in other.stderr
    assert "subgoal (estimated)" not in other.stderr


def test_a_training_is_gone_on_with_as_if_it_had_not_stopped():
    """From the states at a boundary, in copies of its own, as after a kill."""
    config = hac_suite.Config(episodes_per_period=8, test_episodes=2, hidden_sizes=(16,))
    kept = []

    class Keeping(hac_suite.Callback):
        def on_boundary(self, boundary):
            if boundary.train_episodes == 4:
                kept.extend((s.tensors, s.numbers) for s in boundary.states())
                kept[:] = [hac_suite.SeedState(*map(_copied, state)) for state in kept]

    def rows(**more):
        word = tasks.find(POINT + '?{"args":{"fails_above":0.6}}').word
        results = hac_suite.train(
            tasks.find(word).load_vector, config, [0, 3], subgoal_layers=1, horizons=(6, 5),
            periods=1, **more,
        )  # fmt: skip
        drop = schema.CLOCKS
        last = list(results)[-1]
        weights = [layer.clone() for p in last.policies for n in p.networks for layer in n.weights]
        return [{k: v for k, v in r.items() if k not in drop} for r in last.rows], weights

    whole, weights = rows(callback=Keeping())
    again, weights_again = rows(start=kept)
    pd.testing.assert_frame_equal(pd.DataFrame(whole), pd.DataFrame(again))
    assert all(bool((a == b).all()) for a, b in zip(weights, weights_again, strict=True))


def _copied(part):
    return {k: v.clone() if hasattr(v, "clone") else json.loads(json.dumps(v))
            for k, v in part.items()}  # fmt: skip


@pytest.mark.requires_gl
@pytest.mark.slow
def test_a_trained_agent_is_played(trained):
    done = program("play", trained, f"--task={POINT}", ARGS, "--subgoal_layers=1", "--output=a.png")
    assert done.returncode == 0, done.stdout + done.stderr
    assert (trained / "a.png").stat().st_size > 1000


def test_no_backend_is_blamed_for_a_world_without_pictures(monkeypatch, capsys):
    def none(*_):
        raise NoFrames("it renders no frames")

    monkeypatch.setattr(rendering, "_played", none)
    with pytest.raises(SystemExit) as ended:
        rendering.main('{"films": []}')
    assert ended.value.code == video.BAD_REQUEST
    assert capsys.readouterr().err == "it renders no frames\n"


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--task=pick_place", "--max_steps=9"], "flag --max_steps: it is for --task=gym:ID"),
        ([f"--task={POINT}", "--task_args=[1]"], "give a JSON object"),
        ([f"--task={POINT}", "--task_args={oops"], "give a JSON object"),
        ([f"--task={POINT}", "--goal_threshold=0,1"], "give numbers above 0"),
        ([f"--task={POINT}", '--task_args={"tarminates": 1}'], "tarminates"),
        ([f"--task={POINT}", "--goal=obs[0]"], "goals of its own"),
        (["--task=gym:HacToy/Absent-v0"], "gymnasium.make"),
        (["--task=none.toml"], "no such file"),
    ],
)
def test_wrong_words_are_answered_before_anything_starts(words, problem):
    with pytest.raises(CommandError, match=problem) as answer:
        request.parse(["run", *words])
    assert "\n" not in str(answer.value)


def test_flags_become_one_word():
    values = request.define_flags()
    values([
        "", "--task=gym:X-v0", '--task_args={"b": 1, "a": [2]}', "--goal=obs[0:2]",
        "--goal_threshold=0.1,0.5", "--max_steps=7", '--test_options={"cell": 3}',
    ])  # fmt: skip
    assert lists.task_word(values) == (
        'gym:X-v0?{"args":{"b":1,"a":[2]},"goal":"obs[0:2]","goal_threshold":[0.1,0.5],'
        '"max_steps":7,"test_options":{"cell":3}}'
    ).replace('"b":1,"a":[2]', '"a":[2],"b":1')


# -- fit


@pytest.mark.slow
def test_fit_writes_a_file_that_run_trains_with(tmp_path):
    output = tmp_path / "point_fit.toml"
    done = program("fit", tmp_path, f"--task={POINT}", "--train_episodes=4", f"--output={output}")
    assert done.returncode == 0, done.stderr
    assert "goal[0]" in done.stdout and "random" in done.stdout and "flat agent" in done.stdout
    assert f"python launch/run.py --task={output}" in done.stdout
    word, found = settings_lib.from_toml(output.read_text(), "a")
    assert word == POINT and found.max_steps == 30
    np.testing.assert_allclose(found.goal_threshold, 0.1, rtol=1e-3)
    words = (f"--task={output.name}", *_SMALL, "--seeds=1", "--periods=1", "--novideo")
    trained = program("run", tmp_path, *words)
    assert trained.returncode == 0, trained.stdout + trained.stderr
    manifest = json.loads((tmp_path / "runs" / "point_fit" / "manifest.json").read_text())
    assert manifest["horizons"]["1"] == list(found.horizons[1])
    output.write_text(output.read_text().replace("max_steps = 30", "max_steps = 29"))
    edited = program("run", tmp_path, *words)
    assert edited.returncode == 2 and "max_steps is 30 there and 29 here" in edited.stderr


def test_fit_trains_where_the_environment_cuts_episodes_shorter_than_it_says(tmp_path, capsys):
    output = tmp_path / "cut.toml"
    cut = '--task_args={"truncates_at": 20}'
    words = (f"--task={POINT}", cut, "--train_episodes=4", f"--output={output}")
    assert fit.main(["fit", *words]) == 0
    assert "cut short by the environment" not in capsys.readouterr().out
    assert settings_lib.from_toml(output.read_text(), "a")[1].max_steps == 20


def test_fit_holds_its_estimates_against_those_made_by_hand(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "140")
    assert fit.main(["fit", "--task=pendulum_climb", "--train_episodes=0"]) == 0
    shown = capsys.readouterr().out
    assert "chosen by hand" in shown and "(by hand: [18, 18])" in shown
    assert (tmp_path / "pendulum_climb_fit.toml").is_file() and "flat agent" not in shown
    again = ["fit", "--task=pendulum_climb", "--train_episodes=0"]
    assert fit.main(again) == 2  # somebody may have edited it
    assert "exists already; add --overwrite" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        ([], "flag --task is missing"),
        ([f"--task={POINT}", "--output=a.txt"], "ends in .toml"),
        ([f"--task={POINT}", "--output=pick_place.toml"], "is not that of a task"),
        (["--task=gym:HacToy/PointForEver-v0"], "no time limit"),
    ],
)
def test_fit_answers_wrong_words_in_one_line(words, problem, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert fit.main(["fit", *words]) == 2
    assert problem in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
