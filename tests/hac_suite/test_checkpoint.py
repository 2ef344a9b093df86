"""Checkpoint files: the last two are kept, and nothing but a whole one is ever taken for one."""

import errno
import hashlib
import json
import os
import pickle
from pathlib import Path

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hac_suite import checkpoint
from hac_suite.state import SeedState


def state(episodes: int) -> SeedState:
    tensors = {"replay": torch.arange(24.0).view(6, 4) + episodes, "steps": torch.tensor(3.0)}
    numbers = {"train_episodes": episodes, "rows": [{"q": float("nan"), "steps": 1 / 3}]}
    return SeedState(tensors, numbers)


@pytest.fixture
def folder(tmp_path) -> Path:
    """A seed's folder with checkpoints of 8 and 12 episodes."""
    writer = checkpoint.Writer([tmp_path / "seed"], [{"seed": 7}])
    for episodes in (4, 8, 12):
        writer.save([state(episodes)])
    return tmp_path / "seed"


def test_the_last_two_are_kept_and_read_back_unchanged(folder):
    assert sorted(file.name for file in folder.iterdir()) == [
        f"{episodes}.{suffix}"
        for episodes in ("000000008", "000000012")
        for suffix in ("json", "safetensors")
    ]
    found, complaints = checkpoint.newest(folder)
    assert found is not None and not complaints
    assert found.about == {"seed": 7} and found.train_episodes == 12
    for episodes in (8, 12):
        read, written = checkpoint.load(folder, episodes), state(episodes)
        assert str(read.numbers) == str(written.numbers)  # NaN is not equal to itself
        assert read.tensors.keys() == written.tensors.keys()
        assert all(torch.equal(read.tensors[name], written.tensors[name]) for name in read.tensors)


def assert_falls_back(folder: Path, damaged: str) -> None:
    """The checkpoint of 8 episodes is found, and the damaged file of the newer one named."""
    found, (complaint,) = checkpoint.newest(folder)
    assert found is not None and found.train_episodes == 8
    assert damaged in complaint
    with pytest.raises(ValueError, match=damaged):
        checkpoint.load(folder, 12)


@pytest.mark.parametrize("suffix", ["json", "safetensors"])
@pytest.mark.parametrize("kept", [0, 1, 60, -1])
def test_a_file_cut_short_is_named_and_the_one_before_taken(folder, suffix, kept):
    file = folder / f"000000012.{suffix}"
    data = file.read_bytes().rstrip(b"\n")
    file.write_bytes(data[:kept])
    assert_falls_back(folder, file.name)


def test_every_flipped_byte_of_the_tensors_is_noticed(folder):
    file = folder / "000000012.safetensors"
    data = file.read_bytes()
    for position in range(len(data)):
        file.write_bytes(flipped(data, position))
        assert_falls_back(folder, file.name)


def test_no_flipped_byte_of_the_json_changes_what_is_read(folder):
    file = folder / "000000012.json"
    data, harmless = file.read_bytes(), 0
    for position in range(len(data)):
        file.write_bytes(flipped(data, position))
        found, complaints = checkpoint.newest(folder)
        assert found is not None
        if complaints:
            assert_falls_back(folder, file.name)
        else:  # between the words, say
            harmless += 1
            assert str(found.numbers) == str(state(12).numbers)
    assert harmless < 0.2 * len(data)


def flipped(data: bytes, position: int) -> bytes:
    return data[:position] + bytes([data[position] ^ 1]) + data[position + 1 :]


def test_a_missing_file_is_named(folder):
    (folder / "000000012.safetensors").unlink()
    assert_falls_back(folder, "000000012.safetensors")


def test_tensors_without_a_json_are_of_a_save_that_was_cut_short(folder):
    (folder / "000000012.json").unlink()
    found, complaints = checkpoint.newest(folder)
    assert found is not None and found.train_episodes == 8 and not complaints


def test_both_damaged_leave_none_and_say_so(folder):
    for episodes in ("000000008", "000000012"):
        (folder / f"{episodes}.safetensors").write_bytes(b"")
    found, complaints = checkpoint.newest(folder)
    assert found is None and len(complaints) == 2
    assert checkpoint.newest(folder / "nowhere") == (None, [])


