"""What every learner owes to populations and to checkpoints; and learners by name."""

import pytest
import torch

from hac_suite.learning import learners
from hac_suite.learning.ddpg import DDPG
from hac_suite.learning.td3 import TD3
from hac_suite.state import copy_into
from tests.hac_suite.learning.level import a_batch, a_learner, in_bf16, shake

EXACT = (DDPG, TD3)
KINDS = (
    *EXACT,
    pytest.param(in_bf16(DDPG), id="DDPG in bf16"),  # slower, but right, on any processor
    pytest.param(in_bf16(TD3), id="TD3 in bf16"),
)


def assert_same_tensors(ours, theirs, seeds=(0,), **tolerance):
    for seed in seeds:
        found, expected = ours.tensors(seed), theirs.tensors(seed)
        assert found.keys() == expected.keys()
        for name, tensor in expected.items():
            if tolerance:
                torch.testing.assert_close(found[name], tensor, **tolerance)
            else:
                assert torch.equal(found[name], tensor), name


@pytest.mark.parametrize("kind", EXACT)  # in bf16 as well but for roundings: see test_mixed
def test_a_batch_in_pieces_updates_as_a_whole_one(kind):
    whole, pieces = a_learner(kind), a_learner(kind)
    for _ in range(3):
        whole.update(a_batch())
    pieces._rows_at_a_time = 6
    for _ in range(3):
        pieces.update(a_batch())
    assert_same_tensors(pieces, whole, (0, 1), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_the_learner_of_some_seeds_updates_theirs_alone(kind):
    together, apart = a_learner(kind, seeds=3), a_learner(kind, seeds=3)
    parts = [apart.of_seeds(0, 1), apart.of_seeds(1, 3)]
    for _ in range(3):
        together.update(a_batch(3))
        for part, rows in zip(parts, a_batch(3).split([1, 2]), strict=True):
            part.update(rows)
    assert_same_tensors(apart, together, range(3))
    assert parts[1].updates().tolist() == [3, 3]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("done", [1, 2, 5])
def test_another_learner_goes_on_from_the_tensors_alone(kind, done):
    """Nothing that an update needs is left in the learner that made the ones before."""
    whole, resumed = a_learner(kind, target_rate=0.1), a_learner(kind, target_rate=0.1)
    for _ in range(done):
        whole.update(a_batch())
    shake(resumed)
    for seed in range(2):
        copy_into(resumed.tensors(seed), whole.tensors(seed))
    for learner in (whole, resumed):
        for _ in range(3):
            learner.update(a_batch())
    assert_same_tensors(resumed, whole, (0, 1))
    assert whole.updates().tolist() == [done + 3] * 2


@pytest.mark.parametrize("kind", KINDS)
def test_every_network_that_learns_is_watched_for_what_is_no_number(kind):
    learner = a_learner(kind)
    before = [table.clone() for table in learner.parameters()]
    for _ in range(2):
        learner.update(a_batch())
    for table, old in zip(learner.parameters(), before, strict=True):
        assert not torch.equal(table, old)
    addresses = {table.data_ptr() for table in learner.parameters()}
    moved = {name for name in learner.tensors(0) if "." not in name}  # networks
    followers = {name for name in moved if name.startswith(("target_", "tested_"))}
    online = {learner.tensors(0)[name].data_ptr() for name in moved - followers}
    assert addresses == online


@pytest.mark.parametrize("kind", KINDS)
def test_diagnosis_is_of_each_seed(kind):
    found = a_learner(kind, seeds=3).diagnose(a_batch(3))
    assert set(found) == {"q_mean", "q_min", "q_at_bound", "saturation"}
    assert all(len(values) == 3 for values in found.values())


def test_learners_by_name():
    assert [learners.find(name) for name in learners.LEARNERS] == [DDPG, TD3]


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("dpg", "learner is 'dpg'; did you mean 'ddpg'"),
        ("TD3", "did you mean 'td3'"),
        ("", "It is one of ddpg, td3, or"),
        ("mine.py", "did you mean"),
        ("mine.py:", "did you mean"),
        ("nowhere/mine.py:Mine", "no such file"),
    ],
)
def test_a_word_that_is_no_learner_is_answered(word, message):
    with pytest.raises(ValueError, match=message):
        learners.find(word)


def test_a_file_that_cannot_be_run_is_answered_with_its_line(tmp_path):
    (tmp_path / "mine.py").write_text("\nimport no_such_module\n")
    with pytest.raises(ValueError, match=r"mine.py', line 2, which fails: ModuleNotFoundError"):
        learners.find(f"{tmp_path}/mine.py:Mine")


def test_a_file_is_run_once(tmp_path):
    text = "from hac_suite.learning.ddpg import DDPG\nclass Mine(DDPG):\n    pass\n"
    (tmp_path / "mine.py").write_text(text)
    word = f"{tmp_path}/mine.py:Mine"
    assert learners.find(word) is learners.find(word)


def test_a_file_without_the_class_is_answered(tmp_path):
    (tmp_path / "mine.py").write_text("Other = 3\n")
    for name in ("Mine", "Other"):
        with pytest.raises(ValueError, match=f"mine.py has no class '{name}'"):
            learners.find(f"{tmp_path / 'mine.py'}:{name}")


def test_a_class_that_is_no_learner_says_what_it_lacks(tmp_path):
    (tmp_path / "mine.py").write_text("class Mine:\n    def update(self, rows): ...\n")
    with pytest.raises(ValueError, match=r"the class lacks .*diagnose.*on_gpu.*derive it from"):
        learners.find(f"{tmp_path / 'mine.py'}:Mine")


def test_a_learners_file_may_hold_dataclasses(tmp_path):
    (tmp_path / "mine.py").write_text(
        "from __future__ import annotations\n"
        "import dataclasses\n"
        "from hac_suite.learning.ddpg import DDPG\n"
        "@dataclasses.dataclass\nclass Own:\n    rate: float = 1.0\n"
        "class Mine(DDPG):\n    own = Own()\n"
    )
    assert learners.find(f"{tmp_path / 'mine.py'}:Mine").own.rate == 1.0
