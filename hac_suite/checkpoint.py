"""Checkpoints of a seed: two files each, safe against kills, full disks and flipped bits.

A folder holds one seed's two newest checkpoints, or its final one, named by training episodes:
`000001200.safetensors`, the tensors, and `000001200.json`, everything else. Each file appears
complete or not at all. The json is written last, and holds the checksum of the tensors and its own.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import safetensors
import safetensors.torch

from hac_suite.state import SeedState

_FORMAT = "hac_suite.checkpoint/1"
_MOST_NUMBERS = 256 * 2**20  # bytes of what is beside the tensors
_TENSORS, _NUMBERS = ".safetensors", ".json"


class Checkpoint(NamedTuple):
    """A checkpoint's description, without its tensors."""

    about: dict[str, Any]  # whose it is, as `Writer` was told
    numbers: dict[str, Any]  # as in SeedState

    @property
    def train_episodes(self) -> int:
        return self.numbers["train_episodes"]


class Writer:
    """Saves seeds that are trained together, and keeps each one's last two checkpoints.

    Attributes:
        last: training episodes of the newest checkpoint, None before the first.
    """

    def __init__(
        self,
        folders: Sequence[Path],
        about: Sequence[Mapping[str, Any]],
        train_episodes: int | None = None,
    ):
        """
        Args:
            folders: one for each seed.
            about: what identifies each seed's checkpoints, in JSON's types.
            train_episodes: of the checkpoints from which the training resumes.
        """
        self._folders, self._about = folders, about
        self.last = train_episodes

    def save(self, states: Iterable[SeedState], *, alone: bool = False) -> None:
        """Writes a checkpoint of every seed; returns once they are on the disk.

        Args:
            alone: whether no other checkpoint is kept beside it.

        Raises:
            OSError: such as a full disk; the checkpoints before are untouched.
        """
        try:
            described = self._write_tensors(states)
            for folder, description in zip(self._folders, described, strict=True):
                _write(folder / _name(description, _NUMBERS), _as_text(description).encode())
                _sync(folder)
        except OSError:
            for folder in self._folders:
                _prune(folder, {file.stem for file in folder.glob(f"*{_NUMBERS}")})
            raise
        episodes = described[0]["numbers"]["train_episodes"]
        before = [] if alone or self.last is None else [self.last]
        for folder in self._folders:
            _prune(folder, {_stem(number) for number in (episodes, *before)})
        self.last = episodes

    def _write_tensors(self, states: Iterable[SeedState]) -> list[dict[str, Any]]:
        """Writes every seed's tensors; returns what their descriptions are to hold."""
        described = []
        for folder, about, state in zip(self._folders, self._about, states, strict=True):
            folder.mkdir(parents=True, exist_ok=True)
            data = safetensors.torch.save(state.tensors)
            description = {
                "format": _FORMAT,
                "about": dict(about),
                "numbers": state.numbers,
                "tensors": hashlib.sha256(data).hexdigest(),
            }
            _write(folder / _name(description, _TENSORS), data)
            described.append(description)
        return described


def newest(folder: Path) -> tuple[Checkpoint | None, list[str]]:
    """The newest intact checkpoint of a folder, and what is wrong with newer ones."""
    complaints = []
    for file in sorted(folder.glob(f"*{_NUMBERS}"), reverse=True):
        try:
            description = _described(file)
            _tensors(file, description)
        except ValueError as error:
            complaints.append(str(error))
        else:
            return Checkpoint(description["about"], description["numbers"]), complaints
    return None, complaints


def load(folder: Path, train_episodes: int) -> SeedState:
    """Reads a checkpoint; nothing in its files is executed.

    Raises:
        ValueError: it is missing or damaged; the message names the file.
    """
    file = folder / f"{_stem(train_episodes)}{_NUMBERS}"
    description = _described(file)
    data = _tensors(file, description)
    try:
        tensors = safetensors.torch.load(data)
    except safetensors.SafetensorError as error:
        raise ValueError(f"{file.with_suffix(_TENSORS)} holds no tensors: {error}") from error
    return SeedState(tensors, description["numbers"])


def _stem(train_episodes: int) -> str:
    return f"{train_episodes:09d}"


def _name(description: Mapping[str, Any], suffix: str) -> str:
    return _stem(description["numbers"]["train_episodes"]) + suffix


def _as_text(description: Mapping[str, Any]) -> str:
    return json.dumps({**description, "checksum": _checksum(description)}, indent=1) + "\n"


def _checksum(description: Mapping[str, Any]) -> str:
    rest = {name: value for name, value in description.items() if name != "checksum"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True).encode()).hexdigest()


def _described(file: Path) -> dict[str, Any]:
    try:
        if not file.is_file():
            raise ValueError("it is no regular file")
        if file.stat().st_size > _MOST_NUMBERS:
            raise ValueError(f"it has more than {_MOST_NUMBERS:,} bytes")
        description = json.loads(file.read_bytes())
        checksum = _checksum(description) if isinstance(description, dict) else None
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{file} cannot be read: {error}") from error
    if checksum is None or description.get("format") != _FORMAT:
        raise ValueError(f"{file} does not describe a checkpoint: its format is not {_FORMAT!r}")
    if description.get("checksum") != checksum:
        raise ValueError(f"{file} is damaged: it does not match its checksum")
    numbers, about = description.get("numbers"), description.get("about")
    if not isinstance(numbers, dict) or not isinstance(about, dict):
        raise ValueError(f"{file} does not describe a checkpoint: it lacks numbers")
    episodes = numbers.get("train_episodes")
    if not isinstance(episodes, int) or file.stem != _stem(episodes):
        raise ValueError(f"{file} describes a checkpoint of {episodes} episodes")
    return description


def _tensors(file: Path, description: Mapping[str, Any]) -> bytes:
    """The tensors' file beside a description, as bytes that match its checksum."""
    beside = file.with_suffix(_TENSORS)
    try:
        if beside.exists() and not beside.is_file():
            raise ValueError("it is no regular file")
        data = beside.read_bytes()
    except (OSError, ValueError) as error:
        raise ValueError(f"{beside} cannot be read: {error}") from error
    if hashlib.sha256(data).hexdigest() != description.get("tensors"):
        raise ValueError(f"{beside} is damaged: it does not match its checksum")
    return data


def _write(path: Path, data: bytes) -> None:
    """Puts a whole file in place once it is on the disk."""
    temporary = path.with_name(f".{path.name}.tmp")
    with temporary.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path)


def _sync(folder: Path) -> None:
    """Sees to it that the folder's new names are on the disk as well."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _prune(folder: Path, stems: set[str]) -> None:
    """Removes other checkpoints and incomplete files."""
    for pattern in (f"*{_NUMBERS}", f"*{_TENSORS}", ".*.tmp"):
        for file in folder.glob(pattern):
            if file.stem not in stems:
                file.unlink()
