"""Rendering in a process of its own: real policies become files, failures leave nothing behind."""

import contextlib
import itertools
import json
import math
import os
import shutil
import subprocess
import sys
import threading
import time
import types
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
import torch

import hac_suite
import tasks
from launch import doctor, play
from launch.asking import settings, start
from launch.drawing import pacing
from launch.films import rendering
from launch.folder import needs, policies
from launch.folder.layout import RunFolder
from launch.jobs import worker
from launch.jobs.local import StopSignal
from launch.pictures import choosing, video
from tests.launch import lives

TASK = "ur5_reacher"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> RunFolder:
    """A run folder with the untrained policy of seed 3, two subgoal layers."""
    folder = RunFolder(tmp_path_factory.mktemp("runs"), TASK)
    folder.policies.mkdir(parents=True)
    config = hac_suite.Config(test_episodes=1)
    result = next(
        hac_suite.train(
            lambda n: tasks.load_vector(TASK, n),
            config,
            [3],
            subgoal_layers=2,
            horizons=hac_suite.horizons(tasks.load_vector(TASK, 1).max_steps, 2),
            periods=1,
        )
    )
    metadata = {
        "task": TASK,
        "subgoal_layers": 2,
        "seed": 3,
        "success_rate": 0.0,
        "config": settings.as_json(config),
    }
    worker.save_policy(result.policies[0], folder.policy(2, 3), metadata)
    return folder


@pytest.fixture
def run(folder) -> list[str]:
    return ["launch/play.py", f"--run={folder.path}"]


@pytest.fixture
def copy(folder, tmp_path) -> RunFolder:
    """A copy of the run folder that a test may damage."""
    return RunFolder(Path(shutil.copytree(folder.path, tmp_path / "copy" / TASK)).parent, TASK)


def test_a_saved_policy_leaves_no_other_file(folder):
    assert {path.name for path in folder.policies.iterdir()} == {
        f"{TASK}_2layers_seed3.json",
        f"{TASK}_2layers_seed3.safetensors",
    }


@pytest.mark.slow
@pytest.mark.requires_gl
def test_play_writes_an_mp4_that_players_open(run, tmp_path, capsys):
    output = tmp_path / "new folder" / "v.mp4"
    assert play.main([*run, "--size=640x360", f"--output={output}"]) == 0
    assert capsys.readouterr().out.strip().endswith(str(output))
    assert [path.name for path in output.parent.iterdir()] == ["v.mp4"]
    described = iio.immeta(output, plugin="pyav")
    assert (described["codec"], described["fps"]) == ("h264", pacing.FRAMES_PER_SECOND)
    assert described["duration"] >= 5.5
    frames = iio.imread(output, plugin="pyav")
    assert frames.shape[1:] == (360, 640, 3)
    title, picture = frames[0, :31], frames[0, 31:270]
    assert title.max() > 200 and picture.std() > 10
    assert np.abs(frames[0].astype(int) - frames[len(frames) // 2]).max() > 50
    moved = np.abs(np.diff(frames[:-11].astype(np.int16), axis=0)).max((1, 2, 3)) > 40
    assert moved.mean() > 0.9  # no frame is shown twice


@pytest.mark.slow
@pytest.mark.requires_gl
def test_a_film_that_is_rendered_tells_how_far_it_is(folder, tmp_path):
    told = []
    video.render(
        [folder.policy(2, 3)],
        tmp_path / "v.mp4",
        look=video.Look(speed=4.0, size=(320, 180)),
        tell=lambda done, count: told.append((done, count)),
    )
    assert told and told == sorted(told)
    count = len(iio.imread(tmp_path / "v.mp4", plugin="pyav"))
    assert told[-1] == (count, count)


@pytest.mark.slow
@pytest.mark.requires_gl
def test_an_unknown_camera_is_answered_in_one_line(run, tmp_path, capsys):
    words = ["--camera=frunt", "--size=320x180", f"--output={tmp_path / 'v.mp4'}"]
    assert play.main([*run, *words]) == 1
    answer = capsys.readouterr().err
    assert answer == "error: flag --camera: unknown camera 'frunt': did you mean 'front'?\n"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.requires_gl
def test_play_writes_a_strip_of_frames_from_a_renamed_run_folder(copy, tmp_path):
    output, renamed = tmp_path / "strip.png", tmp_path / "of last week"
    copy.path.rename(renamed)
    words = [f"--run={renamed}", "--seed=3", "--camera=side", f"--output={output}"]
    assert play.main(["launch/play.py", *words]) == 0
    strip = iio.imread(output)
    assert strip.shape[1:] == (1280, 3)
    pictures = [strip[120:300, at : at + 400] for at in (0, 428, 856)]
    for one, other in itertools.combinations(pictures, 2):
        assert np.abs(one.astype(int) - other).max() > 50


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        (["--task=pick_place"], "--task=pick_place: "),
        (["--task=pick_place"], f"holds policies of {TASK}"),
        (["--task=ur5_reachr"], "unknown task 'ur5_reachr': did you mean 'ur5_reacher'?"),
        (["--seed=4"], "no policy of 2 subgoal layers, seed 4; it has 2 subgoal layers: seeds 3"),
        (["--subgoal_layers=1"], "no policy of 1 subgoal layer"),
        (["--run=elsewhere"], "elsewhere does not exist; train some with"),
        (["--output=v.gif"], "ends in .mp4, .png or .html"),
        (["--size=1281x720"], "--size=1281x720: give WIDTHxHEIGHT, even numbers"),
        (["--size=big"], "--size=big: give WIDTHxHEIGHT"),
        (["--speed=0"], "--speed=0"),
        (["--sed=3"], "unknown flag 'sed': did you mean 'seed'?"),
        (["--episodes=0"], "--episodes=0"),
    ],
)
def test_play_answers_bad_input_in_one_line(run, capsys, words, answer):
    assert play.main([*run, *words]) == 2
    printed = capsys.readouterr()
    assert answer in printed.err and printed.err.count("\n") == 1 and not printed.out


