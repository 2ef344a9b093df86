"""The same motion in more decisions: what stays as in the suite, and what a held action does."""

import sys
from pathlib import Path

import numpy as np
import pytest
from dm_control import composer

import hac_suite
import tasks
from tasks import vector
from tests.tasks import scripted

_FILE = Path(__file__).resolve().parents[2] / "tasks" / "families" / "depth.py"
_SUITE = {"ur5_reacher": 200, "pick_place": 300}  # decisions of the suite's tasks
_BOTH = pytest.mark.parametrize("name", _SUITE)
_RATES = pytest.mark.parametrize("rate", [1, 2, 4])
_SEEDS = np.arange(16)
_STEPS = 60  # of the suite's


def _find(name, rate):
    return tasks.find(f"{_FILE}:{name}_{rate * _SUITE[name]}")


def _rollout(env, rate, *, test=True):
    """Readings after each of the task's own steps, [rate * _STEPS + 1, N, R].

    A controller that solves the suite's task acts at the suite's rate, so that the robots get
    somewhere; each of its actions is held for `rate` steps.
    """
    control = scripted.SOLUTIONS[_name(env)]
    step = env.reset(_SEEDS, test=test)
    readings = [env._readings.copy()]
    for _ in range(_STEPS):
        actions = control(env, step)
        for _ in range(rate):
            step = env.step(actions)
            readings.append(env._readings.copy())
    assert not env._diverged.any()
    return np.array(readings)


def _name(env):
    return next(name for name in _SUITE if name in env.name)


def test_the_rule_for_t_by_hand():
    attempts = sys.modules[_find("ur5_reacher", 1).factory.__module__].attempts
    assert attempts((200,), 4) == (800,)
    assert attempts((15, 15), 1) == (15, 15)
    assert attempts((15, 15), 4) == (60, 15)
    assert attempts((6, 6, 6), 2) == (12, 6, 6)
    assert attempts((30, 10), 2) == (60, 10)


@_BOTH
def test_at_the_suite_s_rate_agents_have_the_suite_s_t(name):
    suite, found = tasks.spec(name), _find(name, 1).spec
    for layers in range(3):
        assert hac_suite.horizons(found.max_steps, layers, found.horizons) == hac_suite.horizons(
            suite.max_steps, layers, suite.horizons
        )


@_BOTH
@_RATES
def test_a_goal_of_any_level_is_for_as_many_seconds_at_every_rate(name, rate):
    coarse, fine = _find(name, 1).spec, _find(name, rate).spec
    for layers in range(3):
        spans = [
            spec.control_timestep
            * np.cumprod(hac_suite.horizons(spec.max_steps, layers, spec.horizons))
            for spec in (coarse, fine)
        ]
        np.testing.assert_allclose(*spans, rtol=1e-12)
        assert spans[1][-1] >= fine.control_timestep * fine.max_steps - 1e-9


@pytest.mark.slow
@_BOTH
@_RATES
def test_only_the_decisions_differ(name, rate):
    suite, found = tasks.spec(name), _find(name, rate)
    fine = found.spec
    assert found.name == f"depth-{name}_{rate * _SUITE[name]}" and found.name not in tasks.ALL
    assert fine.max_steps == rate * suite.max_steps
    assert fine.control_timestep * rate == suite.control_timestep
    assert fine.goal_space is suite.goal_space and fine.subgoal_space is suite.subgoal_space
    assert fine.observation == suite.observation
    np.testing.assert_array_equal(fine.action_high, suite.action_high)
    for test in (False, True):
        ours = found.load_vector(_SEEDS.size).reset(_SEEDS, test=test)
        theirs = tasks.load_vector(name, _SEEDS.size).reset(_SEEDS, test=test)
        for mine, other in zip(ours, theirs, strict=True):
            np.testing.assert_array_equal(mine, other)


@_BOTH
def test_the_physics_step_is_the_suite_s_as_far_as_the_control_step_allows(name):
    suite = tasks.load(name, seed=0).task.physics_timestep
    found = [_find(name, rate).load(seed=0) for rate in (1, 2, 4)]
    assert [env.task.physics_timestep for env in found] == [suite, suite, suite / 2]
    assert [env.task.physics_steps_per_control_step for env in found] == [2, 1, 1]
    assert [env.physics.model.opt.timestep for env in found] == [suite, suite, suite / 2]


