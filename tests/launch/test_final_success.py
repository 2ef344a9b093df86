"""First touch and the episode's end: what is counted on agents that stay, and that pass by."""

import numpy as np
import pytest

import hac_suite
import tasks
from hac_suite.algorithm import exploration
from launch import final_success
from launch.folder import policies
from launch.folder.layout import RunFolder
from launch.jobs import worker

TASK = "pendulum_climb"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run folder with the published policies of a task, under two seeds."""
    folder = RunFolder(tmp_path_factory.mktemp("runs"), TASK)
    folder.policies.mkdir(parents=True)
    for layers in (0, 1):
        policy = hac_suite.Policy.load(next(worker_files(layers)))
        for seed in (0, 1):
            own = {**policy.metadata, "seed": seed}
            worker.save_policy(policy, folder.policy(layers, seed), own)
    return folder


def worker_files(layers):
    return (own.path for own in policies.published(TASK) if own.subgoal_layers == layers)


def test_the_first_touch_is_what_a_test_period_counts(run):
    held = final_success.measure(run.policy(1, 0), 8)
    policy = hac_suite.Policy.load(run.policy(1, 0))
    seeds = exploration.episode_seeds(0, exploration.Purpose.TEST_EPISODE, 0, 8)
    stats = hac_suite.run_episodes(tasks.load_vector(TASK, 8), policy, seeds)
    assert held.touched == stats.success.mean() > 0.5
    # It touches the peak in passing, and falls: at the end it is elsewhere.
    assert held.at_end < held.touched and 0 < held.after < 0.9


def test_the_table_has_a_line_for_each_agent(run, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    assert final_success.main(
        ["", f"--task={TASK}", f"--run={run.path}", "--episodes=2"]) == 0  # fmt: skip
    printed = capsys.readouterr().out
    assert "0 subgoal layers" in printed and "1 subgoal layer " in printed
    assert printed.count("%") >= 4


def test_nothing_changes_for_who_plays_in_it():
    env = final_success._Unending(tasks.load_vector(TASK, 2))
    state = env.reset(np.arange(2))
    assert not env.goal_space.achieved(state.desired_goal, state.desired_goal).any()
    assert env.goal_space.dim == 2 and env.num_envs == 2
    env._env._goals[:] = env.step(np.zeros((2, 1))).achieved_goal
    env.step(np.zeros((2, 1)))
    assert env.held[-1].all()


def test_a_folder_without_policies_is_answered_in_one_line(tmp_path, capsys):
    assert final_success.main(["", f"--task={TASK}", f"--run={tmp_path}"]) == 2
    assert "holds no policies" in capsys.readouterr().err
