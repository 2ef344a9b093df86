"""What a launch does about checkpoints: damaged, foreign, of a longer run, or not to be written."""

import json
import math
import os
import resource
import shutil
import signal
from pathlib import Path

import pytest

import hac_suite
from hac_suite import checkpoint
from launch.asking import settings
from launch.folder import manifest, results
from launch.folder.agents import Agent
from launch.folder.layout import RunFolder
from launch.jobs import checkpointing
from tests.launch.lives import TASK, live, outcome, standings, tiny, tiny_task

__all__ = ["tiny"]

WORDS = ("--seeds=2", "--subgoal_layers=1", "--periods=3", "--workers=1")
NAMES = [f"{TASK}_1layers_seed{seed}" for seed in (0, 1)]


def dying_at(episodes: int):
    """What makes a launch die by SIGKILL at a boundary, once that is saved."""

    def patch() -> None:
        at_boundary = checkpointing.Saver.at_boundary

        def dying(self, boundary):
            at_boundary(self, boundary)
            if boundary.train_episodes == episodes:
                os.kill(os.getpid(), signal.SIGKILL)

        checkpointing.Saver.at_boundary = dying  # type: ignore[method-assign]

    return patch


def interrupted(out: Path, episodes: int = 20) -> RunFolder:
    """A folder whose two runs stand at an episode, and at the one before."""
    status, printed = live(out, *WORDS, first=dying_at(episodes))
    assert status == -signal.SIGKILL, printed
    assert standings(out) == dict.fromkeys(NAMES, episodes)
    return RunFolder(out, TASK)


@pytest.fixture(scope="module")
def whole_once(tmp_path_factory) -> dict:
    with pytest.MonkeyPatch.context() as patch:
        tiny_task(patch)
        out = tmp_path_factory.mktemp("whole")
        status, printed = live(out, *WORDS)
    assert status == 0, printed
    return outcome(out)


@pytest.fixture
def whole(whole_once, tiny) -> dict:
    """What an uninterrupted launch leaves."""
    return whole_once


@pytest.fixture(scope="module")
def interrupted_once(tmp_path_factory) -> Path:
    """A folder to copy."""
    with pytest.MonkeyPatch.context() as patch:
        tiny_task(patch)
        out = tmp_path_factory.mktemp("interrupted")
        interrupted(out)
        return out


def spoil(file: Path) -> None:
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 255
    file.write_bytes(data)


@pytest.mark.parametrize("suffix", ["json", "safetensors"])
def test_a_damaged_checkpoint_costs_a_few_rounds_and_a_warning(tmp_path, whole, suffix):
    folder = interrupted(tmp_path / "here")
    damaged = folder.checkpoints_of(1, 0) / f"000000020.{suffix}"
    spoil(damaged)
    status, printed = live(tmp_path / "here", *WORDS)
    assert status == 0
    assert f"warning: {damaged} " in printed
    assert "seed 0: resumes from episode 16" in printed
    assert "2 seed(s) resume from episode 16, 20" in printed
    assert outcome(tmp_path / "here") == whole


def test_with_both_damaged_a_seed_starts_again_and_the_others_are_untouched(tmp_path, whole):
    folder = interrupted(tmp_path / "here")
    for file in folder.checkpoints_of(1, 0).glob("*.safetensors"):
        spoil(file)
    status, printed = live(tmp_path / "here", *WORDS)
    assert status == 0 and printed.count("is damaged") == 2
    assert "seed 0: no checkpoint is whole; it starts again" in printed
    assert "1 seed(s) resume from episode 20" in printed
    assert outcome(tmp_path / "here") == whole


def test_finished_runs_are_kept_whatever_becomes_of_checkpoints(tmp_path, whole):
    out = tmp_path / "here"
    assert live(out, *WORDS, "--seeds=1")[0] == 0
    before = outcome(out)
    status, _ = live(out, *WORDS, first=dying_at(20))  # seed 1, alone
    assert status == -signal.SIGKILL and standings(out) == {NAMES[0]: 36, NAMES[1]: 20}
    for file in RunFolder(out, TASK).checkpoints_of(1, 1).iterdir():
        file.write_bytes(b"")
    status, printed = live(out, *WORDS)
    assert status == 0 and "1 of 2 seeds are finished already" in printed
    assert outcome(out) == whole
    assert set(before["rows"]) <= set(whole["rows"])


