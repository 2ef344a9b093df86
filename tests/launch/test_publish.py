"""Publishing a run folder: what is copied, which policy is the best, and what is refused."""

import functools
import json
import os
import shutil
import signal
import types
from pathlib import Path

import pandas as pd
import pytest

from analysis.reading import files, grid, schema
from analysis.reading.results import load
from hac_suite import policy_files
from launch import play, publish
from launch.folder import manifest, policies
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


def recorded(found, output, _) -> list[Path]:
    """In place of the records of subgoals: a row for each policy, an episode for each agent."""
    rows = [f"{own.task},{own.subgoal_layers},{own.seed}" for own in found]
    head = "task,subgoal_layers,seed"
    files.write_text(output / "subgoals.csv", "\n".join([head, *rows, ""]))
    agents = {own.subgoal_layers: own.seed for own in reversed(found)}
    episodes = [{"subgoal_layers": layers, "seed": seed} for layers, seed in agents.items()]
    files.write_text(output / "anatomy.json", json.dumps({"episodes": episodes}))
    return [output / "subgoals.csv", output / "anatomy.json"]


def test_an_experiment_trained_in_pieces_is_published_as_if_in_one(tmp_path, tiny, monkeypatch):
    monkeypatch.setattr(publish.record_subgoals, "record", recorded)
    pieces = {"first": "--seeds=0,2", "second": "--seeds=1,2", "whole": "--seeds=3"}
    for name, seeds in pieces.items():
        status, printed = live(tmp_path / name, *WORDS, seeds)
        assert status == 0, printed
        for file in (tmp_path / name / TASK / "policies").glob("*_1layers_seed1.json"):
            file.write_text(json.dumps({**json.loads(file.read_text()), "success_rate": 0.9}))

    def published(name: str, *words: str) -> int:
        into = tmp_path / ("whole" if name == "whole" else "joined")
        places = [f"--data={into / 'data'}", f"--policies={into / 'chosen'}"]
        words = (f"--task={TASK}", f"--runs={tmp_path / name}", *places, *words)
        return publish.main(["launch/publish.py", *words])

    assert published("first", "--add") == 0  # to nothing
    assert published("second", "--add") == 0 and published("whole") == 0
    joined, whole = (tmp_path / name / "data" / TASK for name in ("joined", "whole"))
    drop = list(schema.CLOCKS)
    pd.testing.assert_frame_equal(load(joined).drop(columns=drop), load(whole).drop(columns=drop))
    assert (joined / "subgoals.csv").read_text() == (whole / "subgoals.csv").read_text()
    episodes = json.loads((joined / "anatomy.json").read_text())["episodes"]
    assert sorted(own["subgoal_layers"] for own in episodes) == [0, 1]
    chosen = [policies.find(tmp_path / name / "chosen") for name in ("joined", "whole")]
    assert [own[1].seed for own in chosen] == [1, 1] and len(chosen[0]) == 2
    found = manifest.read(joined / "manifest.json")
    assert len(found["jobs"]) == 4 and len(found["earlier_launches"]) == 1
    assert found["asked"]["seeds"] == [1, 2]
    # A piece trained again: worse, and what it was before is gone.
    (again,) = (tmp_path / "second" / TASK / "policies").glob("*_1layers_seed1.json")
    described = json.loads(again.read_text())
    again.write_text(json.dumps({**described, "success_rate": -0.1}))
    assert published("second", "--add") == 0
    (best,) = [own for own in policies.find(tmp_path / "joined" / "chosen") if own.subgoal_layers]
    assert best.seed != 1
    again.write_text(json.dumps(described))
    assert published("second", "--add") == 0
    # And once more, which changes nothing but for the manifest.
    before = contents(joined)
    assert published("second", "--add") == 0
    after = contents(joined)
    assert [name for name in after if after[name] != before[name]] == ["manifest.json"]


@pytest.mark.slow
def test_a_piece_of_another_configuration_is_refused(folder, tmp_path, capsys):
    assert command(folder) == 0
    before = contents(tmp_path / "data")
    text = folder.manifest.read_text()
    folder.manifest.write_text(text.replace('"batch_size": 16', '"batch_size": 32'))
    assert command(folder, "--add") == 2
    assert "batch_size is 16 there and 32 here" in capsys.readouterr().err
    assert contents(tmp_path / "data") == before


def test_what_is_published_names_no_folder_of_the_machine(folder, tmp_path):
    described = json.loads(folder.manifest.read_text())
    assert str(tmp_path) in folder.manifest.read_text()
    others = [{"command": described["command"]}, {}, {"command": None}]  # the last two: edited
    folder.manifest.write_text(json.dumps({**described, "earlier_launches": others}))
    assert command(folder) == 0
    published = (tmp_path / "data" / TASK / "manifest.json").read_text()
    assert str(tmp_path) not in published and "--seeds=" in published


