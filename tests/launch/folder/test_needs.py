"""What a run needs is reckoned before it begins: warned of, or refused with the numbers."""

import re
import resource

import pytest
import torch

import hac_suite
import tasks
from hac_suite import checkpoint
from hac_suite.config import SUITE, horizons
from hac_suite.learning import learners
from hac_suite.training.loop import Training
from hac_suite.types import level_specs
from launch.folder import needs
from launch.folder.agents import Agent, Job
from launch.folder.layout import RunFolder
from tests.hac_suite.tiny_envs import PointEnv
from tests.launch.lives import TASK, live, tiny

__all__ = ["tiny"]

WORDS = ("--seeds=4", "--subgoal_layers=1", "--periods=2", "--workers=2")
GIGABYTE = 10**9


@pytest.mark.slow
@pytest.mark.parametrize("layers", [0, 1, 2])
def test_a_checkpoint_is_about_as_large_as_reckoned(tmp_path, layers):
    config = hac_suite.Config(
        hidden_sizes=(32, 32), replay_capacity=400, batch_size=16, updates_per_episode=1,
        episodes_per_period=200, test_episodes=1,
    )  # fmt: skip
    env = PointEnv(1, max_steps=20)
    attempts = horizons(20, layers)
    with torch.no_grad():
        training = Training(lambda n: PointEnv(n, max_steps=20), config, (0,), attempts, "cpu")
        for _ in range(50):  # until the buffers are full
            training.train_round()
        checkpoint.Writer([tmp_path], [{}]).save(training.states())
    (file,) = tmp_path.glob("*.safetensors")
    reckoned = needs.of_seed(env, attempts, config, max_steps=20, episodes=200)
    assert 0.7 < file.stat().st_size / reckoned < 1.1


@pytest.mark.parametrize(("learner", "count"), [("ddpg", 9), ("td3", 13)])
def test_what_each_learner_keeps_is_counted(learner, count):
    config = hac_suite.Config(learner=learner, hidden_sizes=(256, 256))
    env, attempts = PointEnv(1, max_steps=20), (5, 4)
    specs = level_specs(env, attempts)
    made = [learners.find(learner)(spec, config, [torch.Generator()]) for spec in specs]
    kept = sum(4 * tensor.numel() for own in made for tensor in own.tensors(0).values())
    reckoned = needs.of_seed(env, attempts, config, max_steps=20, episodes=0)
    assert 0.95 < kept / reckoned <= 1 and needs.tables(config) == count


def test_a_learner_without_targets_keeps_less_and_a_broken_one_is_no_error(tmp_path):
    plain = hac_suite.Config(target_rate=0.0, tested_actor_rate=0.0)
    assert needs.tables(plain) == 6
    (tmp_path / "own.py").write_text("class Own:\n    def __init__(self, *_): raise OSError\n")
    assert needs.tables(hac_suite.Config(learner=f"{tmp_path}/own.py:Own")) == 13


def test_a_buffer_that_cannot_fill_up_is_not_reckoned_full():
    spec = tasks.spec("pick_place")
    few, many = (
        needs.of_seed(spec, (7, 7, 7), SUITE, max_steps=spec.max_steps, episodes=episodes)
        for episodes in (4, 3000)
    )
    assert few < many / 10


def job(seeds: int, layers: int = 0) -> Job:
    return Job(Agent(TASK, layers), tuple(range(seeds)))


def test_only_what_trains_at_a_time_takes_memory():
    jobs = [job(3), job(2, 1), job(1, 2)]
    need = needs.of_jobs(jobs, 2, lambda _: needs.Size(10), keep_final=True)
    # Three seeds and two, and one more of each that is being saved.
    assert need == (2 * needs.PROCESS + 40 + 30, 6 * 10 + 2 * 50)
    assert needs.of_jobs(jobs, 2, lambda _: needs.Size(10), keep_final=False).disk == 3 * 50
    assert (
        needs.of_jobs(jobs, 9, lambda _: needs.Size(10), keep_final=True).memory
        == 3 * needs.PROCESS + 90
    )
    wide = needs.of_jobs(
        jobs, 2, lambda job: needs.Size(10, 100 * (job.seeds != (0,))), keep_final=True
    )
    assert wide == (2 * needs.PROCESS + 40 + 30 + 500, need.disk)