@pytest.mark.parametrize(
    ("content", "answer"),
    [
        ("{", "Expecting property name"),
        ("[1]", "its format is not 'hac_suite.policy/2'"),
        ({"task": None}, "its task is None"),
        ({"task": "mine.py:reach"}, "its task is 'mine.py:reach', which is not a name"),
        ({"task": "gym:mine:Reach-v0"}, "its task is 'gym:mine:Reach-v0', which is not a name"),
        ({"task": TASK, "subgoal_layers": "two"}, "its subgoal_layers is 'two'"),
        (
            {"task": TASK, "subgoal_layers": 2, "seed": 3, "success_rate": math.nan},
            "its success_rate is nan",
        ),
    ],
)
def test_a_damaged_description_is_answered_in_one_line(copy, tmp_path, capsys, content, answer):
    file = copy.policy(2, 3).with_suffix(".json")
    if not isinstance(content, str):
        content = json.dumps({"format": "hac_suite.policy/2", **content})
    file.write_text(content)
    assert play.main(["launch/play.py", f"--run={copy.path}", f"--output={tmp_path}/v.mp4"]) == 2
    printed = capsys.readouterr().err
    assert f"{file} does not describe a policy" in printed and answer in printed
    assert printed.count("\n") == 1


def test_a_seed_that_succeeds_is_shown_if_the_median_one_never_does(monkeypatch):
    def found(seed: int, success_rate: float) -> policies.Found:
        return policies.Found(Path(str(seed)), TASK, 2, seed, success_rate)

    rates = [0.5, 0.25, 0.0, 0.75, 0.0]
    order = policies.typical([found(seed, rate) for seed, rate in enumerate(rates)])
    assert [policy.seed for policy in order] == [1, 3, 0]  # the median, then the best first

    succeeds = {"1": [False, False, False], "3": [False, True, False], "0": [True, True, True]}
    monkeypatch.setattr(choosing.hac_suite.Policy, "load", lambda path: path)
    monkeypatch.setattr(choosing, "_AT_ONCE", 2)
    monkeypatch.setattr(choosing, "seeds_of_tests", lambda policy, least: np.array([7, 8, 9]))
    monkeypatch.setattr(
        choosing,
        "succeeds",
        lambda policy, seeds: np.array([succeeds[policy][seed - 7] for seed in seeds]),
    )
    paths = [str(policy.path) for policy in order]
    assert choosing.choose(paths, 2) == ("3", [8, 7])
    assert choosing.choose(paths[:1], 2) == ("1", [7, 8])


def test_episodes_are_chosen_among_those_that_were_tested(monkeypatch):
    tested = []
    reset = tasks.VectorEnv.reset

    def recorded(env, seeds=None, *, mask=None, test=False):
        if test:
            tested.append(np.array(seeds))
        return reset(env, seeds, mask=mask, test=test)

    monkeypatch.setattr(tasks.VectorEnv, "reset", recorded)
    config = hac_suite.Config(test_episodes=5)
    result = next(
        hac_suite.train(
            lambda n: tasks.load_vector(TASK, n),
            config,
            [3, 4],
            subgoal_layers=0,
            horizons=(tasks.load_vector(TASK, 1).max_steps,),
            periods=1,
        )
    )
    (both,) = tested
    metadata = {"task": TASK, "seed": 4, "config": settings.as_json(config)}
    policy = hac_suite.Policy(result.policies[1].networks, result.policies[1].horizons, metadata)
    monkeypatch.setattr(choosing.hac_suite.Policy, "load", lambda path: policy)
    _, shown = choosing.choose(["any"], 2)
    played = np.concatenate(tested[1:])
    assert played.tolist() == both[5:].tolist()
    assert set(shown) <= set(both[5:].tolist())


@pytest.mark.slow
def test_no_backend_means_a_remedy_and_no_file(folder, tmp_path):
    with pytest.raises(video.RenderingError, match="apt-get install libegl1"):
        video.render([folder.policy(2, 3)], tmp_path / "v.mp4", backends=("nonsense",))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.requires_gl