def test_a_folder_with_runs_to_finish_is_refused(folder, capsys):
    folder.policy(1, 2).with_suffix(".safetensors").unlink()
    assert command(folder) == 2
    printed = capsys.readouterr().err
    assert "1 of its 6 runs are not finished" in printed and printed.count("\n") == 1
    assert not (folder.path.parent.parent / "data").exists()


def killed_at(step: int):
    """What makes a process die by SIGKILL at its file operation of that number."""

    def counted(function):
        def dying(*arguments, **others):
            steps[0] += 1
            if steps[0] == step:
                os.kill(os.getpid(), signal.SIGKILL)
            return function(*arguments, **others)

        return dying

    steps = [0]
    for module, name in (
        (os, "link"), (os, "replace"), (os, "unlink"), (shutil, "copy"), (files, "_exchange"),
    ):  # fmt: skip
        setattr(module, name, counted(getattr(module, name)))


def contents(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*.*")}


@pytest.mark.slow
def test_a_kill_while_publishing_leaves_what_was_published_or_all_of_the_new(
    folder, tmp_path, monkeypatch
):
    """Killed at each of its file operations; another agent's policy stays the same file."""
    assert command(folder) == 0
    monkeypatch.setattr(publish, "write_figure", lambda path: None)  # it is drawn
    others = tmp_path / "policies" / "pick_place_0layers_seed0"
    described = {"task": "pick_place", "subgoal_layers": 0, "seed": 0, "success_rate": 0.5}
    policy_files.write(others, {}, described)
    places = [tmp_path / "data" / TASK, tmp_path / "policies"]
    before = [contents(place) for place in places]
    untouched = [file.stat().st_ino for file in policy_files.paths(others)]
    shutil.rmtree(folder.path / "replays", ignore_errors=True)
    for file in folder.policies.glob("*seed1.json"):  # another seed is the best one now
        file.write_text(file.read_text().replace('"success_rate": 0.75', '"success_rate": 0.0'))
    folder.results.write_text(folder.results.read_text().replace(",0.0,", ",0.125,"))
    whole = tmp_path / "whole"
    for place in places:
        shutil.copytree(place, whole / place.relative_to(tmp_path))
    publish.publish(folder, whole / "data", whole / "policies")
    after = [contents(whole / place.relative_to(tmp_path)) for place in places]
    assert all(old != new for old, new in zip(before, after, strict=True))
    step, status, seen = 0, -signal.SIGKILL, set()
    while status == -signal.SIGKILL:
        step += 1
        status = in_a_fork(functools.partial(killed_at, step), lambda: command(folder))
        now = [contents(place) for place in places]
        for held, old, new in zip(now, before, after, strict=True):
            assert held in (old, new), step
            seen.add(held == new)
        assert [file.stat().st_ino for file in policy_files.paths(others)] == untouched
    assert status == 0 and step > 20 and seen == {True, False}
    assert {path.name for path in tmp_path.iterdir()} == {"runs", "data", "policies", "whole"}
    assert [path.name for path in (tmp_path / "data").iterdir()] == [TASK]
    assert not [file for place in places for file in place.rglob(".*")]


def in_a_fork(first, work) -> int:
    """The exit status of a forked process that does both; minus the signal that ended it."""
    process = os.fork()
    if not process:
        status = 99
        try:
            first()
            status = work()
        finally:
            os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def test_without_a_rename_that_exchanges_files_are_moved_one_by_one(tmp_path, monkeypatch):
    """As on macOS, and on some network disks."""
    monkeypatch.setattr(files.ctypes, "CDLL", lambda _: types.SimpleNamespace())
    (tmp_path / "place" / "below").mkdir(parents=True)
    for name in ("stays", "changes", "goes", "below/stays"):
        (tmp_path / "place" / name).write_text("old")
    with files.swapping(tmp_path / "place") as beside:
        (beside / "goes").unlink()
        (beside / "new").write_text("new")
        files.write_text(beside / "changes", "new")
    found = {
        str(f.relative_to(tmp_path)): f.read_text() for f in tmp_path.rglob("*") if f.is_file()
    }
    assert found == {
        "place/stays": "old", "place/changes": "new", "place/new": "new", "place/below/stays": "old"
    }  # fmt: skip


def test_a_swap_that_fails_leaves_the_folder_as_it_was(tmp_path):
    (tmp_path / "place").mkdir()
    (tmp_path / "place" / "file").write_text("old")
    with pytest.raises(OSError, match="disk full"), files.swapping(tmp_path / "place") as beside:
        (beside / "file").unlink()
        raise OSError("disk full")
    assert (tmp_path / "place" / "file").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["place"]


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
    assert (
        f"{Path('runs', TASK)} does not exist: playing the published policy"
        in capsys.readouterr().out
    )