def test_rows_come_from_the_checkpoint(tmp_path, whole):
    """Those that a kill kept from the file, and those that it had and that come again."""
    folder = interrupted(tmp_path / "here")
    rows, _ = results.read(folder.results)
    assert sorted(int(row["period"]) for row in rows) == [0, 0, 1, 1]
    again = [{**row, "period": "2", "success_rate": "0.123"} for row in rows[:1]]
    results.rewrite(folder.results, again)
    assert live(tmp_path / "here", *WORDS)[0] == 0
    assert outcome(tmp_path / "here") == whole


def test_a_checkpoint_of_another_run_is_refused(tmp_path, tiny):
    folder = interrupted(tmp_path / "here")
    shutil.rmtree(folder.checkpoints_of(1, 1))
    shutil.copytree(folder.checkpoints_of(1, 0), folder.checkpoints_of(1, 1))
    before = {file: file.read_bytes() for file in folder.path.rglob("*.*") if file.is_file()}
    status, printed = live(tmp_path / "here", *WORDS)
    assert status == 2
    assert (
        "is a checkpoint of another run (seed is 0 there and 1 here); move it elsewhere" in printed
    )
    after = {file: file.read_bytes() for file in folder.path.rglob("*.*") if file.is_file()}
    assert {**after, folder.path / ".lock": b""} == {**before, folder.path / ".lock": b""}


@pytest.mark.parametrize(
    "spoilt",
    [
        None, [], [1], [{}], [{"seed": 0}], {"success_rate": "often"}, {"seed": 1}, {"period": 7},
        {"novel": 1.0}, {"subgoal_layers": "1"},
    ],
)  # fmt: skip
def test_rows_of_a_crafted_checkpoint_never_reach_results(tmp_path, tiny, interrupted_once, spoilt):
    shutil.copytree(interrupted_once, tmp_path / "here")
    folder = RunFolder(tmp_path / "here", TASK)
    file = folder.checkpoints_of(1, 0) / "000000020.json"
    description = json.loads(file.read_text())
    rows = description["numbers"]["rows"]
    crafted = [{**row, **spoilt} for row in rows] if isinstance(spoilt, dict) else spoilt
    description["numbers"]["rows"] = crafted
    file.write_text(checkpoint._as_text(description))
    before = folder.results.read_bytes()
    status, printed = live(tmp_path / "here", *WORDS)
    assert status == 2 and "its rows do not match results.csv; remove it" in printed
    assert folder.results.read_bytes() == before


def test_a_shorter_run_does_not_throw_a_longer_ones_work_away(tmp_path, tiny):
    interrupted(tmp_path / "here", episodes=28)
    status, printed = live(tmp_path / "here", *WORDS, "--periods=2")
    assert (
        status == 2 and "after test period 2 of a longer run; give --periods=3 or more" in printed
    )
    assert standings(tmp_path / "here") == dict.fromkeys(NAMES, 28)


def test_more_periods_go_on_from_the_checkpoint(tmp_path, tiny):
    interrupted(tmp_path / "here", episodes=28)
    status, printed = live(tmp_path / "here", *WORDS, "--periods=4")
    assert status == 0 and "2 seed(s) resume from episode 28" in printed
    assert live(tmp_path / "whole", *WORDS, "--periods=4")[0] == 0
    assert outcome(tmp_path / "here") == outcome(tmp_path / "whole")


