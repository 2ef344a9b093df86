"""Peers are trained for what their curves say, and tested as our agents are."""

import dataclasses
from typing import Any

import numpy as np
import pytest
import torch

import hac_suite
import tasks
from hac_suite.algorithm.hierarchy import collect
from hac_suite.config import PAPER
from hac_suite.training import loop

pytest.importorskip("stable_baselines3")

from analysis.statistics.peers import COLUMNS, load_curve
from tests.bench.peers import __main__ as program
from tests.bench.peers import agents, curves, training

pytestmark = pytest.mark.slow  # strangers' learners, which take seconds to begin with

TASK = "pendulum_climb"


@pytest.fixture(autouse=True)
def _short_tests_and_small_buffers(monkeypatch):
    """Two test episodes of a few steps; the zoo's buffer of a million takes a while to make."""
    whole = training.Tests.__init__

    def few(self, task, seed, episodes=2):
        whole(self, task, seed, episodes)
        self._env.max_steps = 5

    monkeypatch.setattr(training.Tests, "__init__", few)
    monkeypatch.setitem(agents._ZOO, "buffer_size", 2000)


@pytest.fixture
def counted(monkeypatch):
    """Steps of the training environment, and gradient steps, as they are made."""
    counts = {"steps": 0, "updates": 0}
    make, environment = agents.make, agents._environment

    def counting(of, function):
        def call(*args, **kwargs):
            counts[of] += 1
            return function(*args, **kwargs)

        return call

    def make_environment(task):
        env = environment(task)
        bare: Any = env.unwrapped
        bare.step = counting("steps", bare.step)
        return env

    def make_agent(*args):
        model = make(*args)
        model.critic.optimizer.register_step_post_hook(counting("updates", lambda *_: None))
        return model

    monkeypatch.setattr(agents, "_environment", make_environment)
    monkeypatch.setattr(agents, "make", make_agent)
    return counts


def _at_tests(monkeypatch, counts) -> list[dict[str, int]]:
    """What had been counted by each test."""
    seen, whole = [], training.Tests.success

    def success(self, act):
        seen.append(dict(counts))
        return whole(self, act)

    monkeypatch.setattr(training.Tests, "success", success)
    return seen


@pytest.mark.parametrize("agent", list(agents.AGENTS))
def test_by_our_settings_an_episode_has_its_steps_and_its_updates(agent, counted, monkeypatch):
    seen = _at_tests(monkeypatch, counted)
    rows = training.train(agent, "ours20", TASK, 3, episodes=3, minutes=9, test_every=2)
    assert [row["train_episodes"] for row in rows] == [0, 2, 3]
    assert [row["train_steps"] for row in rows] == [now["steps"] for now in seen]
    assert [now["updates"] for now in seen] == [0, 40, 60]
    assert 0 == rows[0]["core_minutes"] < rows[1]["core_minutes"] < rows[2]["core_minutes"]
    assert {row["test_episodes"] for row in rows} == {2} and tuple(rows[0]) == COLUMNS


@pytest.mark.parametrize("agent", list(agents.AGENTS))
def test_by_the_zoos_settings_each_step_after_the_first_thousand_has_an_update(
    agent, counted, monkeypatch
):
    seen = _at_tests(monkeypatch, counted)
    rows = training.train(agent, "zoo", TASK, 3, episodes=4, minutes=9, test_every=2)
    assert [row["train_episodes"] for row in rows] == [0, 2, 4]
    assert [row["train_steps"] for row in rows] == [now["steps"] for now in seen]
    assert seen[-1]["steps"] > 1000 and seen[-1]["updates"] == seen[-1]["steps"] - 1000


