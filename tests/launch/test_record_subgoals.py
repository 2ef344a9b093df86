"""Recorded subgoals are those that were pursued, from proposal to outcome."""

import dataclasses
import json
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest

import hac_suite
import tasks
from analysis.reading.subgoals import load_subgoals
from hac_suite.algorithm.hierarchy import collect
from launch import record_subgoals
from launch.asking import settings
from launch.folder.layout import RunFolder
from launch.jobs import worker
from launch.pictures import subgoal_log
from launch.recording.anatomy import anatomy
from tests.cases import published

TASK, LAYERS, SEED = "pick_place", 2, 3
EPISODES, HORIZONS = 6, (7, 5, 9)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> RunFolder:
    """A run folder with untrained policies of seed 3: flat, and with two subgoal layers."""
    folder = RunFolder(tmp_path_factory.mktemp("runs"), TASK)
    folder.policies.mkdir(parents=True)
    config = hac_suite.Config(test_episodes=1)
    for layers in (0, LAYERS):
        horizons = hac_suite.horizons(tasks.load_vector(TASK, 1).max_steps, layers)
        result = next(
            hac_suite.train(
                lambda n: tasks.load_vector(TASK, n),
                config,
                [SEED],
                subgoal_layers=layers,
                horizons=horizons,
                periods=1,
            )
        )
        metadata = {
            "task": TASK,
            "subgoal_layers": layers,
            "seed": SEED,
            "success_rate": 0.0,
            "config": settings.as_json(config),
        }
        worker.save_policy(result.policies[0], folder.policy(layers, SEED), metadata)
    return folder


class Played(NamedTuple):
    """Episodes of scripted actors, and what was logged of them."""

    log: subgoal_log.SubgoalLog
    steps: np.ndarray
    actors: list
    space: tasks.GoalSpace


@pytest.fixture(scope="module")
def played() -> Played:
    env = tasks.load_vector(TASK, EPISODES)
    # Random subgoals are hardly ever reached where they are stated as finely as the task's.
    space = dataclasses.replace(env.subgoal_space, threshold=10 * env.subgoal_space.threshold)
    env.subgoal_space = space
    random = np.random.default_rng(0)

    def actor(goals: int, outputs: int):  # hops about, but depends on what it is given alone
        weights = random.normal(scale=30, size=(len(env.observation_scale) + goals, outputs))
        return lambda o, g: np.sin(np.hstack([o / env.observation_scale, g]) @ weights)

    dim = space.dim
    actors = [actor(dim, 2), actor(dim, dim), actor(env.goal_space.dim, dim)]
    log = subgoal_log.SubgoalLog(env, HORIZONS)
    return Played(log, _run(env, actors, log), actors, space)


def _run(env: tasks.VectorEnv, actors: list, log: subgoal_log.SubgoalLog) -> np.ndarray:
    """Logs a test episode in each environment; returns their steps [N]."""
    config, seeds = hac_suite.Config(), np.arange(env.num_envs)
    run = collect(env, actors, config, HORIZONS, None, seeds, test=True, on_step=log.on_step)
    return run.steps


def _of(played, episode, level):
    own = [s for s in played.log.subgoals if (s.episode, s.level) == (episode, level)]
    return sorted(own, key=lambda s: s.step)


def test_subgoals_of_a_level_follow_each_other_from_start_to_end(played):
    for episode in range(EPISODES):
        for level in (1, 2):
            own = _of(played, episode, level)
            assert [s.step for s in own] == [0, *(s.end_step for s in own[:-1])]
            assert own[-1].end_step == played.steps[episode]


def test_they_are_what_the_actors_propose_where_the_agent_was(played):
    for s in played.log.subgoals:
        np.testing.assert_array_equal(s.start, played.log.path[s.step][s.episode])
        np.testing.assert_array_equal(s.end, played.log.path[s.end_step][s.episode])
        above = [a for a in _of(played, s.episode, 2) if a.step <= s.step < a.end_step]
        goal = played.log.goal[s.episode] if s.level == LAYERS else above[0].subgoal
        output = played.actors[s.level](s.observation[None], goal[None])[0]
        np.testing.assert_allclose(s.subgoal, played.space.denormalise(output), atol=1e-9)


def test_outcomes_are_what_happened(played):
    for s in played.log.subgoals:
        attempts, last_is_cut = s.end_step - s.step, False
        if s.level == 2:
            below = [b for b in _of(played, s.episode, 1) if s.step <= b.step < s.end_step]
            attempts, last_is_cut = len(below), below[-1].outcome == "cut short"
        assert (s.outcome == "achieved") == played.space.achieved(s.end, s.subgoal)
        if s.outcome == "missed":
            assert attempts == HORIZONS[s.level - 1] and not last_is_cut
        if s.outcome == "cut short":
            above = [a.end_step for a in _of(played, s.episode, 2)]
            assert s.end_step in above and (attempts < HORIZONS[s.level - 1] or last_is_cut)
    outcomes = {(s.level, s.outcome) for s in played.log.subgoals}
    assert outcomes >= {(1, "achieved"), (1, "missed"), (1, "cut short"), (2, "achieved")}


