"""What people and files said is printed as it is; and an output that is closed stops nothing."""

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from rich.table import Table

from launch.asking import start
from launch.asking.console import Console, printable
from launch.folder import manifest
from launch.folder.agents import Agent, Job
from launch.folder.layout import RunFolder
from launch.jobs import messages, recorder
from launch.jobs.progress import Board
from tests.launch.lives import TASK, live, tiny

__all__ = ["tiny"]

WORDS = ("--seeds=1", "--subgoal_layers=0", "--periods=1", "--workers=1")
HOSTILE = ["[x]", "[/x]", "[red]a[/red]", "[link=file:///]b", ":smile:", "[[", "\\[", "[/]"]
ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize("text", HOSTILE)
def test_markup_is_printed_as_it_is(text):
    output = io.StringIO()
    console = Console(file=output, width=80)
    console.say(text)
    console.print(text)
    table = Table(box=None)
    table.add_column(text)
    table.add_row(text)
    console.print(table)
    assert output.getvalue().split() == text.split() * 4


def test_what_commands_a_terminal_is_shown_and_not_sent():
    assert printable("a\x1b[2Jb\tc\nd é") == "a\\x1b[2Jb\tc\nd é"
    assert printable("\ud800") == "\\ud800"


@pytest.mark.parametrize("name", ["[x]", "[/x]", "a:smile:b"])
def test_a_folder_may_be_named_like_markup(tmp_path, tiny, name):
    status, printed = live(tmp_path / name, *WORDS)
    assert status == 0 and f"{tmp_path / name}/{TASK}/checkpoints: " in printed
    status, printed = live(tmp_path / name, *WORDS, "--periods=2", "--keep_final=false")
    assert status == 0, printed


def test_a_workers_error_may_read_like_markup(tmp_path, tiny):
    """The reason of a failed seed is text of a task's or a library's."""
    output = io.StringIO()
    console, folder = Console(file=output), RunFolder(tmp_path, TASK)
    job = Job(Agent(TASK, 0), (0,))
    folder.path.mkdir()
    record = recorder.Recorder({TASK: folder}, {TASK: manifest.new(TASK, 9, {})}, console)
    record.prepare(TASK, {})
    with Board([job], 8, console) as board:
        for text in HOSTILE:
            record.receive(board, job, messages.Warned(text))
    printed = output.getvalue()
    assert all(f"warning: {job.agent}: {text}\n" in printed for text in HOSTILE)


def closed() -> None:
    os.close(1)
    os.close(2)
    start.standard_streams()  # as every program begins


def nobody_reads() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    os.dup2(writer, 1)
    os.dup2(writer, 2)


def full() -> None:
    disk = os.open("/dev/full", os.O_WRONLY)
    os.dup2(disk, 1)
    os.dup2(disk, 2)


@pytest.mark.parametrize("output", [closed, nobody_reads, full])
def test_a_closed_output_stops_no_training(tmp_path, tiny, output):
    status, _ = live(tmp_path, *WORDS, first=output)
    assert status == 0
    folder = RunFolder(tmp_path, TASK)
    assert folder.has_policy(0, 0) and len(folder.results.read_text().splitlines()) == 3
    assert json.loads(folder.manifest.read_text())["finished"] is not None


def test_who_still_listens_is_told_that_the_output_is_closed(tmp_path, tiny):
    def closed_pipe() -> None:
        reader, writer = os.pipe()
        os.close(reader)
        os.dup2(writer, 1)

    status, printed = live(tmp_path, *WORDS, first=closed_pipe)
    assert status == 0 and printed.count("nobody reads the output any more") == 1


@pytest.mark.slow
def test_a_worker_of_a_launch_without_standard_streams_works(tmp_path):
    script = tmp_path / "launch_one.py"
    script.write_text(
        "import os, pathlib, sys\n"
        "from launch.asking import start\n"
        "start.for_training()\n"
        "from launch.jobs.local import StopSignal, execute\n"
        "from launch.jobs.messages import Hooks\n"
        "from launch.folder.agents import Agent, Job; from tests.launch import fake_jobs\n"
        "if __name__ == '__main__':\n"
        "    kept = open(sys.argv[1], 'w')\n"
        "    assert kept.fileno() > 2\n"
        "    os.write(2, b'into no file of ours')\n"
        "    hooks = Hooks(lambda job: pathlib.Path(sys.argv[1] + '.log'),\n"
        "                  lambda _, m: print(m, file=kept, flush=True))\n"
        "    execute([Job(Agent('a', 0), (7,))], fake_jobs.report_seeds, hooks,\n"
        "            workers=1, stop=StopSignal())\n"
    )
    done = subprocess.run(
        ["sh", "-c", f'exec "{sys.executable}" "{script}" "{tmp_path}/said" <&- >&- 2>&-'],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0
    assert (tmp_path / "said").read_text().split("\n")[:2] == ["Started()", "(7,)"]
