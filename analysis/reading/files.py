"""Writes files so that a reader, a kill or a power cut never meets half of one."""

import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path


@contextlib.contextmanager
def replacing(*paths: Path) -> Iterator[list[Path]]:
    """Gives temporary paths beside these, which take their places if the block ends well.

    They take them in this order, once they are all on the disk. A temporary name has the suffix of
    its path, and the names of paths that differ in their suffix differ in nothing else.
    """
    temporary = [_temporary(path) for path in paths]
    try:
        yield temporary
        for written in temporary:
            _sync(written)
        for written, path in zip(temporary, paths, strict=True):
            os.replace(written, path)
    finally:
        for path in temporary:
            path.unlink(missing_ok=True)


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Calls `write` with a temporary path beside `path`, then renames it to `path`."""
    with replacing(path) as (temporary,):
        write(temporary)


def write_text(path: Path, text: str) -> None:
    """Replaces the file by this text."""
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def leftovers(folder: Path, name: str) -> Iterator[Path]:
    """What a kill left half written of files of that name, which may be a pattern."""
    stem, suffix = os.path.splitext(name)
    return folder.glob(f".{stem}.[0-9]*.tmp{suffix}")


def _temporary(path: Path) -> Path:
    return path.with_name(f".{path.stem}.{os.getpid()}.tmp{path.suffix}")


def _sync(path: Path) -> None:
    """Waits until a file is on the disk, and not only in the system's memory."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
