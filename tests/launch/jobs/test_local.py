"""Worker processes: whatever one of them does, the others finish and its reason is kept."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

from launch.folder.agents import Agent, Job
from launch.jobs import local
from launch.jobs.local import StopSignal, execute
from launch.jobs.messages import Failed, Finished, Hooks, Started, Warned
from tests.launch import fake_jobs
from tests.launch.launching import forked_workers


def run(tmp_path, jobs, work, workers=2, stop=None):
    """Messages by job; a worker's log is `<tmp_path>/<job>.log`."""
    messages = defaultdict(list)
    execute(
        jobs,
        work,
        Hooks(
            log=lambda job: tmp_path / f"{job.name}.log",
            on_message=lambda job, message: messages[job].append(message),
        ),
        workers=workers,
        stop=stop or StopSignal(),
    )
    return messages


@pytest.fixture
def forked() -> Iterator[None]:
    with forked_workers():
        yield


@pytest.mark.slow
def test_every_job_runs_and_leaves_no_log(tmp_path):
    jobs = [Job(Agent("a", 0), (seed,)) for seed in range(3)]
    messages = run(tmp_path, jobs, fake_jobs.report_seeds)
    for job in jobs:
        started, seeds, finished = messages[job]
        assert isinstance(started, Started) and seeds == job.seeds
        assert isinstance(finished, Finished) and finished.seconds > 0
    assert list(tmp_path.iterdir()) == []


def test_a_dying_worker_is_named_and_the_others_finish(tmp_path, forked):
    expected = {
        "raises": "RuntimeError: the reason",
        "segfaults": "killed by SIGSEGV",
        "killed": "killed by SIGKILL (often: out of memory)",
        "exits": "ended early, with exit status 3",
    }
    jobs = [Job(Agent(name, 0), (0,)) for name in [*expected, "works"]]
    messages = run(tmp_path, jobs, fake_jobs.fail_by_name)
    for job in jobs[:-1]:
        last = messages[job][-1]
        assert isinstance(last, Failed) and expected[job.agent.task] in last.reason
        assert "a line that the worker printed" in (tmp_path / f"{job.name}.log").read_text()
    assert isinstance(messages[jobs[-1]][-1], Finished)
    log = (tmp_path / f"{jobs[0].name}.log").read_text()
    assert "Traceback" in log and "and more of it" in log
    assert "Segmentation fault" in (tmp_path / f"{jobs[1].name}.log").read_text()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_workers(tmp_path, forked, number):
    before = signal.getsignal(number)
    with StopSignal() as stop:
        threading.Timer(1.0, os.kill, (os.getpid(), number)).start()
        start = time.monotonic()
        jobs = [Job(Agent("hangs", 0), (0,)), Job(Agent("works", 0), (0,))]
        messages = run(tmp_path, jobs, fake_jobs.fail_by_name, workers=1, stop=stop)
    assert stop.number == number
    assert time.monotonic() - start < 60
    assert jobs[1] not in messages
    assert signal.getsignal(number) == before


def heard_until_stopped(tmp_path, work) -> list:
    """The messages of a job that is stopped as soon as it says that it trains."""
    heard = []

    def hear(job, message) -> None:
        heard.append(message)
        if message == "training":
            os.kill(os.getpid(), signal.SIGTERM)

    with StopSignal() as stop:
        hooks = Hooks(lambda job: tmp_path / "log", hear)
        execute([Job(Agent("works", 0), (0,))], work, hooks, workers=1, stop=stop)
    return heard


def test_what_workers_warn_of_while_they_are_ended_is_heard(tmp_path, forked):
    heard = heard_until_stopped(tmp_path, fake_jobs.warn_when_told)
    assert heard[:2] == [Started(), "training"] and heard[-1] == Warned("could not save")
    assert len(heard) == 2 + 2000 + 1  # warnings alone


def test_a_worker_that_does_not_stop_in_time_is_ended_with_a_warning(tmp_path, forked, monkeypatch):
    monkeypatch.setattr(local, "GRACE_SECONDS", 0.5)
    heard = heard_until_stopped(tmp_path, fake_jobs.deaf_to_signals)
    assert isinstance(heard[-1], Warned) and "since its last checkpoint is lost" in heard[-1].text


@pytest.mark.slow
def test_a_second_signal_quits_at_once(tmp_path):
    """The first waits for workers to save, and this one takes a minute to."""
    script = (
        "import pathlib, sys; from launch.jobs.local import StopSignal, execute\n"
        "from launch.jobs.messages import Hooks\n"
        "from launch.folder.agents import Agent, Job; from tests.launch import fake_jobs\n"
        "if __name__ == '__main__':\n"
        "    with StopSignal() as stop:\n"
        "        hooks = Hooks(lambda job: pathlib.Path(sys.argv[1]),\n"
        "                      lambda _, m: print(m, flush=True))\n"
        "        execute([Job(Agent('saves', 0), (0,))], fake_jobs.save_for_ever, hooks,\n"
        "                workers=1, stop=stop)\n"
    )
    (tmp_path / "launch_one.py").write_text(script)
    words = [sys.executable, str(tmp_path / "launch_one.py"), str(tmp_path / "log")]
    root = Path(__file__).parents[3]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(root)},
    ) as process:  # fmt: skip
        while "training" not in process.stdout.readline():
            pass
        process.send_signal(signal.SIGINT)
        assert "once more quits at once" in process.stderr.readline() + process.stderr.readline()
        time.sleep(1.0)
        assert process.poll() is None
        start = time.monotonic()
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == -signal.SIGINT
        assert time.monotonic() - start < 20
