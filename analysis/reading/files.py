"""Writes files atomically, so that readers never see a partial file; reads small files."""

import contextlib
import ctypes
import fcntl
import os
import shutil
import stat
from collections.abc import Callable, Iterator
from pathlib import Path

MOST_BYTES = 64 * 2**20  # of a file that people could write by hand
_HERE, _EXCHANGE = -100, 2  # of Linux's renameat2: names are below where we are; change places


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """The content of a regular file of limited size.

    Raises:
      FileNotFoundError: there is none.
      ValueError: it is not a regular file, or it is too large.
    """
    # Without O_NONBLOCK the opening of a pipe waits for somebody to write into it.
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    try:
        found = os.fstat(handle)
        if not stat.S_ISREG(found.st_mode):
            raise ValueError(f"{path} is no regular file")
        if found.st_size > most:
            raise ValueError(f"{path} has {found.st_size:,} bytes; it takes {most:,} at most")
        with open(handle, "rb", closefd=False) as file:
            return file.read()
    finally:
        os.close(handle)


def read_text(path: Path, most: int = MOST_BYTES) -> str:
    """As `read_bytes`, for text.

    Raises:
      UnicodeDecodeError: it is not UTF-8 text; this is also a ValueError.
    """
    return read_bytes(path, most).decode("utf-8")


@contextlib.contextmanager
def replacing(*paths: Path) -> Iterator[list[Path]]:
    """Gives temporary paths, which replace these paths if the block succeeds.

    They are replaced in this order, once all files are on the disk. A temporary name has the suffix
    of its path, and the names of paths that differ in their suffix differ in nothing else.
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


@contextlib.contextmanager
def swapping(folder: Path) -> Iterator[Path]:
    """Gives a copy of a folder to change, which replaces the folder if the block succeeds.

    It is replaced in one rename, so no reader sees a mix of old and new files. Unchanged files are
    hard links, so replace a file rather than write into it. Processes take turns to swap folders of
    the same parent.
    """
    folder.mkdir(parents=True, exist_ok=True)
    folder = folder.resolve()
    with _alone_in(folder.parent):
        for left in leftovers(folder.parent, folder.name):
            shutil.rmtree(left, ignore_errors=True)
        beside = _temporary(folder)
        try:
            shutil.copytree(folder, beside, copy_function=_link)
            yield beside
            for file in beside.rglob("*"):
                if file.is_file():
                    _sync(file)
            _exchange(beside, folder)
        finally:
            shutil.rmtree(beside, ignore_errors=True)


def put(file: Path, folder: Path) -> Path:
    """Puts a copy of a file into a folder, in place of the one of that name; returns it."""
    (folder / file.name).unlink(missing_ok=True)
    return Path(shutil.copy(file, folder))


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Calls `write` with a temporary path beside `path`, then renames it to `path`."""
    with replacing(path) as (temporary,):
        write(temporary)


def write_text(path: Path, text: str) -> None:
    """Replaces the file by this text."""
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def leftovers(folder: Path, name: str) -> Iterator[Path]:
    """Incomplete files of that name (or pattern) that a kill left behind."""
    stem, suffix = os.path.splitext(name)
    return folder.glob(f".{stem}.[0-9]*.tmp{suffix}")


def _temporary(path: Path) -> Path:
    return path.with_name(f".{path.stem}.{os.getpid()}.tmp{path.suffix}")


@contextlib.contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Waits until no other process is here, and keeps others waiting."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)  # which gives the lock back


def _link(source: str, target: str) -> None:
    try:
        os.link(source, target)
    except OSError:  # a disk without hard links
        shutil.copy2(source, target)


def _exchange(new: Path, old: Path) -> None:
    """Lets two folders change places; where the system cannot, moves the new one's files over."""
    names = os.fsencode(new.absolute()), os.fsencode(old.absolute())
    with contextlib.suppress(AttributeError, OSError):
        if ctypes.CDLL(None).renameat2(_HERE, names[0], _HERE, names[1], _EXCHANGE) == 0:
            _sync(old.parent)
            return
    kept = {file.relative_to(new) for file in new.rglob("*")}
    for name in sorted(kept):
        if (new / name).is_dir():
            (old / name).mkdir(exist_ok=True)
        else:
            os.replace(new / name, old / name)
    for file in old.rglob("*"):
        if file.is_file() and file.relative_to(old) not in kept:
            file.unlink()


def _sync(path: Path) -> None:
    """Waits until a file is on the disk, and not only in the system's memory."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
