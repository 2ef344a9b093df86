"""More periods for a finished folder: what one long run gives; nothing finished is ever lost."""

import os
import random
import resource
import shutil
import signal
import time
from pathlib import Path

import pytest
import torch

import hac_suite
from hac_suite import checkpoint
from launch.folder import policies, results
from launch.folder.layout import RunFolder
from launch.jobs import checkpointing
from tests.launch.lives import TASK, live, outcome, standings, tiny, tiny_task

__all__ = ["tiny"]

WORDS = ("--seeds=2", "--subgoal_layers=0,1", "--workers=1")
RUNS = [(layers, seed) for layers in (0, 1) for seed in (0, 1)]
SHORT, LONG = "--periods=1", "--periods=3"
OVER = 12  # episodes of a period


def launched(out: Path, *words: str, status: int = 0, **arguments) -> str:
    """Launches; returns what was printed."""
    ended, printed = live(out, *WORDS, *words, **arguments)
    assert ended == status, printed
    return printed


@pytest.fixture(scope="module")
def both(tmp_path_factory) -> Path:
    """A folder `short` of one period and a folder `long` of three, each trained in one go."""
    with pytest.MonkeyPatch.context() as patch:
        tiny_task(patch)
        out = tmp_path_factory.mktemp("extending")
        launched(out / "short", SHORT)
        launched(out / "long", LONG)
        return out


@pytest.fixture
def short(both, tmp_path, tiny) -> Path:
    """A finished folder of one period, to go on with."""
    shutil.copytree(both / "short", tmp_path / "short")
    return tmp_path / "short"


def files(out: Path) -> dict[Path, bytes]:
    """All that a launch may have touched, but for who held the lock last."""
    found = (file for file in out.rglob("*") if file.is_file() and file.name != ".lock")
    return {file.relative_to(out): file.read_bytes() for file in found}


def weights(file: Path) -> list[torch.Tensor]:
    return [network.parameters for network in hac_suite.Policy.load(file).networks]


def same(ours: list[torch.Tensor], theirs: list[torch.Tensor]) -> bool:
    return all(torch.equal(a, b) for a, b in zip(ours, theirs, strict=True))


def assert_kept(before: Path, now: Path, after: Path) -> None:
    """Finished rows are there unchanged, and each policy is the one before or the one after."""
    old, own, new = (RunFolder(out, TASK) for out in (before, now, after))
    lines = set(own.results.read_text().splitlines())
    assert set(old.results.read_text().splitlines()) <= lines
    for run in RUNS:
        held = policies.read(own.policy(*run).with_suffix(".json"))
        reference = old if held.period == 1 else new
        assert held == policies.read(reference.policy(*run).with_suffix(".json"))._replace(
            path=held.path
        )
        assert same(weights(held.path), weights(reference.policy(*run)))


def test_extended_again_and_again_it_is_one_long_run(both, short):
    assert standings(short) == {f"{TASK}_{k}layers_seed{seed}": OVER for k, seed in RUNS}
    printed = launched(short, "--periods=2", "--workers=3")
    assert printed.count(f"2 seed(s) resume from episode {OVER}") == 2
    assert "which allow more --periods later; --keep_final=false keeps none" in printed
    launched(short, LONG)
    assert outcome(short) == outcome(both / "long")
    for run in RUNS:
        ended = [
            checkpoint.load(RunFolder(out, TASK).checkpoints_of(*run), 3 * OVER)
            for out in (short, both / "long")
        ]
        assert ended[0].tensors.keys() == ended[1].tensors.keys()
        for name, tensor in ended[0].tensors.items():
            assert torch.equal(tensor, ended[1].tensors[name]), name


def test_one_state_is_kept_of_each_run(both):
    for run in RUNS:
        kept = RunFolder(both / "long", TASK).checkpoints_of(*run)
        assert sorted(file.name for file in kept.iterdir()) == [
            f"{3 * OVER:09d}.json", f"{3 * OVER:09d}.safetensors"
        ]  # fmt: skip


