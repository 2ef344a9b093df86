"""Agents side by side: all agents, or one at several stages of its training, from one start."""

import json
import shutil
from pathlib import Path

import pytest
from PIL import Image

import hac_suite
from analysis.reading import names
from launch import side_by_side
from launch.folder import manifest, policies
from launch.folder.layout import RunFolder
from launch.pictures import video
from tests.launch import line
from tests.launch.lives import TASK as TINY
from tests.launch.lives import live, tiny

__all__ = ["tiny"]

TASK = "ur5_reacher"


@pytest.fixture
def asked(monkeypatch) -> list[dict]:
    """What the renderer is asked for, which then renders nothing."""
    requests = []

    def render(paths, columns, output, **rest):
        requests.append({"paths": list(paths), "columns": list(columns), **rest})
        return []

    monkeypatch.setattr(video, "render_side_by_side", render)
    return requests


@pytest.fixture
def run(tmp_path) -> RunFolder:
    """A run folder with the published policies of one agent as if of several test periods."""
    folder = RunFolder(tmp_path, TASK)
    folder.stages.mkdir(parents=True)
    for period in (10, 0, 3):
        keep(folder, 2, 0, period)
    return folder


def keep(folder: RunFolder, layers: int, seed: int, period: int, **changes) -> Path:
    """Puts a published policy there as one of a test period; returns its description."""
    (published,) = [f for f in policies.published(TASK) if f.subgoal_layers == layers]
    path = folder.stage(layers, seed, period)
    shutil.copy(published.path.with_suffix(".safetensors"), f"{path}.safetensors")
    about = json.loads(published.path.with_suffix(".json").read_text())
    about |= {"seed": seed, "train_episodes": 300 * period, **changes}
    Path(f"{path}.json").write_text(json.dumps(about))
    return Path(f"{path}.json")


def test_agents_are_shown_from_a_start_that_the_deepest_one_masters(asked):
    assert side_by_side.main(["", f"--task={TASK}"]) == 0
    (request,) = asked
    assert request["columns"] == ["0 subgoal layers", "1 subgoal layer", "2 subgoal layers"]
    assert [path.name.split("_")[2] for path in request["paths"]] == [
        "0layers", "1layers", "2layers",
    ]  # fmt: skip
    assert request["most_bytes"] == 3_000_000
    last = hac_suite.Policy.load(policies.published(TASK)[-1].path)
    seeds = side_by_side.choosing.seeds_of_tests(last)
    won = side_by_side.choosing.succeeds(last, seeds)
    assert request["seed"] == seeds[won.argmax()] and won.any()


def test_stages_of_training_are_shown_in_their_order(asked, run):
    words = [f"--run={run.path}", "--training", "--subgoal_layers=2", "--episode=7"]
    assert side_by_side.main(["", *words]) == 0
    (request,) = asked
    assert request["columns"] == ["untrained", "after 900 episodes", "after 3000 episodes"]
    assert [path.name[-1] for path in request["paths"]] == ["0", "3", "0"]
    assert request["seed"] == 7 and request["said"] == "2 subgoal layers"


def test_an_agent_that_trained_for_less_is_shown_as_far_as_it_got(asked, run):
    """The others, and its other seeds, may be ahead."""
    for seed, period in ((4, 0), (4, 3), (5, 0), (5, 1)):
        keep(run, 1, seed, period)
    words = [f"--run={run.path}", "--training", "--subgoal_layers=1", "--episode=7"]
    assert side_by_side.main(["", *words, "--seed=5"]) == 0
    assert asked[0]["columns"] == ["untrained", "after 300 episodes"]
    assert side_by_side.main(["", *words]) == 0
    assert asked[1]["columns"][0] == "untrained" and len(asked[1]["columns"]) == 2