def has(monkeypatch, *, memory=(64 * GIGABYTE, 64 * GIGABYTE), disk=64 * GIGABYTE) -> None:
    """Makes this machine one that has so much, and so much of it free."""
    monkeypatch.setattr(needs, "memory", lambda: memory)
    monkeypatch.setattr(needs, "free_disk", lambda path: disk)


def test_where_there_is_enough_nothing_is_said(tmp_path, tiny, monkeypatch):
    has(monkeypatch)
    status, printed = live(tmp_path / "out", *WORDS)
    assert status == 0 and "warning" not in printed


def test_too_little_memory_or_disk_is_warned_of_before_training(tmp_path, tiny, monkeypatch):
    has(monkeypatch, memory=(GIGABYTE, 500_000_000), disk=300_000)
    status, printed = live(tmp_path / "out", *WORDS)
    assert status == 0
    (memory,) = [line for line in printed.splitlines() if "of memory, and" in line]
    (disk,) = [line for line in printed.splitlines() if "of disk, and" in line]
    assert re.search(r"warning: this run may need 80\d MB of memory, and 500 MB are free", memory)
    assert "warning" in disk and "has 300 kB free" in disk


@pytest.mark.parametrize(
    ("there", "said"),
    [
        (dict(memory=(300_000_000, 300_000_000)), "of memory, and this machine has 300 MB"),
        (dict(disk=10_000), "the checkpoints of one seed need"),
    ],
)
def test_what_cannot_work_is_refused_with_the_numbers(tmp_path, tiny, monkeypatch, there, said):
    has(monkeypatch, **there)
    status, printed = live(tmp_path / "out", *WORDS)
    assert status == 2 and said in printed and len(printed.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_checkpoints_that_are_replaced_are_room(tmp_path, monkeypatch):
    has(monkeypatch, disk=2500)

    def doubts(kept: int, *, keep_final: bool = True) -> list[str]:
        reckoned = [job(1), job(1, 1)]
        return needs.doubts(
            reckoned,
            1,
            lambda _: needs.Size(1000),
            tmp_path,
            kept=kept,
            keep_final=keep_final,
            here=True,
        )

    (line,) = doubts(0)
    assert "checkpoints may need 4 kB of disk" in line and "has 2 kB free" in line
    assert doubts(1500) == []
    assert len(doubts(0, keep_final=False)) == 1 and doubts(500, keep_final=False) == []


def test_checkpoints_of_other_seeds_are_no_room(tmp_path, tiny, monkeypatch):
    assert live(tmp_path, *WORDS)[0] == 0
    folder = RunFolder(tmp_path, TASK)
    assert folder.checkpoint_bytes() > 100_000  # of finished seeds: they stay
    of_seed_1 = sum(file.stat().st_size for file in folder.checkpoints_of(1, 1).iterdir())
    jobs = [Job(Agent(TASK, 1), (1, 7)), Job(Agent(TASK, 0), (2,))]
    assert needs.replaced(jobs, {TASK: folder}) == of_seed_1
    has(monkeypatch, disk=10_000)
    status, printed = live(tmp_path, *WORDS, "--seeds=10-11")
    assert status == 2 and "has 10 kB free" in printed


def test_a_finished_folder_needs_nothing(tmp_path, tiny, monkeypatch):
    assert live(tmp_path, *WORDS)[0] == 0
    has(monkeypatch, memory=(1, 1), disk=1)
    status, printed = live(tmp_path, *WORDS)
    assert status == 0 and "warning" not in printed


def test_this_machine_has_some():
    total, free = needs.memory()
    assert 10**8 < free <= total
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 < total


def test_a_container_may_have_less(tmp_path, monkeypatch):
    limit, used = tmp_path / "limit", tmp_path / "used"
    monkeypatch.setattr(needs, "_MEMORY_LIMITS", [(str(limit), str(used))])
    whole = needs.memory()
    limit.write_text("max\n")
    used.write_text("123\n")
    assert needs.memory()[0] == whole[0]
    limit.write_text("1000000\n")
    used.write_text("400000\n")
    assert needs.memory() == (1_000_000, 600_000)


def test_free_disk_is_asked_of_the_first_folder_that_is_there(tmp_path):
    assert needs.free_disk(tmp_path / "a" / "b") == pytest.approx(
        needs.free_disk(tmp_path), rel=0.1
    )