def extend_with_kills(both: Path, out: Path, kills: int, chance: random.Random) -> int:
    """Extends copies of the short folder under SIGKILLs; returns how many hit."""
    start = time.monotonic()
    shutil.copytree(both / "short", out / "timed")
    launched(out / "timed", LONG)
    whole, killed, copies = time.monotonic() - start, 0, 0
    while killed < kills:
        here, status = out / str(copies), -9
        shutil.copytree(both / "short", here)
        copies += 1
        while status:
            workers = f"--workers={chance.randint(1, 4)}"
            moment = chance.uniform(0, whole)
            status, printed = live(here, *WORDS, LONG, workers, kill_after=moment)
            assert status in (0, -signal.SIGKILL), printed
            assert "start" not in printed and "damaged" not in printed, printed
            killed += status != 0
            assert_kept(both / "short", here, both / "long")
        assert outcome(here) == outcome(both / "long")
    return killed


@pytest.mark.slow
def test_killed_while_extending_nothing_finished_is_lost(both, tmp_path, tiny):
    assert extend_with_kills(both, tmp_path, 5, random.Random(1)) >= 5


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_storm_of_kills_while_extending(both, tmp_path, tiny):
    kills = extend_with_kills(both, tmp_path, 100, random.Random(2))
    print(kills, "kills")
    assert kills >= 100


def at_every_change_of_a_file(number: int):
    """What makes a launch die by SIGKILL just before it puts its file of that number in place."""

    def patch() -> None:
        replace, seen = os.replace, [0]

        def dying(*names, **others):
            seen[0] += 1
            if seen[0] == number:
                os.kill(os.getpid(), signal.SIGKILL)
            replace(*names, **others)

        os.replace = dying

    return patch


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_killed_before_each_file_that_is_put_in_place(both, tmp_path, tiny):
    """Between the two files of a policy as well, and between a policy and its rows."""
    number, status = 0, -signal.SIGKILL
    while status == -signal.SIGKILL:
        number += 1
        here = tmp_path / str(number)
        shutil.copytree(both / "short", here)
        status, printed = live(here, *WORDS, LONG, first=at_every_change_of_a_file(number))
        assert_kept(both / "short", here, both / "long")
        assert "2 of 2 seeds are finished already" in launched(here, SHORT)
        launched(here, LONG)
        assert outcome(here) == outcome(both / "long"), number
        shutil.rmtree(here)
    assert status == 0 and number > 20, printed


def test_a_kill_between_the_two_files_of_a_policy_leaves_the_old_one_or_the_new_one(both, short):
    old, new = (RunFolder(out, TASK).policy(1, 0) for out in (short, both / "long"))
    old_weights = weights(old)
    shutil.copy(new.with_suffix(".safetensors"), old.with_suffix(".safetensors"))
    assert policies.read(old.with_suffix(".json")).period == 3
    assert same(weights(old), weights(new)) and not same(old_weights, weights(new))
    assert_kept(both / "short", short, both / "long")


def test_a_signal_while_extending_saves_and_keeps_what_is_finished(both, short):
    def signalled() -> None:
        at_boundary = checkpointing.Saver.at_boundary

        def handed(self, boundary):
            if boundary.train_episodes == OVER + 4:
                os.kill(os.getpid(), signal.SIGTERM)
            at_boundary(self, boundary)

        checkpointing.Saver.at_boundary = handed  # type: ignore[method-assign]

    live(short, *WORDS, LONG, first=signalled)
    assert OVER + 4 in standings(short).values()
    assert_kept(both / "short", short, both / "long")
    launched(short, LONG)
    assert outcome(short) == outcome(both / "long")


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (["--periods=1"], 0, "2 of 2 seeds are finished already"),
        ([LONG, "--config.discount=0.9"], 2, "discount is 0.98 there and 0.9 here"),
    ],
)
def test_fewer_periods_or_another_configuration_touch_nothing(both, short, words, status, said):
    launched(short, "--periods=2")
    before = files(short)
    assert said in launched(short, *words, status=status)
    changed = {file.name for file, data in files(short).items() if before.get(file) != data}
    # Who asked for what is noted; a page is drawn.
    assert changed <= ({"manifest.json", "index.html"} if not status else set())
    assert before.keys() <= files(short).keys()


