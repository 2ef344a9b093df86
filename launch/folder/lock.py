"""A run folder's lock: one launch at a time; readers see the lock without taking it."""

import contextlib
import fcntl
import json
import os
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, NamedTuple

from analysis.program import CommandError

NAME = ".lock"
_TAKEN = "{folder} was moved, removed or replaced while a launch was using it"
_MOST = 10_000  # characters of it that are read
_STRUCT = "hhqqi4x"  # struct flock of Linux: type, whence, start, length, process


class FolderTaken(OSError):
    """The run folder was moved, removed or replaced during the launch."""


class Lock(NamedTuple):
    """A lock that is held."""

    folder: Path
    file: IO[str]

    def check(self) -> None:
        """Raises FolderTaken where the path no longer leads to what is locked.

        Another launch may have made a folder in that place, and be at work there.
        """
        try:
            found, own = os.stat(self.folder / NAME), os.fstat(self.file.fileno())
        except OSError:
            raise FolderTaken(_TAKEN.format(folder=self.folder)) from None
        if (found.st_dev, found.st_ino) != (own.st_dev, own.st_ino):
            raise FolderTaken(_TAKEN.format(folder=self.folder))


@contextlib.contextmanager
def held(folder: Path) -> Iterator[Lock]:
    """Holds the lock of a folder; the system drops it with the process, however that ends.

    Raises:
      CommandError: another launch holds it, or the folder cannot be written.
    """
    if (folder / NAME).exists() and not (folder / NAME).is_file():
        raise CommandError(f"{folder / NAME} is no regular file; remove it")
    try:
        file = (folder / NAME).open("a+", encoding="utf-8")
    except OSError as error:
        raise CommandError(f"cannot write to {folder}: {error.strerror}") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise CommandError(_refusal(folder, file)) from error
        _show(file)
        file.truncate(0)
        holder = {"pid": os.getpid(), "since": time.strftime("%Y-%m-%d %H:%M:%S")}
        json.dump(holder, file)
        file.flush()
        lock = Lock(folder, file)
        lock.check()  # it may have been replaced between our opening and our locking
        yield lock


def holder(folder: Path) -> dict[str, Any] | None:
    """What the running launch wrote into the lock; {} if unknown, None if no launch runs.

    It takes no lock, not even briefly, since that would make a starting launch fail.
    """
    if not (folder / NAME).is_file():
        return None
    with (folder / NAME).open(encoding="utf-8", errors="replace") as file:
        return _written(file) if _is_held(file) else None


def _refusal(folder: Path, file: IO[str]) -> str:
    written = _written(file)
    who = "another process"
    if {"pid", "since"} <= written.keys():
        who = f"process {written['pid']}, started {written['since']}"
    return f"{folder} is in use by {who}; wait for it, or give another --out"


def _written(file: IO[str]) -> dict[str, Any]:
    file.seek(0)
    try:
        written = json.loads(file.read(_MOST))
    except (ValueError, RecursionError):  # held, and not written to yet
        return {}
    return written if isinstance(written, dict) else {}


def _show(file: IO[str]) -> None:
    """Makes a lock visible that is held already.

    Nobody can ask for an flock without taking it, which can be asked of Linux's locks of ranges.
    Where flocks are locks of ranges, as on NFS, this one is refused, and not needed.
    """
    with contextlib.suppress(AttributeError, OSError):
        fcntl.fcntl(file, fcntl.F_OFD_SETLK, struct.pack(_STRUCT, fcntl.F_WRLCK, 0, 0, 0, 0))


def _is_held(file: IO[str]) -> bool:
    try:
        asked = struct.pack(_STRUCT, fcntl.F_WRLCK, 0, 0, 0, 0)
        answer = fcntl.fcntl(file, fcntl.F_OFD_GETLK, asked)
        return bool(struct.unpack(_STRUCT, answer)[0] != fcntl.F_UNLCK)
    except (AttributeError, OSError):  # not on Linux: whether that process is there must do
        return _is_alive(_written(file).get("pid"))


def _is_alive(process: Any) -> bool:
    try:
        os.kill(process, 0)
    except PermissionError:
        return True
    except (OSError, OverflowError, TypeError):
        return False
    return True
