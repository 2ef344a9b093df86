"""The Slurm recipe with Slurm's own commands replaced; all else is real."""

import os
import re
import signal
import subprocess
from pathlib import Path

import pytest

from tests.launch.lives import live, outcome

ROOT = Path(__file__).resolve().parents[3]
SMALL = (
    "--task=pendulum_climb", "--seeds=2", "--subgoal_layers=0,1", "--periods=3", "--novideo",
    "--config.episodes_per_period=100", "--config.episodes_per_round=4",
    "--config.test_episodes=4", "--config.updates_per_episode=10",
)  # fmt: skip
COMMANDS = {
    "hostname": "echo 127.0.0.1",  # reached from this machine alone
    # The other node is this machine once more.
    "srun": 'while [[ $1 == --* ]]; do shift; done; exec "$@"',
    "scontrol": 'echo "$@" >> queued_again',
}


@pytest.fixture
def submit(tmp_path):
    """Starts the recipe in a folder where the repository's is `launch`."""
    commands, folder = tmp_path / "commands", tmp_path / "repository"
    commands.mkdir()
    folder.mkdir()
    (folder / "launch").symlink_to(ROOT / "launch")
    if (ROOT / ".venv").exists():
        (folder / ".venv").symlink_to(ROOT / ".venv")
    for name, body in COMMANDS.items():
        (commands / name).write_text(f"#!/bin/bash\n{body}\n")
        (commands / name).chmod(0o755)
    environment = {
        **os.environ,
        "PATH": f"{commands}:{os.environ['PATH']}",
        "MUJOCO_GL": "disabled",
        "OMP_NUM_THREADS": "1",
        "SLURM_SUBMIT_DIR": str(folder),
        "SLURM_JOB_ID": str(os.getpid()),
        "SLURM_JOB_NUM_NODES": "2",
        "SLURM_CPUS_PER_TASK": "1",
        "SLURMD_NODENAME": "first",
    }
    script = ["bash", str(ROOT / "launch" / "slurm.sbatch"), *SMALL, "--out=runs"]

    def start(*words: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [*script, *words],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    return folder, start


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_stopped_before_its_time_limit_it_is_queued_again_and_goes_on(submit, tmp_path):
    folder, start = submit
    first = start()
    assert first.stdout is not None
    for line in first.stdout:
        if re.search("episodes [1-9]", line):
            break
    first.send_signal(signal.SIGTERM)  # to the script alone, as --signal=B:TERM has it
    rest = first.stdout.read()
    assert first.wait() == 128 + signal.SIGTERM, rest
    assert (folder / "queued_again").read_text() == f"requeue {os.getpid()}\n"

    second = start()
    printed, _ = second.communicate()
    assert second.returncode == 0, printed
    assert "seed(s) resume from episode" in printed
    assert (folder / "queued_again").read_text().count("\n") == 1
    assert not list(folder.glob(".ray-token-*"))
    assert not list(Path(os.environ.get("TMPDIR", "/tmp")).glob(f"ray-{os.getpid()}-*"))

    assert live(tmp_path / "local", usual=SMALL)[0] == 0
    assert outcome(folder / "runs") == outcome(tmp_path / "local")


@pytest.mark.slow
def test_what_fails_is_not_queued_again(submit):
    folder, start = submit
    process = start("--seeds=none")
    printed, _ = process.communicate()
    assert process.returncode == 2 and "--seeds" in printed
    assert not (folder / "queued_again").exists() and not list(folder.glob(".ray-token-*"))
