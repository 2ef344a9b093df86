"""The command that records a task's episodes names the task by a word that a new process knows."""

import json
import shlex

import pytest

from analysis.reading.subgoals import recording_command
from analysis.report import explanations

GYM = 'gym:Pendulum-v1?{"goal":"obs[0:2]=1,0"}'
FILE = "path/to/my lever.py:lift"


@pytest.mark.parametrize(
    ("manifest", "word"),
    [
        ({"task_file": {"task": GYM}, "command": ["python", "run.py", "--task=gym:X-v1"]}, GYM),
        ({"task_file": {"task": "my lever.py:lift"}, "command": ["x", f"--task={FILE}"]}, FILE),
        ({"task_file": {"task": "a.toml"}, "command": ["x", "--task", "of/a.toml"]}, "of/a.toml"),
        ({"task_file": {"task": "a.toml"}, "command": ["x", "--task=b", "-task=c.toml"]}, "c.toml"),
        ({"task_file": {"task": "a.toml"}, "command": ["x", "--task"]}, "name"),
        ({"task_file": {"task": "a.toml"}}, "name"),
        ({"command": ["python", "launch/run.py", "--task=all"]}, "name"),  # of the suite
        ({"task_file": [], "command": {}}, "name"),  # somebody edited it
    ],
)
def test_the_word_of_a_task_of_ones_own_is_the_manifests(tmp_path, manifest, word):
    folder = tmp_path / "a folder"
    folder.mkdir()
    (folder / "manifest.json").write_text(json.dumps(manifest))
    subgoals, episodes = (
        shlex.split(command("name", folder))
        for command in (recording_command, explanations.recording_command)
    )
    assert subgoals[2:] == [f"--task={word}", f"--output={folder}"]
    assert episodes[2:] == [f"--task={word}", f"--run={folder}"]
