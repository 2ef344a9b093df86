"""The whole state of one seed, as tensors and numbers: what a checkpoint holds."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple

import torch


class SeedState(NamedTuple):
    """One seed between two rounds.

    `tensors` may be views of live memory: they are valid until the training continues.
    """

    tensors: dict[str, torch.Tensor]
    numbers: dict[str, Any]  # in JSON's types


@contextmanager
def restoring() -> Iterator[None]:
    """Turns errors of an incomplete or wrongly shaped state into ValueError."""
    try:
        yield
    except (AttributeError, IndexError, KeyError, OverflowError, TypeError) as error:
        raise ValueError(f"not a state of this training: {error!r}") from error


def copy_into(live: Mapping[str, torch.Tensor], saved: Mapping[str, torch.Tensor]) -> None:
    """Overwrites each live tensor in place, so views of it and captured graphs stay valid.

    Raises:
        ValueError: a tensor is missing, or has another shape or type.
    """
    for name, tensor in live.items():
        found = saved[name]
        if (found.shape, found.dtype) != (tensor.shape, tensor.dtype):
            raise ValueError(
                f"{name} is {found.dtype} {list(found.shape)} in the state, "
                f"and {tensor.dtype} {list(tensor.shape)} here"
            )
        tensor.copy_(found)
