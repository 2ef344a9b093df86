"""Vectorised stepping equals Composer bit for bit, and survives what goes wrong."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from dm_control.rl import control

import tasks
from tests.cases import some_slow

_SEEDS = np.array([3, 141, 2**32 - 1])
_MADE = ("observation", "achieved_goal", "achieved_subgoal", "desired_goal")


def _composer_row(environment, timestep):
    """What a VectorStep should hold for an environment, from its Composer observation."""
    task, observation = environment.task, timestep.observation
    parts = task.observation_parts(task.readings(environment.physics))
    return {
        "observation": np.concatenate([observation[name] for name in parts]),
        "achieved_goal": observation["achieved_goal"],
        "achieved_subgoal": task.achieved_subgoal(task.readings(environment.physics)),
        "desired_goal": observation["desired_goal"],
    }


def _assert_row_equals(step, i, row):
    for name in _MADE:
        np.testing.assert_array_equal(getattr(step, name)[i], row[name], err_msg=name, strict=True)


def _random_actions(env, random_state, blocks=10):
    """Actions that stay the same for some steps, which takes bodies further than pure noise."""
    num_blocks = -(-env.max_steps // blocks)
    drawn = random_state.uniform(
        1.2 * env.action_low, 1.2 * env.action_high, (num_blocks, env.num_envs, env.action_low.size)
    )
    return np.repeat(drawn, blocks, axis=0)[: env.max_steps]


@pytest.mark.parametrize("test", some_slow((True, False), False))
@pytest.mark.parametrize("name", tasks.ALL)
def test_equals_composer_over_whole_episodes(name, test):
    env = tasks.load_vector(name, len(_SEEDS))
    composers = [tasks.load(name, seed=int(seed), test=test) for seed in _SEEDS]
    timesteps = [environment.reset() for environment in composers]
    step = env.reset(_SEEDS, test=test)
    running = np.ones(len(_SEEDS), dtype=bool)
    for t, actions in enumerate(_random_actions(env, np.random.RandomState(7)), start=1):
        for i, environment in enumerate(composers):
            _assert_row_equals(step, i, _composer_row(environment, timesteps[i]))
        step = env.step(actions, mask=running)
        for i in np.flatnonzero(running):
            timesteps[i] = composers[i].step(actions[i])
            achieved = env.goal_space.achieved(step.achieved_goal[i], step.desired_goal[i])
            assert timesteps[i].reward == (0.0 if achieved else -1.0)
            assert timesteps[i].last() == (achieved or t == env.max_steps)
            running[i] = not timesteps[i].last()
    assert not running.any()
    assert not step.diverged.any()


_WITH_EVENTS = [name for name in tasks.ALL if tasks.find(name).factory().has_event]
_ONE_PHYSICS_STEP = (
    f"{Path(tasks.__file__).parent / 'families' / 'depth.py'}:pick_place_600"  # in a control step
)


@pytest.mark.parametrize("name", [*_WITH_EVENTS, _ONE_PHYSICS_STEP])
def test_equals_composer_through_an_event(name):
    """Finds an episode in which something gets attached, and replays it in Composer."""
    env = tasks.load_vector(name, 64)
    seeds = np.arange(64)
    env.reset(seeds)
    idle = env._model.eq_active0
    actions = _random_actions(env, np.random.RandomState(5), blocks=25)
    active = [env._equalities.copy()]
    for action in actions:
        env.step(action)
        active.append(env._equalities.copy())
    happened = (active[0] == idle).all(axis=-1) & (active[-1] != idle).any(axis=-1)
    assert happened.any(), "no episode had an event; give the test more of them"
    chosen = np.flatnonzero(happened)[0]

    single = tasks.load_vector(name, 1)
    step = single.reset(seeds[[chosen]])
    environment = tasks.load(name, seed=int(seeds[chosen]))
    timestep = environment.reset()
    for action in actions[:, [chosen]]:
        _assert_row_equals(step, 0, _composer_row(environment, timestep))
        np.testing.assert_array_equal(single._equalities[0], environment.physics.data.eq_active)
        if timestep.last():
            break
        step, timestep = single.step(action), environment.step(action[0])
    assert (single._equalities[0] != idle).any()


@pytest.mark.parametrize("name", tasks.ALL)
def test_reset_in_the_middle_of_a_batch_leaves_the_others_alone(name):
    """Environment 1 starts again while 0 and 2 go on; all equal environments stepped alone."""
    env = tasks.load_vector(name, 3)
    env.reset(_SEEDS)
    alone = [tasks.load_vector(name, 1) for _ in _SEEDS]
    for single, seed in zip(alone, _SEEDS, strict=True):
        single.reset(np.array([seed]))
    actions = _random_actions(env, np.random.RandomState(11))[:60]
    for t, action in enumerate(actions):
        if t == 25:
            step = env.reset(np.array([0, 77, 0]), mask=np.array([False, True, False]), test=True)
            expected = [alone[1].reset(np.array([77]), test=True)]
        else:
            step = env.step(action)
            expected = [single.step(action[[i]]) for i, single in enumerate(alone)]
        for i, one in zip([1] if t == 25 else range(3), expected, strict=True):
            _assert_row_equals(step, i, {name: getattr(one, name)[0] for name in _MADE})


def test_masked_environments_keep_their_values():
    env = tasks.load_vector(tasks.ALL[0], 3)
    before = env.reset(_SEEDS)
    after = env.step(np.ones((3, env.action_low.size)), mask=np.array([True, False, True]))
    np.testing.assert_array_equal(after.observation[1], before.observation[1])
    assert (after.observation[[0, 2]] != before.observation[[0, 2]]).any(axis=-1).all()


@pytest.mark.parametrize("name", tasks.ALL)
def test_returned_arrays_are_not_shared(name):
    env = tasks.load_vector(name, 2)
    first = env.reset(_SEEDS[:2])
    kept = [array.copy() for array in first]
    second = env.step(np.tile(env.action_high, (2, 1)))
    for array, copy in zip(first, kept, strict=True):
        np.testing.assert_array_equal(array, copy)
    arrays = [*first, *second]
    for i, one in enumerate(arrays):
        assert not any(np.shares_memory(one, other) for other in arrays[i + 1 :])
        one.fill(0)
    again = env.step(np.tile(env.action_high, (2, 1)), mask=np.zeros(2, dtype=bool))
    assert again.desired_goal.any()
    assert again.observation.any()


@pytest.mark.parametrize("name", tasks.ALL)
def test_a_diverged_environment_is_marked_frozen_and_recovers(name):
    env = tasks.load_vector(name, 3)
    twin = tasks.load_vector(name, 3)
    env.reset(_SEEDS)
    twin.reset(_SEEDS)
    actions = np.tile(0.3 * env.action_high, (3, 1))
    before, _ = env.step(actions), twin.step(actions)
    env._batch.qvel[1, 0] = 1e12
    for _ in range(3):
        step, healthy = env.step(actions), twin.step(actions)
        np.testing.assert_array_equal(step.diverged, [False, True, False])
        for i in (0, 2):
            _assert_row_equals(step, i, {n: getattr(healthy, n)[i] for n in _MADE})
        _assert_row_equals(step, 1, {n: getattr(before, n)[1] for n in _MADE})
    # MuJoCo set its clock back when it broke down; it was not stepped after that.
    assert env._batch.time[1] < 1.5 * env.control_timestep < env._batch.time[0]
    step = env.reset(_SEEDS, mask=np.array([False, True, False]))
    assert not step.diverged.any()
    _assert_row_equals(step, 1, {n: getattr(twin.reset(_SEEDS), n)[1] for n in _MADE})


# Forces on the last joint, in N or N m: from one that a task shrugs off, or that breaks it steps
# later, to one that breaks it at once.
_KICKS = (1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, np.nan)


@pytest.mark.parametrize("name", tasks.ALL)
def test_diverges_on_the_step_on_which_composer_raises(name):
    env = tasks.load_vector(name, len(_KICKS))
    start = env.reset(np.full(env.num_envs, 3))
    actions = _random_actions(env, np.random.RandomState(2))[:30]
    shown = [start, env.step(actions[0])]
    env._batch.qfrc_applied[:, -1] = _KICKS
    shown += [env.step(action) for action in actions[1:]]
    assert shown[-1].diverged[-1] and not shown[-1].diverged[0]
    environment = tasks.load(name)
    for i, kick in enumerate(_KICKS):
        environment.random_state.seed(3)
        timestep = environment.reset()
        for t, action in enumerate(actions[:, i]):
            _assert_row_equals(shown[t], i, _composer_row(environment, timestep))
            if t == 1:
                environment.physics.data.qfrc_applied[-1] = kick
            if shown[t + 1].diverged[i]:
                with pytest.raises(control.PhysicsError):
                    environment.step(action)
                break
            timestep = environment.step(action)
            if timestep.last():
                break


@pytest.mark.parametrize("warning", list(mujoco.mjtWarning.__members__.values())[:-1])
def test_every_warning_that_dm_control_raises_for_counts_as_divergence(warning, monkeypatch):
    env = tasks.load_vector(tasks.ALL[0], 2)
    env.reset(_SEEDS[:2])
    advance = env._advance

    def warn(chosen):
        advance(chosen)
        env._warnings[1, warning] += 1

    monkeypatch.setattr(env, "_advance", warn)
    step = env.step(np.zeros((2, env.action_low.size)))
    np.testing.assert_array_equal(step.diverged, [False, True])


def test_an_event_that_breaks_the_physics_counts_as_divergence(monkeypatch):
    env = tasks.load_vector(_WITH_EVENTS[0], 2)
    env.reset(_SEEDS[:2])

    def push_without_end(simulation):
        simulation.data.qfrc_applied[-1] = np.nan

    monkeypatch.setattr(env._task, "event_mask", lambda readings: np.arange(len(readings)) == 1)
    monkeypatch.setattr(env._task, "apply_event", push_without_end)
    idle = np.zeros((2, env.action_low.size))
    assert not env.step(idle).diverged.any()
    np.testing.assert_array_equal(env.step(idle).diverged, [False, True])


def _nan_position(physics):
    physics.data.qpos[0] = np.nan


def _physics_error(physics):
    raise control.PhysicsError("Physics state is invalid. Warning(s) raised: mjWARN_CONTACTFULL")


@pytest.mark.parametrize("fault", [_nan_position, _physics_error])
def test_breaking_down_while_resetting_counts_as_divergence(fault, monkeypatch):
    env = tasks.load_vector(tasks.ALL[0], 2)
    begin = env._task.begin_episode

    def broken(physics, random_state, test):
        begin(physics, random_state, test)
        fault(physics)

    healthy = env.reset(_SEEDS[:2])
    monkeypatch.setattr(env._task, "begin_episode", broken)
    step = env.reset(_SEEDS[:2], mask=np.array([True, False]))
    np.testing.assert_array_equal(step.diverged, [True, False])
    assert all(np.isfinite(array).all() for array in step)
    monkeypatch.undo()
    step = env.reset(_SEEDS[:2])
    assert not step.diverged.any()
    np.testing.assert_array_equal(step.observation, healthy.observation)


def test_own_seeds_follow_from_the_constructor_seed():
    name = tasks.ALL[0]
    first, same, other = (tasks.load_vector(name, 2, seed=s).reset().observation for s in (1, 1, 2))
    np.testing.assert_array_equal(first, same)
    assert (first != other).any()
    env = tasks.load_vector(name, 2, seed=1)
    assert (env.reset().observation != env.reset().observation).any()


def test_actions_are_clipped_to_the_bounds():
    env = tasks.load_vector(tasks.ALL[0], 2)
    env.reset(np.array([5, 5]))
    step = env.step(np.stack([env.action_high, 100 * env.action_high]))
    np.testing.assert_array_equal(step.observation[0], step.observation[1])


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_actions_that_are_not_finite_are_refused_by_name(value):
    env = tasks.load_vector("cartpole_swingup", 3)
    actions = np.zeros((3, 1))
    actions[2, 0] = value
    with pytest.raises(ValueError, match=r"environment 2: action 0 \(.*slider\)"):
        env.step(actions)
    env.step(actions, mask=np.array([True, True, False]))


def test_wrong_arguments_are_refused():
    env = tasks.load_vector(tasks.ALL[0], 2)
    with pytest.raises(ValueError, match="shape"):
        env.step(np.zeros((3, 1)))
    with pytest.raises(ValueError, match="mask"):
        env.step(np.zeros((2, 1)), mask=np.array([1, 0]))
    with pytest.raises(ValueError, match="seeds"):
        env.reset(np.array([-1, 0]))
    with pytest.raises(ValueError, match="seeds"):
        env.reset(np.array([0, 2**32]))
    with pytest.raises(ValueError, match="seeds"):
        env.reset(np.array([0.7, 1.0]))
    with pytest.raises(ValueError, match="num_envs"):
        tasks.load_vector(tasks.ALL[0], 0)
    before = env.reset(np.array([0, 1])).desired_goal
    for goal in (np.nan, np.zeros(env.goal_space.dim + 1), np.full(env.goal_space.dim, np.inf)):
        with pytest.raises(ValueError, match="finite numbers"):
            env.move_goal(0, goal)
    np.testing.assert_array_equal(env._view().desired_goal, before)


def test_a_camera_that_follows_is_where_the_environment_is():
    env = tasks.load_vector("pick_place", 2)
    env._model.cam_mode[0] = mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM
    env._model.cam_bodyid[0] = env._model.jnt_bodyid[0]
    for _ in range(20):
        env.step(np.array([env.action_low, env.action_high]))
    for i in (1, 0):
        env.render(i, height=8, width=8)
        drawn = env._physics.data.cam_xpos[0]
        np.testing.assert_allclose(drawn, env.simulation(i)[1].cam_xpos[0], atol=1e-9)
