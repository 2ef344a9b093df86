"""The lock of a run folder: who reads it never keeps a launch out."""

import contextlib
import json
import os
import threading

import pytest

from analysis.program import CommandError
from launch.folder import lock


@pytest.mark.slow
def test_readers_never_keep_a_launch_out(tmp_path):
    with lock.held(tmp_path):
        pass
    done, read = threading.Event(), [0, 0, 0]

    def reads(number: int) -> None:
        while not done.is_set():
            lock.holder(tmp_path)
            read[number] += 1

    readers = [threading.Thread(target=reads, args=(number,)) for number in range(len(read))]
    for reader in readers:
        reader.start()
    try:
        for _ in range(1000):
            with lock.held(tmp_path):
                pass
    finally:
        done.set()
    for reader in readers:
        reader.join()
    assert min(read) > 0


def test_a_reader_that_is_stopped_in_mid_read_keeps_no_launch_out(tmp_path, monkeypatch):
    """As SIGSTOP, a debugger or a slow disk would stop it, with the file open."""
    with lock.held(tmp_path):
        pass
    is_held, began = lock._is_held, []

    def stopped(file) -> bool:
        answer = is_held(file)
        with lock.held(tmp_path):
            began.append(answer)
        return answer

    monkeypatch.setattr(lock, "_is_held", stopped)
    assert lock.holder(tmp_path) is None and began == [False]


def test_a_reader_sees_who_holds_it_and_that_nobody_does(tmp_path):
    assert lock.holder(tmp_path) is None
    with lock.held(tmp_path):
        holder = lock.holder(tmp_path)
        assert holder is not None and holder["pid"] == os.getpid()
        refused = pytest.raises(CommandError, match=f"in use by process {os.getpid()}")
        with refused, lock.held(tmp_path):
            pass
        assert lock.holder(tmp_path) == holder
    assert lock.holder(tmp_path) is None
    assert json.loads((tmp_path / lock.NAME).read_text())["pid"] == os.getpid()  # who held it last


def test_a_launch_that_was_killed_holds_nothing(tmp_path):
    reader, writer = os.pipe()
    process = os.fork()
    if not process:
        with contextlib.suppress(BaseException), lock.held(tmp_path):
            os.write(writer, b"1")
            threading.Event().wait()
        os._exit(1)
    os.read(reader, 1)
    holder = lock.holder(tmp_path)
    assert holder is not None and holder["pid"] == process
    os.kill(process, 9)
    os.waitpid(process, 0)
    assert lock.holder(tmp_path) is None
    with lock.held(tmp_path):
        pass


@pytest.mark.parametrize("text", ["", "[]", "{", "[" * 100_000, '{"pid": null}', '{"pid": 1e999}'])
def test_a_damaged_lock_is_a_lock(tmp_path, text):
    (tmp_path / lock.NAME).write_text(text)
    assert lock.holder(tmp_path) is None
    with lock.held(tmp_path):
        (tmp_path / lock.NAME).write_text(text)
        assert isinstance(lock.holder(tmp_path), dict)
        with pytest.raises(CommandError, match="in use by"), lock.held(tmp_path):
            pass


def test_where_locks_cannot_be_seen_the_process_is_looked_for(tmp_path, monkeypatch):
    monkeypatch.delattr(lock.fcntl, "F_OFD_GETLK")
    with lock.held(tmp_path):
        assert lock.holder(tmp_path) is not None
    process = os.fork()
    if not process:
        os._exit(0)
    os.waitpid(process, 0)
    (tmp_path / lock.NAME).write_text(json.dumps({"pid": process}))
    assert lock.holder(tmp_path) is None
