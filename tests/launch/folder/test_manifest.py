"""What a manifest remembers of files that results depend on, and forgets when it is published."""

import json
import os
from pathlib import Path

import pytest

import tasks
from analysis.program import CommandError
from hac_suite.config import Config
from launch.asking import settings
from launch.folder import manifest
from launch.jobs import on_ray

ROOT = Path(__file__).resolve().parents[3]
TASK = """
from tasks import registry
from tasks.families import pendulum

@registry.add(pendulum._CLIMB)
def swing(test=False):
    task = pendulum.pendulum_climb(test)
    task.root_entity.mjcf_model.option.density = DENSITY
    return task
"""
GYM = """
import gymnasium
from tests.tasks.worlds.toys import Point

class Mine(Point):
    pass

gymnasium.register("Mine/Own-v0", entry_point="NAME:Mine", max_episode_steps=30)
"""


def described(**own) -> manifest.Manifest:
    return {**manifest.new("swing", 7, settings.as_json(Config())), **own}


def refused(old: dict, new: dict) -> str:
    with pytest.raises(CommandError) as raised:
        manifest.check_same(Path("run/manifest.json"), described(**old), described(**new))
    return str(raised.value)


def with_settings(folder: Path, word: str) -> str:
    """A file of settings for the task that the word names."""
    task = tasks.unfitted(word)
    from tasks.worlds import estimates
    from tasks.worlds.settings import as_toml

    found = estimates.settings(task.about, estimates.random_episodes(task.env_of, task.about, 4))
    names = task.about.goal_names, task.about.subgoal_names
    file = folder / "fit.toml"
    file.write_text(as_toml(found, task.word, str(file), names, judged=True))
    return str(file)


def origin(word: str):
    return {"task_file": manifest.task_file(tasks.find(word))}


def test_a_file_of_settings_is_compared_with_the_task_that_it_is_for(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(TASK.replace("DENSITY", "1.0"))
    fit = with_settings(tmp_path, f"{file}:swing")
    before = origin(fit)
    manifest.check_same(Path("run/manifest.json"), described(**before), described(**origin(fit)))
    file.write_text(file.read_text() + "# changed\n")
    assert "task_file is" in refused(before, origin(fit))
    # Manifests of earlier versions did not say.
    earlier = {"task_file": {k: v for k, v in before["task_file"].items() if k != "of"}}
    manifest.check_same(Path("run/manifest.json"), described(**earlier), described(**before))


def test_a_model_that_has_changed_is_another_task(tmp_path):
    found = []
    for density in ("1.0", "2.0"):
        file = tmp_path / f"mine_{density[0]}.py"  # in a process, a file is read once
        file.write_text(TASK.replace("DENSITY", density))
        own = origin(f"{file}:swing")["task_file"]
        found.append({"task_file": {**own, "task": "the same", "sha256": "the same"}})
    assert "task_file is" in refused(*found)


def test_the_source_of_an_environment_without_a_version_is_compared(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    found = []
    for name, more in (("mine_a", ""), ("mine_b", "# changed\n")):
        (tmp_path / f"{name}.py").write_text(GYM.replace("NAME", name) + more)
        own = origin(f"gym:{name}:Mine/Own-v0")["task_file"]
        assert own["package"] == name
        found.append({"task_file": {**own, "package": "", "task": ""}})
    assert "task_file is" in refused(*found)


def test_a_learners_file_is_compared_by_what_it_holds_wherever_it_lies(tmp_path):
    for folder, text in (("a", "1"), ("b", "1"), ("c", "2")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "own.py").write_text(text)

    def of(folder: str) -> dict:
        word = f"{tmp_path / folder / 'own.py'}:Mine"
        config = {**settings.as_json(Config()), "learner": word}
        return {"config": config, "learner_file": manifest.learner_file(word)}

    manifest.check_same(Path("run/manifest.json"), described(**of("a")), described(**of("b")))
    assert "the learner's file is" in refused(of("a"), of("c"))
    assert manifest.learner_file("td3") is None


def test_what_is_published_names_no_folder(tmp_path):
    command = ["python", "launch/run.py", "--out", "/home/me/a", "--seeds=3", "--out=/home/me/b"]
    config = {**settings.as_json(Config()), "learner": "/home/me/own.py:Mine"}
    plain = manifest.portable(described(command=command, config=config))
    assert plain["command"] == ["python", "launch/run.py", "--seeds=3"]
    assert "/home/me" not in json.dumps(plain) and plain["config"]["learner"] == "own.py:Mine"


def test_workers_elsewhere_find_a_learners_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert settings.anywhere(Config()).learner == "ddpg"
    anywhere = settings.anywhere(Config(learner="own.py:Mine"))
    assert anywhere.learner == f"{tmp_path / 'own.py'}:Mine"


def test_workers_elsewhere_search_where_the_launch_does(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", f"mine{os.pathsep}/other")
    assert on_ray._search_path() == os.pathsep.join([str(ROOT), str(tmp_path / "mine"), "/other"])
