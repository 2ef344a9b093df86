"""Killed at any moment, and again: nothing is lost, and the end is that of an uninterrupted run."""

import contextlib
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pytest

from launch.folder import results
from launch.folder.agents import Agent, Job
from launch.folder.layout import RunFolder
from launch.jobs import local, messages
from tests.launch import fake_jobs
from tests.launch.lives import (
    TASK,
    fallen_back,
    in_one_process,
    live,
    outcome,
    standings,
    tiny,
    wait_for,
    wait_until_gone,
)  # fmt: skip

__all__ = ["tiny"]

FAMILY = "HAC_SUITE_TEST_FAMILY"  # a variable of the environment
RUN = Path(__file__).resolve().parents[3] / "launch" / "run.py"
REAL = (
    "--task=pendulum_climb", "--seeds=2", "--subgoal_layers=1", "--periods=4", "--novideo",
    "--config.episodes_per_period=24", "--config.test_episodes=4", "--config.batch_size=64",
    "--config.updates_per_episode=2",
)  # fmt: skip


class Storm(NamedTuple):
    """What was seen while killing."""

    kills: int
    half_written: int  # kills that left a file half written
    lost: int  # checkpoints or finished runs that were there before a kill and not after


def storm(out: Path, kills: int, chance: random.Random, agents: int = 3, seeds: int = 3) -> Storm:
    """Launches and kills until an experiment is finished, and another, until that is enough."""
    layers = ",".join(map(str, range(agents)))
    words = (f"--subgoal_layers={layers}", f"--seeds={seeds}", "--periods=3")
    start = time.monotonic()
    status, printed = live(out / "whole", *words)
    whole = time.monotonic() - start  # a fork of a large process starts slowly
    assert status == 0, printed
    expected = outcome(out / "whole")
    assert len(expected["rows"]) == agents * seeds * 4 and set(
        standings(out / "whole").values()
    ) == {36}
    killed = half_written = lost = experiments = 0
    while killed < kills:
        here, before, status = out / str(experiments), dict[str, int](), -9
        lives = 0
        while status:
            lives += 1
            assert lives < 100, "killed again and again, it gets nowhere"
            workers = f"--workers={chance.randint(1, 4)}"  # groups the seeds in other ways
            status, printed = live(here, *words, workers, kill_after=chance.uniform(0, whole))
            assert status in (0, -signal.SIGKILL), printed
            assert "damaged" not in printed and "from nothing" not in printed
            killed += status != 0
            half_written += any(here.rglob(".*.tmp*"))
            now = standings(here) | finished(here)
            lost += fallen_back(before, now)
            before = now
        assert outcome(here) == expected, experiments
        experiments += 1
    return Storm(killed, half_written, lost)


def finished(out: Path) -> dict[str, int]:
    """The last episode of each run that has its policy and the rows of all periods."""
    folder, found = RunFolder(out, TASK), {}
    rows = [(row["subgoal_layers"], row["seed"]) for row in results.read(folder.results)[0]]
    for run in {(layer, seed) for layer in range(3) for seed in range(3)}:
        if folder.has_policy(*run) and rows.count((str(run[0]), str(run[1]))) == 4:
            found[folder.checkpoints_of(*run).name] = 36
    return found


@pytest.mark.slow
def test_killed_at_random_moments(tmp_path, tiny):
    assert storm(tmp_path, 3, random.Random(1), agents=1, seeds=2).lost == 0


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_storm_of_kills_loses_nothing(tmp_path, tiny):
    seen = storm(tmp_path, 200, random.Random(2))
    print(seen)
    assert seen.kills >= 200 and seen.lost == 0
    assert seen.half_written >= 5  # many came in the middle of a save


