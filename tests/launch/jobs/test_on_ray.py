"""Jobs as Ray tasks: the same contract, and jobs that are lost begin again."""

import os
import signal
import subprocess
import sys
import threading
from collections import defaultdict
from pathlib import Path

# Before Ray is imported: clusters of these tests are reached from this machine alone.
os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"

import psutil
import pytest

from analysis.program import CommandError
from launch.folder.agents import Agent, Job
from launch.jobs import on_ray
from launch.jobs.local import StopSignal
from launch.jobs.messages import Failed, Finished, Hooks, Started, WorkerLost
from tests.launch import fake_jobs

pytestmark = pytest.mark.slow  # a cluster takes seconds to start, and so does each of its workers

RUN = Path(__file__).resolve().parents[3] / "launch" / "run.py"


def run(cluster, tmp_path, jobs, work, *, again=None, stop=None, on_message=None):
    """Messages by job; a worker's log is `<tmp_path>/<job>.log`."""
    messages = defaultdict(list)

    def receive(job, message):
        messages[job].append(message)
        if on_message:
            on_message(job, message)

    cluster.execute(
        jobs,
        work,
        Hooks(log=lambda job: tmp_path / f"{job.name}.log", on_message=receive),
        stop=stop or StopSignal(),
        again=again or (lambda job: job),
    )
    return messages


@pytest.fixture(scope="module")
def own():
    with on_ray.Cluster(None, 2) as cluster:
        yield cluster


def test_its_own_cluster_is_reached_from_this_machine_alone(own):
    listening = {
        connection.laddr.ip
        for process in psutil.Process().children(recursive=True)
        for connection in process.net_connections("inet")
        if connection.status == psutil.CONN_LISTEN
    }
    assert listening and listening <= {"127.0.0.1", "::ffff:127.0.0.1", "::1"}


def test_every_job_runs_and_leaves_no_log(own, tmp_path):
    jobs = [Job(Agent("a", 0), (seed,)) for seed in range(2)]
    messages = run(own, tmp_path, jobs, fake_jobs.report_seeds)
    for job in jobs:
        started, seeds, finished = messages[job]
        assert isinstance(started, Started) and seeds == job.seeds
        assert isinstance(finished, Finished) and finished.seconds > 0
    assert list(tmp_path.iterdir()) == []


def test_a_dying_worker_is_named_as_it_is_without_ray_and_the_others_finish(own, tmp_path):
    expected = {
        "raises": "RuntimeError: the reason",
        "segfaults": "killed by SIGSEGV",
        "exits": "ended early, with exit status 3",
    }
    jobs = [Job(Agent(name, 0), (0,)) for name in [*expected, "works"]]
    messages = run(own, tmp_path, jobs, fake_jobs.fail_by_name)
    for job in jobs[:-1]:
        last = messages[job][-1]
        assert isinstance(last, Failed) and expected[job.agent.task] in last.reason
        assert "a line that the worker printed" in (tmp_path / f"{job.name}.log").read_text()
    assert isinstance(messages[jobs[-1]][-1], Finished)


@pytest.mark.parametrize("seconds", [0, 1])
def test_a_signal_ends_the_workers_and_lets_them_save(own, tmp_path, seconds):
    job = Job(Agent(str(tmp_path / "saved"), 0), (0,))
    with StopSignal() as stop:

        def interrupt(_, message):
            if message == "training":  # and then silent: its process waits
                threading.Timer(seconds, os.kill, (os.getpid(), signal.SIGINT)).start()

        run(own, tmp_path, [job], fake_jobs.save_when_told, stop=stop, on_message=interrupt)
    assert stop.number == signal.SIGINT
    assert (tmp_path / "saved").read_text() == "all of it"


def test_a_job_lost_with_its_ray_process_begins_again_where_it_is_told_to(own, tmp_path):
    job = Job(Agent("first_time", 0), (0,), 0, 800)
    work = fake_jobs.kill_ray_process_at_start
    messages = run(own, tmp_path, [job], work, again=lambda job: job._replace(start=300))
    kinds = [type(message).__name__ for message in messages[job]]
    assert kinds == ["Started", "int", "WorkerLost", "Started", "int", "Finished"]
    assert [message for message in messages[job] if isinstance(message, int)] == [0, 300]
    (lost,) = [message for message in messages[job] if isinstance(message, WorkerLost)]
    assert lost.reason == "WorkerCrashedError; resumes elsewhere from episode 300"


def test_a_lost_job_whose_checkpoints_cannot_be_used_fails_with_that_reason(own, tmp_path):
    def unusable(job):
        raise CommandError("they are another run's")

    job = Job(Agent("always", 0), (0,))
    messages = run(own, tmp_path, [job], fake_jobs.kill_ray_process_at_start, again=unusable)[job]
    assert isinstance(messages[-1], Failed) and "they are another run's" in messages[-1].reason


def test_a_job_that_is_lost_every_time_fails_in_the_end(own, tmp_path):
    job = Job(Agent("always", 0), (0,))
    messages = run(own, tmp_path, [job], fake_jobs.kill_ray_process_at_start)[job]
    lost = [message for message in messages if isinstance(message, WorkerLost)]
    assert len(lost) == on_ray.MOST_LOSSES
    assert isinstance(messages[-1], Failed) and "lost 4 times" in messages[-1].reason
    assert (tmp_path / f"{job.name}.log").exists()  # to be kept as the failure's file


def test_a_folder_that_a_machine_does_not_see_fails_the_job_with_that_reason(own, tmp_path):
    job = Job(Agent("a", 0), (0,))
    folder = tmp_path / "shared"
    folder.mkdir()

    stream = on_ray._submit(job, fake_jobs.report_seeds, folder / "x.log")
    (folder / "x.log").unlink()
    folder.rmdir()
    message = on_ray._next(stream)
    assert isinstance(message, Failed) and message.reason.startswith("FileNotFoundError")


def test_no_cluster_at_the_address_is_answered_in_one_line_and_creates_nothing(tmp_path):
    command = [sys.executable, RUN, "--executor=ray", "--ray_address=127.0.0.1:1"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2 and not done.stdout
    assert "--ray_address=127.0.0.1:1: this machine is not part of a Ray cluster" in done.stderr
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
