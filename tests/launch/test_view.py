"""The program: wrong commands, the missing extra, and a page that is served and ended."""

import os
import re
import signal
import subprocess
import sys
import urllib.request

import pytest

from launch import view
from launch.pictures import scene
from launch.viewing import live

_PROGRAMS = (["launch/view.py"], ["launch/play.py", "--viewer=auto"])


def test_without_the_extra_one_line_says_how_to_install_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "viser", None)  # as if it were not there
    assert view.main(["launch/view.py"]) == 2
    printed = capsys.readouterr()
    assert "pip install 'hac-suite[viewer]'" in printed.err
    assert printed.err.count("\n") == 1 and not printed.out


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        (["--task=pick_plce"], "did you mean 'pick_place'?"),
        (["--subgoal_layers=7"], "no policy of 7 subgoal layers"),
        (["--seed=77"], "has no policy of 2 subgoal layers, seed 77"),
        (["--run=nowhere"], "nowhere does not exist"),
        (["--port=80"], "--port=80"),
        (["--host=no.such.host.invalid"], "--host=no.such.host.invalid: cannot listen there"),
        (["--host=.."], "--host=..: cannot listen there"),
    ],
)
def test_a_wrong_command_is_answered_in_one_line(words, answer, capsys, monkeypatch, tmp_path):
    pytest.importorskip("viser", exc_type=ImportError)
    monkeypatch.chdir(tmp_path)
    assert view.main(["launch/view.py", *words]) == 2
    printed = capsys.readouterr()
    assert answer in printed.err and printed.err.count("\n") == 1 and not printed.out


@pytest.mark.slow
@pytest.mark.parametrize("program", _PROGRAMS)
def test_a_page_is_served_until_it_is_ended(program):
    """Where there is no display, the window of play is this page as well."""
    pytest.importorskip("viser", exc_type=ImportError)
    displays = ("DISPLAY", "WAYLAND_DISPLAY")
    environment = {name: value for name, value in os.environ.items() if name not in displays}
    process = subprocess.Popen(
        [sys.executable, *program, "--task=pendulum_climb", "--subgoal_layers=1"],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        printed = ""
        assert process.stdout
        while "ssh -L" not in printed:
            line = process.stdout.readline()
            assert line, process.communicate()[1]
            printed += line
        found = re.search(r"view: (http://127\.0\.0\.1:\d+) ", printed)
        assert found
        with urllib.request.urlopen(found[1]) as answer:
            assert b"<html" in answer.read(2000).lower()
    finally:
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=30)
    assert process.returncode == 0 and not errors.strip()


def test_a_task_in_a_file_of_ones_own_is_viewed(tmp_path, monkeypatch):
    """It is found by its path again, and its policies by its name."""
    shown = {}
    monkeypatch.setattr(scene, "load", lambda: None)
    monkeypatch.setattr(
        view.serving, "serve", lambda found, chosen, **rest: shown.update(rest, chosen=chosen)
    )
    file = tmp_path / "mine.py"
    file.write_text(
        "from tasks import registry\n"
        "from tasks.families import pendulum\n"
        "@registry.add(pendulum._CLIMB)\n"
        "def swing(test=False):\n"
        "    return pendulum.pendulum_climb(test)\n"
    )
    folder = tmp_path / "runs" / "mine-swing" / "policies"
    folder.mkdir(parents=True)
    for found in view.policies.published("pendulum_climb"):
        for suffix in (".json", ".safetensors"):
            text = found.path.with_suffix(suffix).read_bytes()
            (folder / f"{found.path.name}{suffix}").write_bytes(
                text.replace(b'"task": "pendulum_climb"', b'"task": "mine-swing"')
            )
    monkeypatch.chdir(tmp_path)
    assert view.main(["launch/view.py", f"--task={file}:swing"]) == 0
    assert shown["chosen"].task == "mine-swing" and shown["word"] == f"{file}:swing"
    assert shown["address"] == ("127.0.0.1", view.serving.PORT)


@pytest.mark.parametrize("name", ["DISPLAY", "WAYLAND_DISPLAY"])
def test_a_display_that_does_not_answer_is_none(monkeypatch, name):
    for each in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(each, raising=False)
    assert not live.has_display()
    monkeypatch.setenv(name, ":987")
    assert not live.has_display()