def test_other_versions_are_refused_in_one_line_unless_wanted(tmp_path, tiny, monkeypatch):
    interrupted(tmp_path / "here")
    before = outcome(tmp_path / "here")
    versions = {**manifest.versions(), "torch": "2.99", "mujoco": "3.99", "pandas": "0"}
    monkeypatch.setattr(manifest, "versions", lambda: versions)

    def lived(start: str, *words: str) -> int:
        status, printed = live(tmp_path / "here", *WORDS, *words)
        (line,) = [line for line in printed.splitlines() if start in line]
        assert "torch" in line and "(here 2.99)" in line and "(here 3.99)" in line
        assert "pandas" not in line  # only draws
        return status

    assert lived("--other_versions") == 2
    assert outcome(tmp_path / "here") == before
    assert standings(tmp_path / "here") == dict.fromkeys(NAMES, 20)
    assert lived("warning", "--other_versions") == 0


def test_going_on_under_changed_code_is_warned_of_and_recorded(tmp_path, tiny, monkeypatch):
    monkeypatch.setattr(manifest, "commit", lambda: "a1b2c3")
    interrupted(tmp_path / "here")
    monkeypatch.setattr(manifest, "commit", lambda: "d4e5f6+changes")
    status, printed = live(tmp_path / "here", *WORDS)
    (line,) = [line for line in printed.splitlines() if line.startswith("warning: ")]
    assert status == 0 and "begun with commit a1b2c3 and resumed with d4e5f6+changes" in line
    recorded = manifest.read(RunFolder(tmp_path / "here", TASK).manifest)
    assert recorded is not None and recorded["commit"] == "d4e5f6+changes"
    assert [launch["commit"] for launch in recorded["earlier_launches"]] == ["a1b2c3"]
    status, printed = live(tmp_path / "here", *WORDS)  # nothing is left to go on with
    assert status == 0 and "warning" not in printed


def test_a_disk_that_fills_up_costs_checkpoints_and_a_warning(tmp_path, whole):
    """Files beyond a size cannot be written: the first checkpoints can, the later ones cannot."""

    def fill_up() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))
        dying_at(28)()

    out = tmp_path / "here"
    status, printed = live(out, *WORDS, first=fill_up)
    assert status == -signal.SIGKILL
    assert printed.count("no checkpoint could be written") == 1  # said once
    assert "File too large" in printed
    stands = standings(out)  # asserts that they are whole
    assert set(stands.values()) <= {4, 8, 12, 16, 20, 24} and stands
    assert not list(RunFolder(out, TASK).checkpoints.rglob("*.tmp"))
    assert live(out, *WORDS)[0] == 0  # with room again
    assert outcome(out) == whole


def test_a_machine_that_slept_while_a_checkpoint_was_written_writes_others(tmp_path, monkeypatch):
    """As if saving took a day: it would have taken no more than 4% of the time a month later."""
    now, saves = [0.0], [0]
    monkeypatch.setattr(checkpointing.time, "monotonic", lambda: now[0])

    class Slow:
        last = None

        def save(self, *_, **__):
            saves[0] += 1
            now[0] += 86_400

    monkeypatch.setattr(checkpointing.checkpoint, "Writer", lambda *_: Slow())
    setup = checkpointing.Setup(Agent(TASK, 0), (6,), hac_suite.Config())
    saver = checkpointing.Saver(RunFolder(tmp_path, TASK), setup, [0], 0, print)
    counts = []
    for minutes in (6, 12, 20, 20, 12):
        now[0] += 60 * minutes
        saver.at_boundary(hac_suite.Boundary(4, False, lambda: iter(())))
        counts.append(saves[0])
    assert counts == [1, 1, 2, 2, 3]


def test_a_run_that_fails_is_tried_again_from_its_checkpoint(tmp_path, whole):
    def fail() -> None:
        at_boundary = checkpointing.Saver.at_boundary

        def failing(self, boundary):
            at_boundary(self, boundary)
            if boundary.train_episodes == 28:
                raise RuntimeError("told to fail")

        checkpointing.Saver.at_boundary = failing  # type: ignore[method-assign]

    out = tmp_path / "here"
    status, printed = live(out, *WORDS, first=fail)
    assert status == 99, printed
    status, printed = live(out, *WORDS)
    assert status == 0 and "2 seed(s) resume from episode 28" in printed
    assert outcome(out) == whole


