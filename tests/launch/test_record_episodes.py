"""What is recorded of episodes is what happened in them, and Q is what the critics say."""

import json
import shlex
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import hac_suite
import tasks
from analysis import explain
from analysis.reading import names
from analysis.report.explanations import recording_command
from hac_suite import policy_files
from hac_suite.types import level_specs
from launch import record_episodes
from launch.asking import settings
from launch.folder import manifest
from launch.folder.layout import RunFolder
from launch.jobs import worker
from launch.pictures import choosing
from launch.pictures.subgoal_log import replay
from tests.launch import line

TASK, LAYERS, EPISODES = "pendulum_climb", 1, 4


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> RunFolder:
    """A run folder with an untrained policy, kept as of two test periods, after recording."""
    folder = filled(tmp_path_factory.mktemp("runs"), TASK)
    words = [f"--task={TASK}", f"--run={folder.path}", f"--episodes={EPISODES}"]
    assert record_episodes.main(["", *words]) == 0
    return folder


def filled(out: Path, word: str) -> RunFolder:
    """A run folder with an untrained policy as of 90 episodes, and kept as of 0 and of 45."""
    task = tasks.find(word)
    folder = RunFolder(out, task.name)
    folder.policies.mkdir(parents=True)
    folder.stages.mkdir()
    config = hac_suite.Config(test_episodes=1)
    horizons = hac_suite.horizons(task.spec.max_steps, LAYERS)
    result = next(
        hac_suite.train(
            task.load_vector, config, [3], subgoal_layers=LAYERS, horizons=horizons, periods=1
        )
    )
    for critic in result.policies[0].critics:  # as if they had learnt that goals differ
        critic.parameters *= 8
    about = {"task": task.name, "subgoal_layers": LAYERS, "seed": 3, "success_rate": 0.0,
             "config": settings.as_json(config)}  # fmt: skip
    worker.save_policy(result.policies[0], folder.policy(LAYERS, 3), about | {"train_episodes": 90})
    for period in (0, 1):
        path = folder.stage(LAYERS, 3, period)
        worker.save_policy(result.policies[0], path, about | {"train_episodes": 45 * period})
    return folder


@pytest.fixture(scope="module")
def policy(folder) -> hac_suite.Policy:
    return hac_suite.Policy.load(folder.policy(LAYERS, 3))


def test_starts_are_those_of_the_episodes(folder, policy):
    table = pd.read_csv(folder.path / names.STARTS)
    played = replay(policy, EPISODES)
    assert table["train_episodes"].tolist() == [90] * EPISODES
    assert table["success"].tolist() == played.stats.success.astype(int).tolist()
    assert table["steps"].tolist() == played.stats.steps.tolist()
    space = tasks.spec(TASK).subgoal_space
    starts = table[[f"start_{name}" for name in space.names]].to_numpy()
    np.testing.assert_allclose(starts, played.path[0], atol=1e-3)


def test_maps_have_every_subgoal_of_every_stage_and_of_the_trained_policy(folder, policy):
    table = pd.read_csv(folder.path / names.MAPS)
    played = replay(policy, EPISODES)
    for stage in (0, 45, 90):
        own = table[table["train_episodes"] == stage]
        assert len(own) == len(played.subgoals)
        assert own["outcome"].value_counts().to_dict() == (
            pd.Series([s.outcome for s in played.subgoals]).value_counts().to_dict()
        )
    assert set(table["train_episodes"]) == {0, 45, 90}


def test_maps_have_a_policy_once_that_was_kept_of_the_last_period(folder, tmp_path):
    run = RunFolder(tmp_path, TASK)
    shutil.copytree(folder.policies, run.policies)
    run.stages.mkdir()
    for kept, whole in zip(
        policy_files.paths(run.stage(LAYERS, 3, 2)),
        policy_files.paths(run.policy(LAYERS, 3)),
        strict=True,
    ):
        shutil.copy(whole, kept)
    assert record_episodes.main(["", f"--task={TASK}", f"--run={run.path}", "--episodes=2"]) == 0
    table = pd.read_csv(run.path / names.MAPS)
    played = replay(hac_suite.Policy.load(run.policy(LAYERS, 3)), 2)
    assert len(table) == len(played.subgoals) and set(table["train_episodes"]) == {90}