def test_falling_back_is_announced(folder, tmp_path):
    output = tmp_path / "strip.png"
    (note,) = video.render([folder.policy(2, 3)], output, backends=("nonsense", "egl"))
    assert "rendered with egl, since nonsense:" in note
    assert output.exists()


@pytest.mark.slow
@pytest.mark.requires_gl
def test_a_pickle_is_not_rendered(folder, tmp_path):
    stem = tmp_path / "fake"
    (tmp_path / "fake.json").write_text(folder.policy(2, 3).with_suffix(".json").read_text())
    (tmp_path / "fake.safetensors").write_bytes(b"\x80\x04cos\nsystem\n.")
    with pytest.raises(video.RenderingError, match="not a safetensors policy") as caught:
        video.render([stem], tmp_path / "v.mp4")
    # The policy is at fault: no other backend is tried and none is recommended.
    assert str(caught.value).startswith("policy: ") and "osmesa" not in str(caught.value).lower()


def test_an_encoder_that_dies_leaves_no_half_video(folder, tmp_path, monkeypatch):
    def dies(frames, path: Path) -> None:
        path.write_bytes(b"half a video")
        raise OSError("the encoder died")

    monkeypatch.setattr(rendering, "write_mp4", dies)
    request = {
        "films": [str(folder.policy(2, 3))],
        "output": str(tmp_path / "v.mp4"),
        "columns": [],
        "episodes": 1,
        **video.PLAIN._asdict(),
    }
    with pytest.raises(OSError, match="encoder died"):
        rendering.main(json.dumps(request))
    assert list(tmp_path.iterdir()) == []


def test_a_renderer_that_hangs_is_given_up():
    assert video.run_renderer("egl", "{}", timeout=0.0) == "gave no result within 0 s"


def test_a_stop_ends_the_renderer():
    stop = StopSignal()
    threading.Timer(0.5, lambda: setattr(stop, "number", 2)).start()
    start = time.monotonic()
    with pytest.raises(video.RenderingError, match="stopped"):
        video.run_renderer("egl", "{}", stop=stop)
    assert time.monotonic() - start < 10


@pytest.mark.slow
def test_a_renderer_dies_with_its_launch_whatever_it_is_at(tmp_path):
    """A task file that hangs takes the place of a rendering that takes long."""
    file, began = tmp_path / "hangs.py", tmp_path / "began"
    file.write_text(f"import pathlib, time\npathlib.Path({str(began)!r}).touch()\ntime.sleep(600)")
    request = json.dumps({"task": f"{file}:any", "films": [], "output": "v.mp4"})
    code = f"from launch.pictures import video; video.run_renderer('disabled', {request!r})"
    launched = subprocess.Popen([sys.executable, "-c", code], start_new_session=True)
    lives.wait_for(began.exists, 200)
    os.killpg(launched.pid, 0)
    launched.kill()
    launched.wait()
    lives.wait_until_gone(launched.pid)


def test_after_a_stop_no_other_backend_is_tried(tmp_path, monkeypatch):
    stop = StopSignal()

    @contextlib.contextmanager
    def started(command, environment, **streams):
        assert environment["MUJOCO_GL"] == "egl"
        stop.number = 2  # while the first backend fails
        with start.child([sys.executable, "-c", "1 / 0"], environment, **streams) as process:
            yield process

    monkeypatch.setattr(video, "start", types.SimpleNamespace(child=started))
    with pytest.raises(video.RenderingError, match=r"^stopped$"):
        video.render([tmp_path / "any"], tmp_path / "v.mp4", stop=stop)


def test_the_doctor_finds_what_training_needs():
    assert doctor.check_packages().good and doctor.check_cores().good
    assert doctor.check_mp4().good


@pytest.mark.parametrize(("has", "said"), [(True, "possible"), (False, "not for it")])
def test_the_doctor_says_whether_the_processor_has_bfloat16(monkeypatch, has, said):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx512_bf16": has})
    assert doctor.check_cores().text.endswith(f"; --precision=bf16 is {said}")


@pytest.mark.slow
@pytest.mark.requires_gl
def test_the_doctor_finds_what_rendering_needs():
    found = doctor.check_rendering()
    assert found[0].text == "rendering with egl: works"


@pytest.mark.slow
def test_the_doctor_names_remedies(monkeypatch, capsys):
    monkeypatch.setattr(doctor.video, "BACKENDS", ("nonsense",))
    monkeypatch.setattr(needs, "free_disk", lambda path: 1000)
    monkeypatch.setattr(needs, "memory", lambda: (1000, 1000))
    assert doctor.main(["launch/doctor.py"]) == 1
    printed = capsys.readouterr().out
    assert "FAIL rendering with nonsense" in printed and "remedy: for rendering" in printed
    assert "FAIL disk" in printed and "remedy: free some disk space" in printed
    assert "FAIL memory" in printed and "remedy: give fewer --workers" in printed


@pytest.mark.slow
def test_scripts_run_from_anywhere(tmp_path):
    script = Path(play.__file__)
    done = subprocess.run(
        [sys.executable, script, "--help"], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0 and "--output=video.mp4" in done.stdout
