"""Publishing a run folder: what is copied, which policy is the best, and what is refused."""

import json
import shutil

import pytest

from analysis.reading import grid
from launch import play, publish
from launch.folder import policies
from launch.folder.layout import RunFolder
from tests.launch.lives import TASK, live, tiny

__all__ = ["tiny"]

WORDS = ("--seeds=3", "--subgoal_layers=0,1", "--periods=1", "--workers=1")


@pytest.fixture
def folder(tmp_path, tiny, monkeypatch) -> RunFolder:
    """A finished run folder of a tiny task; the subgoals are not recorded."""
    monkeypatch.setattr(publish.record_subgoals, "record", lambda *_: [])
    status, printed = live(tmp_path / "runs", *WORDS)
    assert status == 0, printed
    folder = RunFolder(tmp_path / "runs", TASK)
    for seed, success in enumerate((0.25, 0.75, 0.75)):
        file = folder.policy(1, seed).with_suffix(".json")
        file.write_text(json.dumps({**json.loads(file.read_text()), "success_rate": success}))
    return folder


def command(folder: RunFolder, *words: str) -> int:
    top = folder.path.parent.parent
    places = [f"--runs={top / 'runs'}", f"--data={top / 'data'}", f"--policies={top / 'policies'}"]
    return publish.main(["launch/publish.py", f"--task={TASK}", *places, *words])


def test_results_and_the_best_policy_of_each_agent_are_published(folder, tmp_path, capsys):
    stale = tmp_path / "policies"
    stale.mkdir()
    for suffix in (".json", ".safetensors"):  # the seed that was the best last time
        shutil.copy(folder.policy(1, 0).with_suffix(suffix), stale)
    assert command(folder) == 0
    published = {path.name for path in (tmp_path / "data" / TASK).iterdir()}
    assert published == {"results.csv", "figure.csv", "figure.png", "manifest.json"}
    found = policies.find(tmp_path / "policies")
    assert [(one.subgoal_layers, one.seed) for one in found] == [(0, found[0].seed), (1, 1)]
    assert len(grid.load_grid(tmp_path / "data")[TASK]) == 2 * 3 * 2
    assert f"{TASK}_1layers_seed1.safetensors" in capsys.readouterr().out


def test_a_folder_with_runs_to_finish_is_refused(folder, capsys):
    folder.policy(1, 2).with_suffix(".safetensors").unlink()
    assert command(folder) == 2
    printed = capsys.readouterr().err
    assert "1 of its 6 runs are not finished" in printed and printed.count("\n") == 1
    assert not (folder.path.parent.parent / "data").exists()


def test_bad_words_are_answered_in_one_line(capsys, tmp_path):
    for words, answer in (
        (["--task=pick_plce"], "did you mean 'pick_place'?"),
        ([f"--runs={tmp_path}"], "there is no folder"),
    ):
        assert publish.main(["", *words]) == 2
        printed = capsys.readouterr().err
        assert answer in printed and printed.count("\n") == 1


def test_play_falls_back_on_published_policies(folder, tmp_path, monkeypatch, capsys):
    assert command(folder) == 0
    monkeypatch.setattr(policies, "PUBLISHED", tmp_path / "policies")
    monkeypatch.chdir(tmp_path)
    flags = play._flags()
    flags(["", f"--task={TASK}", "--subgoal_layers=1"])
    own = play._choose(flags, TASK)
    assert own[0].path.parent == folder.policies.relative_to(tmp_path)
    folder.path.rename(tmp_path / "gone")
    (found,) = play._choose(flags, TASK)
    assert found.path == tmp_path / "policies" / f"{TASK}_1layers_seed1"
    assert "playing the published one" in capsys.readouterr().out