def test_training_ends_with_its_core_minutes_and_the_time_of_tests_does_not_count(monkeypatch):
    clock = {"now": 0.0}
    monkeypatch.setattr(training.time, "process_time", lambda: clock["now"])

    def slow(self, act):
        clock["now"] += 600.0
        return np.zeros(2, bool)

    monkeypatch.setattr(training.Tests, "success", slow)
    step = agents.GoalEnv.step

    def timed(self, action):
        clock["now"] += 0.03
        return step(self, action)

    monkeypatch.setattr(agents.GoalEnv, "step", timed)
    rows = training.train("td3", "ours20", TASK, 3, episodes=99, minutes=0.2, test_every=1)
    expected = [round(0.03 / 60 * row["train_steps"], 4) for row in rows]
    assert [row["core_minutes"] for row in rows] == pytest.approx(expected, abs=1e-4)
    assert rows[-2]["core_minutes"] < 0.2 <= rows[-1]["core_minutes"]
    assert len(rows) >= 3


def test_the_test_episodes_are_those_of_our_agents(monkeypatch):
    monkeypatch.undo()
    config = dataclasses.replace(PAPER, test_episodes=5)
    make = lambda n: tasks.load_vector(TASK, n)  # noqa: E731
    ours = loop.Training(make, config, (104,), (make(1).max_steps,), "cpu")
    tests = training.Tests(TASK, 104, 5)
    np.testing.assert_array_equal(tests.seeds, ours.test_seeds)
    assert len(training.Tests(TASK, 104).seeds) == 64


def test_a_policy_is_judged_as_ours_are(monkeypatch):
    """Goals close by, so that some episodes end well and some do not."""
    monkeypatch.undo()
    tests = training.Tests("ur5_reacher", 7, 12)
    weights = np.random.default_rng(3).normal(size=(100, 100))

    def actor(observation, goal):
        seen = np.concatenate([observation, goal], axis=1)
        return np.tanh(seen @ weights[: seen.shape[1], : len(tests._env.action_low)])

    env = tests._env
    near = dataclasses.replace(env.goal_space, threshold=env.goal_space.threshold * 8)
    env.goal_space, env.max_steps = near, 60
    theirs = tests.success(lambda seen: actor(seen["observation"], seen["desired_goal"]))
    run = collect(env, [actor], PAPER, (60,), None, tests.seeds, test=True)
    np.testing.assert_array_equal(theirs, run.success)
    assert 0 < theirs.sum() < 12


def test_the_zoos_observations_are_normalised_in_tests_and_left_as_they_are_by_them():
    model = agents.make("sac", "zoo", TASK, 3)
    scaler = model.get_vec_normalize_env()
    scaler.obs_rms["observation"].mean[:] = 100.0
    before = {key: (stats.mean.copy(), stats.count) for key, stats in scaler.obs_rms.items()}
    curve = training.Curve(training.Tests(TASK, 3), 1, 1, 1)
    curve.init_callback(model)
    seen = {}
    model.predict = lambda observation, deterministic: (
        seen.update(observation)
        or (
            np.zeros((2, 1)),
            deterministic,
        )
    )
    curve._test(0.0)
    assert (seen["observation"] == -scaler.clip_obs).all()  # 100 deviations below the mean
    for key, (mean, count) in before.items():
        assert scaler.obs_rms[key].count == count
        np.testing.assert_array_equal(scaler.obs_rms[key].mean, mean)


def test_our_settings_show_the_networks_what_ours_see():
    env = tasks.load_vector("pick_place", 4)
    step = env.reset(np.arange(4))
    model = agents.make("td3", "ours40k2", "pick_place", 0)
    shown = {
        "observation": step.observation,
        "achieved_goal": step.achieved_goal,
        "desired_goal": step.desired_goal,
    }
    tensors = {key: torch.as_tensor(value, dtype=torch.float32) for key, value in shown.items()}
    features = model.actor.features_extractor(tensors).numpy()
    expected = np.concatenate(
        [
            env.goal_space.normalise(step.achieved_goal),
            env.goal_space.normalise(step.desired_goal),
            step.observation / env.observation_scale,
        ],
        axis=1,
    )
    np.testing.assert_allclose(features, expected, rtol=1e-4, atol=1e-5)
    config = hac_suite.PRESETS["suite"]
    widths = [p.shape[0] for p in model.actor.mu.parameters() if p.ndim == 2]
    assert widths == [*config.hidden_sizes, len(env.action_low)]
    assert (model.gradient_steps, model.replay_buffer.n_sampled_goal) == (40, 2)