def test_a_diverged_episode_cuts_its_subgoals_short(monkeypatch, played):
    step = tasks.VectorEnv.step

    def breaks(env, actions, mask=None):
        state = step(env, actions, mask)
        env._diverged[1] = True
        return state._replace(diverged=env._diverged.copy())

    monkeypatch.setattr(tasks.VectorEnv, "step", breaks)
    env = tasks.load_vector(TASK, 2)
    anywhere = dataclasses.replace(
        env.subgoal_space, threshold=np.full(env.subgoal_space.dim, 99.0)
    )
    env.subgoal_space = anywhere  # also where the episode broke down
    log = subgoal_log.SubgoalLog(env, HORIZONS)
    _run(env, played.actors, log)
    outcomes = [(s.level, s.end_step, s.outcome) for s in log.subgoals if s.episode == 1]
    assert outcomes == [(2, 1, "cut short"), (1, 1, "cut short")]


def test_the_command_writes_what_the_analysis_reads(folder, tmp_path, capsys):
    words = [f"--policies={folder.policies}", f"--output={tmp_path}/new", f"--episodes={EPISODES}"]
    assert record_subgoals.main(["record", f"--task={TASK}", *words]) == 0
    table_path, anatomy_path = (tmp_path / "new" / n for n in ("subgoals.csv", "anatomy.json"))
    assert capsys.readouterr().out.split() == [str(table_path), str(anatomy_path)]
    points = {"subgoal": ("gripper_x", "rod_z"), "goal": ("rod_x",), "": ("attached",)}
    table = load_subgoals(tmp_path / "new", TASK, points)
    assert set(table["subgoal_layers"]) == set(table["level"]) == {LAYERS}
    assert set(table["episode"]) == set(range(EPISODES))
    assert set(table["outcome"]) <= {"achieved", "missed", "cut short"}
    pd.testing.assert_frame_equal(
        table, table.sort_values(["seed", "episode", "step"], ignore_index=True)
    )
    described = json.loads(anatomy_path.read_text())
    assert [e["subgoal_layers"] for e in described["episodes"]] == [0, LAYERS]
    flat, deep = described["episodes"]
    assert not flat["subgoals"] and {s["level"] for s in deep["subgoals"]} == {1, 2}
    assert len(described["subgoal_space"]["names"]) == len(deep["path"][0]) == 5
    assert "goal_path" not in deep  # subgoals have all dimensions of the end goal


def test_what_only_the_end_goal_has_is_recorded_beside_the_path():
    policy = published("cartpole_swingup", 1)
    played = subgoal_log.replay(hac_suite.Policy.load(policy), 1)
    (episode,) = anatomy([(played, 0)], "cartpole_swingup")["episodes"]
    tip, cart = np.array(episode["path"]), np.array(episode["goal_path"])
    assert cart.shape == (len(tip), 1)
    # The pole is a metre long, and the rail lies at 1.2 metres.
    np.testing.assert_allclose(np.hypot(tip[:, 0] - cart[:, 0], tip[:, 1] - 1.2), 1, atol=2e-3)
    assert np.ptp(cart) > 0.2


def test_attached_is_read_where_it_is_observed():
    column = record_subgoals._condition_columns(TASK)["attached"]
    env = tasks.load_vector(TASK, 64)
    held = env.reset(np.arange(64)).observation[:, column]  # half of the training starts hold it
    achieved = env.reset(np.arange(64)).achieved_subgoal
    gripper, rod = achieved[:, 0:2], achieved[:, 2:4]
    np.testing.assert_array_equal(held, np.linalg.norm(gripper - rod, axis=-1) < 0.1251)
    assert 10 < held.sum() < 54


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        (["--task=pick_plce"], "unknown task 'pick_plce': did you mean 'pick_place'?"),
        (["--task=ur5_reacher"], "holds no policies of ur5_reacher"),
        (["--policies=elsewhere"], "elsewhere does not exist"),
        (["--episodes=0"], "--episodes=0"),
        (["--outptu=a"], "did you mean 'output'?"),
    ],
)
def test_bad_input_is_answered_in_one_line(folder, tmp_path, capsys, words, answer):
    given = ["record", f"--policies={folder.policies}", f"--output={tmp_path}/new", *words]
    assert record_subgoals.main(given) == 2
    printed = capsys.readouterr()
    assert answer in printed.err and printed.err.count("\n") == 1 and not printed.out
    assert not (tmp_path / "new").exists()


def test_a_damaged_policy_is_named_and_nothing_written(folder, tmp_path, capsys):
    damaged = tmp_path / "policies"
    damaged.mkdir()
    stem = folder.policy(LAYERS, SEED)
    (damaged / f"{stem.name}.json").write_text(stem.with_suffix(".json").read_text())
    (damaged / f"{stem.name}.safetensors").write_bytes(b"\x80\x04cos\nsystem\n.")
    words = [f"--task={TASK}", f"--policies={damaged}", f"--output={tmp_path}/new"]
    assert record_subgoals.main(["record", *words]) == 2
    assert f"policy {damaged / stem.name}" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