def test_without_final_states_more_periods_are_refused_before_anything_is_touched(tmp_path, tiny):
    out = tmp_path / "here"
    printed = launched(out, SHORT, "--keep_final=false")
    assert not RunFolder(out, TASK).checkpoints.exists() and "train on" not in printed
    before = files(out)
    printed = launched(out, LONG, status=2)
    assert f"{TASK}, 0 subgoal layers, seed(s) 0, 1: finished after 1 periods" in printed
    assert "give another --out to train all 3 periods there" in printed
    assert len(printed.splitlines()) == 1
    assert files(out) == before


def test_final_states_that_are_not_wanted_any_more_are_removed(short):
    before = outcome(short)
    launched(short, SHORT, "--keep_final=false")
    assert not RunFolder(short, TASK).checkpoints.exists()
    assert {**outcome(short), "checkpoints": True} == before


def test_a_damaged_final_state_is_named_and_nothing_is_touched(short):
    damaged = RunFolder(short, TASK).checkpoints_of(1, 1) / f"{OVER:09d}.safetensors"
    damaged.write_bytes(damaged.read_bytes()[:-1])
    before = files(short)
    printed = launched(short, LONG, status=2)
    assert "1 subgoal layer, seed(s) 1: finished after 1 periods" in printed
    assert f"{damaged} is damaged" in printed
    assert files(short) == before


def without_final_states() -> None:
    """Makes a launch die when it is about to keep the state that its first job ended with."""
    at_boundary = checkpointing.Saver.at_boundary

    def dying(self, boundary):
        if boundary.last:
            os.kill(os.getpid(), signal.SIGKILL)
        at_boundary(self, boundary)

    checkpointing.Saver.at_boundary = dying  # type: ignore[method-assign]


@pytest.mark.slow
def test_killed_before_its_final_state_a_run_goes_on_from_the_one_before(both, tmp_path, tiny):
    out = tmp_path / "here"
    for _ in range(2):  # both agents' jobs
        launched(out, SHORT, status=-signal.SIGKILL, first=without_final_states)
    assert set(standings(out).values()) == {OVER - 4}
    finished = set(RunFolder(out, TASK).results.read_text().splitlines())
    assert "2 of 2 seeds are finished already" in launched(out, SHORT)
    printed = launched(out, LONG)
    assert printed.count(f"2 seed(s) resume from episode {OVER - 4}") == 2
    assert finished <= set(RunFolder(out, TASK).results.read_text().splitlines())
    assert outcome(out) == outcome(both / "long")


def test_rows_and_a_policy_that_were_lost_come_back_from_the_final_state(both, short):
    folder = RunFolder(short, TASK)
    rows, _ = results.read(folder.results)
    results.rewrite(folder.results, [row for row in rows if row["period"] == "0"])
    for file in folder.policies.glob("*seed1*"):
        file.unlink()
    printed = launched(short, SHORT)
    assert printed.count(f"2 seed(s) resume from episode {OVER}") == 2
    assert outcome(short) == outcome(both / "short")


@pytest.mark.slow
def test_a_disk_that_is_full_at_the_end_costs_the_final_state_and_says_so(short, both):
    def full() -> None:
        save = checkpoint.Writer.save

        def limited(self, states, *, alone=False):
            if alone:
                resource.setrlimit(resource.RLIMIT_FSIZE, (1000, resource.RLIM_INFINITY))
            try:
                save(self, states, alone=alone)
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)

        checkpoint.Writer.save = limited  # type: ignore[method-assign]

    printed = launched(short, LONG, first=full)
    assert "the final checkpoint could not be kept" in printed and "File too large" in printed
    assert outcome(short) == outcome(both / "long")
    assert set(standings(short).values()) <= {3 * OVER - 4, 3 * OVER - 8}
    launched(short, "--periods=4")