@_BOTH
@pytest.mark.parametrize("test", [False, True])
def test_at_the_suite_s_rate_it_is_the_suite_s_task(name, test):
    ours = _rollout(_find(name, 1).load_vector(_SEEDS.size), 1, test=test)
    theirs = _rollout(tasks.load_vector(name, _SEEDS.size), 1, test=test)
    assert np.ptp(ours, axis=0).max() > 0.1  # something moved
    np.testing.assert_array_equal(ours, theirs)


@_BOTH
def test_composer_steps_it_as_the_vectorised_path_does(name):
    found = _find(name, 2)
    environment, env = found.load(seed=5, test=True), found.load_vector(1)
    environment.reset()
    env.reset(np.array([5]), test=True)
    random_state = np.random.RandomState(0)
    for _ in range(40):
        action = random_state.uniform(env.action_low, env.action_high)
        step = environment.step(action)
        both = found.spec.flat(step.observation), env.step(action[None]).observation[0]
        np.testing.assert_array_equal(*both)


@pytest.mark.slow
def test_an_action_held_for_two_decisions_moves_the_arm_as_at_the_suite_s_rate():
    fine = _rollout(_find("ur5_reacher", 2).load_vector(_SEEDS.size), 2)
    coarse = _rollout(tasks.load_vector("ur5_reacher", _SEEDS.size), 1)
    np.testing.assert_array_equal(fine[::2], coarse)


def test_so_does_the_worm_unless_it_gets_hold_of_the_rod_between_the_suite_s_decisions():
    fine = _rollout(_find("pick_place", 2).load_vector(_SEEDS.size), 2)
    coarse = _rollout(tasks.load_vector("pick_place", _SEEDS.size), 1)
    same = (fine[::2] == coarse).all(axis=-1)
    got_hold = [np.argmax(own[..., -1], axis=0) for own in (fine, coarse)]  # 0: never
    earlier = got_hold[0] < 2 * got_hold[1]
    assert earlier.any() and (~earlier & (got_hold[1] > 0)).any()
    assert same[:, ~earlier].all() and not same[-1, earlier].any()
    np.testing.assert_array_equal(got_hold[0], 2 * got_hold[1] - earlier)
    for env in np.flatnonzero(earlier):
        assert same[: got_hold[1][env], env].all()


@pytest.mark.slow
@_BOTH
def test_at_four_times_the_rate_nothing_but_the_physics_step_differs(name):
    """Bit for bit the suite's task in physics as fine, until a worm gets hold of a rod."""
    fine = _rollout(_find(name, 4).load_vector(_SEEDS.size), 4)[::4]
    coarse = _rollout(_in_the_fine_physics(name), 1)
    until = np.full(_SEEDS.size, _STEPS + 1)
    if name == "pick_place":
        got_hold = np.argmax(fine[..., -1], axis=0)
        until = np.where(got_hold > 0, got_hold, until)
    assert until.min() > 10
    for env, step in enumerate(until):
        np.testing.assert_array_equal(fine[:step, env], coarse[:step, env])


@pytest.mark.slow
def test_finer_physics_bring_the_arm_to_the_same_place():
    """To a twentieth of the threshold, 7 cm, over a third of an episode."""
    fine = _rollout(_find("ur5_reacher", 4).load_vector(_SEEDS.size), 4)[::4]
    coarse = _rollout(tasks.load_vector("ur5_reacher", _SEEDS.size), 1)
    apart = np.abs(fine - coarse)[..., 12:15]  # the effector, in metres
    assert 0 < apart.max() < 0.07 / 20


def _in_the_fine_physics(name):
    """The suite's task, with the physics step that its fourfold rate needs."""
    suite, fine = tasks.find(name), _find(name, 4).spec
    task = suite.factory()
    task.set_timesteps(suite.spec.control_timestep, fine.control_timestep)
    environment = composer.Environment(
        task, random_state=0, strip_singleton_obs_buffer_dim=True
    )  # as `Entry.load` makes one
    return vector.VectorEnv(environment, name, _SEEDS.size, seed=0)