def start(folder: Path, words: Sequence[str] = REAL) -> subprocess.Popen:
    """`launch/run.py` in a process group of its own; all its descendants know the folder."""
    return subprocess.Popen(
        [sys.executable, RUN, *words],
        cwd=folder,
        env={**os.environ, FAMILY: str(folder)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def descendants(folder: Path) -> list[str]:
    """What runs that a launch in the folder has begun, in whatever process group."""
    mark, found = f"{FAMILY}={folder}".encode(), []
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # it has just ended, or is another user's
            if mark in (process / "environ").read_bytes().split(b"\0"):
                found.append((process / "cmdline").read_text().replace("\0", " "))
    return found


def finish(launched: subprocess.Popen) -> str:
    printed, _ = launched.communicate(timeout=280)
    assert launched.returncode == 0, printed
    return printed


def wait_for_checkpoint(folder: Path, after: int = 0, seconds: float = 120) -> int:
    """Waits until a run stands beyond an episode; returns where."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        stands = [int(file.stem) for file in folder.glob("runs/*/checkpoints/*/*.json")]
        if max(stands, default=0) > after:
            return max(stands)
        time.sleep(0.02)
    raise TimeoutError(f"no checkpoint beyond episode {after}")


@pytest.mark.slow
def test_a_worker_dies_with_its_launch_whatever_it_is_at(tmp_path):
    reader, writer = os.pipe()
    launched = os.fork()
    if not launched:
        try:
            os.setsid()
            local.execute(
                [Job(Agent("hangs", 0), (0,))],
                fake_jobs.fail_by_name,
                messages.Hooks(
                    log=lambda job: tmp_path / "log",
                    on_message=lambda job, message: message == "started" and os.write(writer, b"1"),
                ),
                workers=1,
                stop=local.StopSignal(),
            )
        finally:
            os._exit(1)  # not the tests again
    assert os.read(reader, 1) == b"1"
    os.kill(launched, signal.SIGKILL)
    os.waitpid(launched, 0)
    wait_until_gone(launched)


def uninterrupted(out: Path, monkeypatch: pytest.MonkeyPatch) -> dict:
    """What real training leaves that nothing interrupts."""
    in_one_process(monkeypatch)
    status, printed = live(out, usual=REAL)
    assert status == 0, printed
    return outcome(out)


@pytest.mark.slow
def test_a_killed_launch_goes_on_in_real_processes(tmp_path, monkeypatch):
    killed = start(tmp_path)
    episode = wait_for_checkpoint(tmp_path)
    killed.kill()  # the launch alone: its workers notice
    killed.communicate()
    wait_until_gone(killed.pid)
    going_on = start(tmp_path)
    # Saved at once by a signal, with an exit status of its own; then to the end.
    later = wait_for_checkpoint(tmp_path, after=episode)
    going_on.send_signal(signal.SIGTERM)
    printed, _ = going_on.communicate(timeout=60)
    assert going_on.returncode == 128 + signal.SIGTERM, printed
    assert "resume from episode" in printed and "stopping: unfinished runs are saved" in printed
    wait_until_gone(going_on.pid)
    saved = wait_for_checkpoint(tmp_path, after=later - 1)
    printed = finish(start(tmp_path))
    assert f"resume from episode {saved}" in printed or f", {saved}" in printed
    left = outcome(tmp_path / "runs")
    assert len(left["rows"]) == 2 * 5
    assert left == uninterrupted(tmp_path / "whole", monkeypatch)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ("words", "experiments", "seconds"),
    [
        pytest.param(REAL, 5, 14, id="plain"),
        pytest.param((*REAL, "--video"), 3, 30, id="drawn", marks=pytest.mark.requires_gl),
        pytest.param((*REAL, "--executor=ray"), 3, 25, id="ray"),
    ],
)
def test_real_launches_killed_at_random_moments(tmp_path, monkeypatch, words, experiments, seconds):
    """The launch, a worker, or all of them at once, as a lack of memory or a power cut would."""
    expected, chance, kills = uninterrupted(tmp_path / "whole", monkeypatch), random.Random(3), 0
    for number in range(experiments):
        folder = tmp_path / str(number)
        folder.mkdir()
        for _ in range(5):
            launched = start(folder, words)
            time.sleep(chance.uniform(1, seconds))
            victim = chance.choice(["launch", "worker", "all"])
            if launched.poll() is None:
                kills += 1
                _kill(launched, victim)
            printed, _ = launched.communicate(timeout=200)
            assert "damaged" not in printed and "Traceback" not in printed, printed
            # Ray's own agents try for a minute to reach a head that was killed as it began.
            wait_for(lambda: not descendants(folder), 150)  # noqa: B023
        finish(start(folder, words))
        assert outcome(folder / "runs") == expected
        assert not list((folder / "runs").rglob(".*.tmp*"))
    print(kills, "kills")
    assert kills >= 3 * experiments


def _kill(launched: subprocess.Popen, victim: str) -> None:
    if victim == "all":
        os.killpg(launched.pid, signal.SIGKILL)
        return
    children = Path(f"/proc/{launched.pid}/task/{launched.pid}/children").read_text().split()
    chosen = int(children[-1]) if victim == "worker" and children else launched.pid
    os.kill(chosen, signal.SIGKILL)