def test_failures_are_whole_episodes(folder, policy):
    record = json.loads((folder.path / names.FAILED_EPISODES).read_text())
    played = replay(policy, EPISODES)
    assert not played.stats.success.any()  # it is untrained
    assert [episode["episode"] for episode in record["episodes"]] == [0, 1, 2, 3]
    for index, episode in enumerate(record["episodes"]):
        assert not episode["success"] and len(episode["path"]) == played.stats.steps[index] + 1


def test_values_are_what_the_critics_say_of_each_goal(folder, policy):
    (agent,) = json.loads((folder.path / names.VALUES).read_text())["agents"]
    env = tasks.load_vector(TASK, 1)
    state = env.reset(choosing.seeds_of_tests(policy)[:1], test=True)
    levels = level_specs(env, policy.horizons)
    config = settings.to_config(policy.metadata["config"])
    assert [level["level"] for level in agent["levels"]] == [0, 1]
    for level in agent["levels"]:
        goals = [state.achieved_subgoal.copy(), state.desired_goal.copy()]
        row, column = 30, 7
        own = goals[level["level"]]
        own[0, :2] = level["axes"][0][column], level["axes"][1][row]
        said = hac_suite.q_values(policy, levels, config, state.observation, goals)
        assert level["q"][row][column] == pytest.approx(said[level["level"]][0], abs=0.02)
        assert np.ptp(level["q"]) > 0


def test_a_policy_without_critics_has_no_values(folder, policy, tmp_path):
    bare = RunFolder(tmp_path, TASK)
    shutil.copytree(folder.policies, bare.policies)
    without = hac_suite.Policy(policy.networks, policy.horizons, policy.metadata)
    for file in policy_files.paths(bare.policy(LAYERS, 3)):
        file.unlink()
    worker.save_policy(without, bare.policy(LAYERS, 3), policy.metadata)
    words = [f"--task={TASK}", f"--run={bare.path}", "--episodes=1"]
    assert record_episodes.main(["", *words]) == 0
    assert json.loads((bare.path / names.VALUES).read_text())["agents"] == []
    assert set(pd.read_csv(bare.path / names.MAPS)["train_episodes"]) == {90}  # no stages: the last


def test_a_folder_without_policies_is_answered_in_one_line(tmp_path, capsys):
    assert record_episodes.main(["", f"--run={tmp_path}"]) == 2
    assert "holds no policies of pick_place" in capsys.readouterr().err


def test_the_published_policies_are_not_recorded_where_others_may_be_trained(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    words = ["", f"--task={TASK}", "--episodes=1"]
    assert record_episodes.main(words) == 2
    printed = capsys.readouterr().err
    assert f"runs/{TASK} does not exist; give the run folder as --run, or" in printed
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_records_of_the_published_policies_are_explained(tmp_path):
    words = [f"--task={TASK}", "--episodes=1", f"--output={tmp_path}"]
    assert record_episodes.main(["", *words]) == 0
    assert explain.main(["", str(tmp_path)]) == 0
    assert (tmp_path / "values.png").is_file()


def test_a_task_of_ones_own_on_a_line_is_recorded_by_the_command_that_is_named(tmp_path, capsys):
    folder = filled(tmp_path, line.WORD)
    origin = manifest.task_file(tasks.find(line.WORD))
    about = manifest.new(line.TASK, 25, {}) | {"task_file": origin}
    folder.manifest.write_text(json.dumps(about))
    python, program, *words = shlex.split(recording_command(line.TASK, folder.path))
    assert (python, program) == ("python", "launch/record_episodes.py")
    assert f"--task={line.WORD}" in words  # the name alone is known to this process only
    assert record_episodes.main(["", *words, "--episodes=2"]) == 0
    capsys.readouterr()
    assert explain.main(["", str(folder.path)]) == 0
    assert capsys.readouterr().out.split() == [str(folder.path / "starts.png")]