def test_a_fifth_of_the_actions_is_uniform_and_stored_as_done():
    own = np.full((1, 2), 0.25, np.float32)
    random = np.random.default_rng(0)
    sample = agents.sometimes_random(lambda *_: (own, own), 0.2, random)
    drawn = [sample(0, None, 1) for _ in range(4000)]
    assert all(action is stored and action.dtype == np.float32 for action, stored in drawn)
    others = np.array([action[0] for action, _ in drawn if action is not own])
    assert len(others) / 4000 == pytest.approx(0.2, abs=0.03)
    assert np.abs(others.mean(0)).max() < 0.1 and others.std(0) == pytest.approx(3**-0.5, abs=0.05)


# -- Files


def _fake(trained):
    def train(agent, settings, task, seed, *, episodes, minutes, test_every):
        trained.append((agent, seed, episodes))
        row = {"task": task, "agent": agent, "settings": settings, "seed": seed}
        numbers = {"train_steps": 10, "core_minutes": 1.0, "success_rate": 0.5, "test_episodes": 2}
        return [{**row, "train_episodes": episodes, **numbers}]

    return train


def test_what_is_finished_is_not_trained_again(tmp_path, monkeypatch, capsys):
    trained: list[tuple] = []
    monkeypatch.setattr(training, "train", _fake(trained))
    command = [f"--task={TASK}", "--agent=sac,td3", "--settings=ours20", f"--output={tmp_path}"]
    program.main([*command, "--seeds=100-101", "--episodes=7"])
    assert trained == [("sac", 100, 7), ("td3", 100, 7), ("sac", 101, 7), ("td3", 101, 7)]
    before = {path: path.read_text() for path in tmp_path.iterdir()}
    assert len(before) == 4
    program.main([*command, "--seeds=100-102", "--episodes=7"])
    assert trained[4:] == [("sac", 102, 7), ("td3", 102, 7)]
    assert all(path.read_text() == text for path, text in before.items())
    assert f"{TASK}-sac-ours20-100: is there already: 50%" in capsys.readouterr().out
    program.main([*command, "--seeds=100-100", "--episodes=9"])  # more of it: trained anew
    assert trained[6:] == [("sac", 100, 9), ("td3", 100, 9)]
    program.main([*command, "--seeds=100-100", "--episodes=12", "--minutes=1"])  # as many minutes
    assert len(trained) == 8


def test_a_training_that_breaks_off_leaves_nothing_behind(tmp_path, monkeypatch):
    def broken(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(training, "train", broken)
    with pytest.raises(KeyboardInterrupt):
        program.main([f"--task={TASK}", f"--output={tmp_path}"])
    assert not list(tmp_path.iterdir())


def test_a_curve_comes_back_as_it_was_written(tmp_path):
    rows = training.train("td3", "ours20k2", TASK, 5, episodes=1, minutes=9)
    path = tmp_path / f"{curves.Run(TASK, 'td3', 'ours20k2', 5).name}.csv"
    curves.write(path, rows)
    assert load_curve(path).to_dict("records") == rows
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize(
    "word, said",
    [
        ("--agent=ppo", "give one or more of ddpg,sac,td3"),
        ("--task=pendulum", "give one or more of pendulum_climb"),
        ("--seeds=x", "give a number of seeds"),
        ("--episodes=0", "at least 1"),
    ],
)
def test_a_wrong_word_is_answered_with_the_right_ones(word, said, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        program.main([word, f"--output={tmp_path / 'new'}"])
    assert stop.value.code == 2 and said in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