def test_a_signal_saves_at_the_next_boundary_though_nothing_is_due(tmp_path, whole):
    def signalled() -> None:
        checkpointing.MOST_SECONDS_BETWEEN = 1000.0
        at_boundary = checkpointing.Saver.at_boundary

        def handed(self, boundary):
            if boundary.train_episodes == 28:  # the test period at 24 is saved anyway
                os.kill(os.getpid(), signal.SIGTERM)
            at_boundary(self, boundary)

        checkpointing.Saver.at_boundary = handed  # type: ignore[method-assign]

    out = tmp_path / "here"
    live(out, *WORDS, first=signalled)
    assert standings(out) == dict.fromkeys(NAMES, 28)
    assert live(out, *WORDS)[0] == 0
    assert outcome(out) == whole


def test_a_save_that_fails_as_the_run_is_stopped_is_told_as_it_is(tmp_path, whole):
    def signalled_on_a_full_disk() -> None:
        at_boundary = checkpointing.Saver.at_boundary

        def handed(self, boundary):
            if boundary.train_episodes == 28:
                resource.setrlimit(resource.RLIMIT_FSIZE, (1000, resource.RLIM_INFINITY))
                os.kill(os.getpid(), signal.SIGTERM)
            try:
                at_boundary(self, boundary)
            except SystemExit as end:
                print(end)
                raise

        checkpointing.Saver.at_boundary = handed  # type: ignore[method-assign]

    out = tmp_path / "here"
    _, printed = live(out, *WORDS, first=signalled_on_a_full_disk)
    assert "stopped at episode 28, which could not be saved" in printed
    assert "the same command resumes from episode 24" in printed
    assert "holds all until episode 24, and nothing later" in printed
    assert "training continues" not in printed and "until here" not in printed
    assert standings(out) == dict.fromkeys(NAMES, 24)
    assert live(out, *WORDS)[0] == 0
    assert outcome(out) == whole


SETUP = checkpointing.Setup(Agent(TASK, 0), (300,), hac_suite.PRESETS["paper"])


class Clock:
    """Time that passes when told to, and by `cost` in a save."""

    def __init__(self, monkeypatch, cost: float):
        self.now, self.cost, self.saves = 1000.0, cost, list[float]()
        monkeypatch.setattr(checkpointing.time, "monotonic", lambda: self.now)
        monkeypatch.setattr(checkpoint.Writer, "save", self._save)

    def _save(self, states, *, alone: bool) -> None:
        assert not alone
        self.saves.append(self.now)
        self.now += self.cost


@pytest.mark.parametrize(
    ("cost", "seconds", "every"),
    # Rounds take 10 s, and every 30th, 300 s apart but for the saves, is a test period.
    [(0.1, 10, 300), (20.0, 10, 500)],
)
def test_saving_takes_less_than_a_twentieth_of_the_time(
    tmp_path, monkeypatch, cost, seconds, every
):
    clock = Clock(monkeypatch, cost)
    saver = checkpointing.Saver(RunFolder(tmp_path, TASK), SETUP, [0], 0, warn=print)
    for number in range(1, 601):
        clock.now += seconds
        tested = number % 30 == 0
        saver.at_boundary(hac_suite.Boundary(4 * number, tested, lambda: iter(())))
    spent, passed = len(clock.saves) * cost, clock.now - 1000
    assert spent < 0.05 * passed
    gaps = [b - a for a, b in zip(clock.saves, clock.saves[1:], strict=False)]
    assert max(gaps) <= every + cost + 2 * seconds


def test_untrained_agents_are_not_saved(tmp_path, monkeypatch):
    clock = Clock(monkeypatch, 0.0)
    saver = checkpointing.Saver(RunFolder(tmp_path, TASK), SETUP, [0], 0, warn=print)
    clock.now += 1000
    saver.at_boundary(hac_suite.Boundary(0, True, lambda: iter(())))
    assert not clock.saves


def test_what_a_checkpoint_says_of_itself_is_json():
    about = SETUP.about(3)
    assert json.loads(json.dumps(about)) == about
    assert about["config"] == settings.as_json(SETUP.config) and not math.isnan(about["seed"])