def test_a_policy_that_does_not_fit_is_answered_in_one_line(asked, run, capsys):
    words = ["", f"--run={run.path}", "--training"]
    about = keep(run, 2, 0, 10)
    whole = json.loads(about.read_text())
    about.write_text(json.dumps({name: whole[name] for name in whole if name != "config"}))
    assert side_by_side.main(words) == 2
    assert "lacks the entry 'config'" in capsys.readouterr().err
    for file in run.stages.glob("*.json"):
        file.write_text(json.dumps(json.loads(file.read_text()) | {"task": "pendulum_climb"}))
    assert side_by_side.main(words) == 2
    printed = capsys.readouterr().err
    assert printed.startswith("error: policy ") and printed.count("\n") == 1 and not asked
    assert side_by_side.main([*words, f"--task={TASK}"]) == 2
    assert "holds policies of pendulum_climb" in capsys.readouterr().err


def test_stages_of_a_task_that_was_changed_since_are_refused(asked, tmp_path, capsys):
    folder = RunFolder(tmp_path, line.TASK)
    folder.stages.mkdir(parents=True)
    keep(folder, 2, 0, 3, task=line.TASK)
    earlier = {"task": line.WORD, "package": "lines 0.1", "settings": {}}
    text = manifest.new(line.TASK, 25, {}) | {"task_file": earlier}
    folder.manifest.write_text(json.dumps(text))
    words = ["", f"--run={folder.path}", "--training"]
    assert side_by_side.main([*words, f"--task={line.WORD}"]) == 2
    printed = capsys.readouterr().err
    assert "was trained on another version of the task" in printed and printed.count("\n") == 1
    folder.manifest.unlink()
    assert side_by_side.main([*words, f"--task={line.WORD}"]) == 2  # and its policies do not fit
    printed = capsys.readouterr().err
    assert printed.startswith("error: policy ") and printed.count("\n") == 1 and not asked


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        (["--output=v.png"], "ends in .webp, .gif or .mp4"),
        (["--training", "--run=nowhere"], "launch/run.py --keep_policies=0,1,3` keeps the"),
        (["--training", "--subgoal_layers=1"], "has no policy of 1 subgoal layer; it has 2"),
        (["--size=9"], "--size=9: give WIDTHxHEIGHT"),
    ],
)
def test_bad_input_is_answered_in_one_line(asked, run, capsys, words, answer):
    assert side_by_side.main(["", f"--run={run.path}", *words]) == 2
    printed = capsys.readouterr().err
    assert answer in printed and printed.count("\n") == 1 and not asked


@pytest.mark.slow
@pytest.mark.requires_gl
def test_a_moving_picture_has_all_of_them_and_is_small_enough(run, tmp_path):
    output = tmp_path / "stages.webp"
    words = [f"--run={run.path}", "--training", f"--output={output}", "--size=480x240"]
    assert side_by_side.main(["", *words, "--speed=1", "--megabytes=0.3"]) == 0
    assert output.stat().st_size <= 300_000
    with Image.open(output) as film:
        assert film.size == (480, 240) and film.n_frames > 8 and film.info["loop"] == 0


def test_a_training_keeps_the_policies_of_the_periods_that_are_named(tmp_path, tiny):
    words = ("--seeds=2", "--subgoal_layers=1", "--periods=3", "--workers=1")
    status, printed = live(tmp_path, *words, "--keep_policies=0,2")
    assert status == 0, printed
    folder = RunFolder(tmp_path, TINY)
    kept = policies.find(folder.path / names.STAGES)
    assert [policy.path for policy in kept] == [
        folder.stage(1, seed, period) for seed in (0, 1) for period in (0, 2)
    ]
    episodes = [policy.train_episodes for policy in kept]
    assert episodes[0] == 0 < episodes[1] and episodes == episodes[:2] * 2
    weights = [Path(f"{policy.path}.safetensors").read_bytes() for policy in kept]
    assert len(set(weights)) == 4
    assert len(policies.find(folder.policies)) == 2


def test_kept_policies_of_periods_that_are_trained_again_go(run):
    row = {"task": TASK, "subgoal_layers": 2, "seed": 0}
    run.prepare({(2, 0): [{**row, "period": period} for period in range(4)]})  # are behind
    assert [policy.path for policy in policies.find(run.stages)] == [
        run.stage(2, 0, 0), run.stage(2, 0, 3),
    ]  # fmt: skip
