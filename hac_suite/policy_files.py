"""A policy's two files: the weights, and a description for people and readers that need no weights.

The weights file contains the description as well. If a kill comes between replacing the two files,
the checksum in the description does not match the weights, and the description inside the weights
file counts. So a replaced policy is either the old one or the new one.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import safetensors
import safetensors.torch
import torch

WEIGHTS, DESCRIPTION = SUFFIXES = (".safetensors", ".json")
"""In the order in which they are to be put in place."""
_FORMAT = "hac_suite.policy/2"
_MOST_BYTES = 256 * 2**20
_CHECKSUM = "weights"  # in the description: of the file of weights that it was saved with


def paths(path: Path) -> tuple[Path, Path]:
    """The files of a policy: weights, description; its path may have the suffix of one of them."""
    if path.suffix in SUFFIXES:
        path = path.with_suffix("")
    return path.with_name(path.name + WEIGHTS), path.with_name(path.name + DESCRIPTION)


def write(path: Path, tensors: Mapping[str, torch.Tensor], description: Mapping[str, Any]) -> None:
    """Writes both files."""
    described = {**description, "format": _FORMAT}
    # Not `save_file`: it lets nobody else read the file, and a kill leaves its temporary one.
    data = safetensors.torch.save(dict(tensors), {"description": json.dumps(described)})
    weights, text = paths(path)
    weights.write_bytes(data)
    described[_CHECKSUM] = hashlib.sha256(data).hexdigest()
    text.write_text(json.dumps(described, indent=2) + "\n", encoding="utf-8")


def describe(path: Path) -> dict[str, Any]:
    """A policy's description.

    Raises:
        ValueError: a file is missing or not a policy; the message names it.
    """
    weights, file = paths(path)
    try:
        described = _described(_read(file))
        checksum = described.get(_CHECKSUM)
        if checksum is not None and checksum != hashlib.sha256(_read(weights)).hexdigest():
            return _of_weights(weights) or described
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{file} does not describe a policy: {error}") from error
    return described


def tensors(path: Path) -> dict[str, torch.Tensor]:
    """A policy's weights.

    Raises:
        ValueError: the file is missing or not safetensors; the message names it.
    """
    weights, _ = paths(path)
    try:
        return safetensors.torch.load(_read(weights))
    except (OSError, ValueError, safetensors.SafetensorError) as error:
        raise ValueError(f"{weights} is not a safetensors policy: {error}") from error


def _read(file: Path) -> bytes:
    """The content of a regular file of limited size; a pipe, for example, might never end."""
    if not file.is_file() and file.exists():
        raise ValueError(f"{file} is no regular file")
    with file.open("rb") as opened:
        data = opened.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        raise ValueError(f"{file} has more than {_MOST_BYTES:,} bytes")
    return data


def _described(text: bytes | str) -> dict[str, Any]:
    described = json.loads(text)
    if not isinstance(described, dict) or described.get("format") != _FORMAT:
        raise ValueError(f"its format is not {_FORMAT!r}")
    return described


def _of_weights(file: Path) -> dict[str, Any] | None:
    """The description inside a weights file; None if it has none or cannot be read."""
    try:
        with safetensors.safe_open(file, framework="pt") as opened:
            return _described((opened.metadata() or {})["description"])
    except (KeyError, OSError, ValueError, safetensors.SafetensorError):
        return None