def test_a_renamed_checkpoint_is_not_taken_for_a_later_one(folder):
    for suffix in (".json", ".safetensors"):
        (folder / f"000000012{suffix}").rename(folder / f"000000099{suffix}")
    found, (complaint,) = checkpoint.newest(folder)
    assert found is not None and found.train_episodes == 8 and "of 12 episodes" in complaint


class Payload:
    """Leaves a file where it is unpickled."""

    def __init__(self, mark: Path):
        self._mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self._mark),)


def test_a_pickle_is_refused_and_not_run_though_its_checksum_is_right(folder, tmp_path):
    hostile, mark = pickle.dumps(Payload(tmp_path / "mark")), tmp_path / "mark"
    (folder / "000000012.safetensors").write_bytes(hostile)
    assert_falls_back(folder, "000000012.safetensors")
    description = json.loads((folder / "000000012.json").read_text())
    description["tensors"] = hashlib.sha256(hostile).hexdigest()
    (folder / "000000012.json").write_text(checkpoint._as_text(description))
    with pytest.raises(ValueError, match=r"000000012.safetensors holds no tensors"):
        checkpoint.load(folder, 12)
    (folder / "000000012.json").write_bytes(hostile)
    assert_falls_back(folder, "000000012.json")
    assert not mark.exists()
    pickle.loads(hostile)
    assert mark.exists()  # it would have


@pytest.mark.parametrize("text", ["[]", "{}", "1", '{"format": "hac_suite.checkpoint/0"}'])
def test_a_json_of_something_else_is_named(folder, text):
    (folder / "000000012.json").write_text(text)
    assert_falls_back(folder, "000000012.json")


@pytest.mark.parametrize("failing", range(1, 9))
def test_a_disk_that_fills_in_mid_save_leaves_those_before(tmp_path, monkeypatch, failing):
    """Two seeds: four files and two folders are synced, any of which can fail."""
    folders = [tmp_path / "0", tmp_path / "1"]
    writer = checkpoint.Writer(folders, [{}, {}])
    writer.save([state(4), state(4)])
    calls = []
    sync = os.fsync

    def full(handle):
        calls.append(handle)
        if len(calls) == failing:
            raise OSError(errno.ENOSPC, "No space left on device")
        sync(handle)

    monkeypatch.setattr(os, "fsync", full)
    if failing > 6:
        writer.save([state(8), state(8)])
    else:
        with pytest.raises(OSError, match="No space"):
            writer.save([state(8), state(8)])
    for folder in folders:
        found, complaints = checkpoint.newest(folder)
        assert found is not None and not complaints
        assert checkpoint.load(folder, 4).numbers["train_episodes"] == 4
        held = {file.stem for file in folder.iterdir()}
        assert held == {file.stem for file in folder.glob("*.json")}, "tensors nobody can use"
        assert not list(folder.glob(".*"))
    monkeypatch.undo()
    writer.save([state(12), state(12)])
    for folder in folders:
        assert len(list(folder.iterdir())) == 4
        assert checkpoint.newest(folder)[0].train_episodes == 12


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=9), inner),
)
NAMES = st.sampled_from(["format", "about", "numbers", "tensors", "train_episodes", "checksum"])


@pytest.mark.slow
@given(st.binary() | JSON.map(lambda value: json.dumps(value).encode()))
def test_no_content_ends_in_anything_but_a_complaint(tmp_path_factory, content):
    folder = tmp_path_factory.mktemp("folder")
    (folder / "000000012.json").write_bytes(content)
    found, complaints = checkpoint.newest(folder)
    assert found is None and len(complaints) == 1


@pytest.mark.slow
@given(st.dictionaries(NAMES, JSON))
def test_nor_does_one_with_the_right_checksum(tmp_path_factory, entries):
    folder = tmp_path_factory.mktemp("folder")
    content = checkpoint._as_text({**entries, "format": checkpoint._FORMAT})
    (folder / "000000012.json").write_text(content)
    found, complaints = checkpoint.newest(folder)
    assert found is None and len(complaints) == 1


@pytest.mark.parametrize("content", ["[" * 100_000, '{"a":' * 100_000, "1" * 100_000])
def test_a_file_made_to_exhaust_the_parser_is_named(folder, content):
    (folder / "000000012.json").write_text(content)
    assert_falls_back(folder, "000000012.json")
