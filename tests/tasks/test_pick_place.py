"""Pick-and-place: the solver carries the rod, and starts and goals are what the task says."""

import numpy as np
import pytest
from dm_control import composer

import tasks
from tasks.families import pick_place
from tasks.robots import worm
from tests.tasks import scripted_worm

_SEEDS = np.arange(48)
_ROD_LENGTH = 0.25


def _episodes(test):
    env = tasks.load_vector("pick_place", _SEEDS.size)
    return env, env.reset(_SEEDS, test=test)


def _part(step, name):
    """A part of the observations [N, k], by its name."""
    parts = {"joints": slice(0, 2), "gripper": slice(4, 6), "rod": slice(6, 8)}
    parts |= {"rod_velocity": slice(8, 10), "rod_axis": slice(10, 12), "attached": 13}
    return step.observation[:, parts[name]]


def _rod_top(step):
    return _part(step, "rod") + _ROD_LENGTH / 2 * _part(step, "rod_axis")


def _play(env, step, num_steps):
    """Lets the scripted controller act on and on; returns the steps seen."""
    steps = [step]
    for _ in range(num_steps):
        steps.append(env.step(scripted_worm.actions(env, steps[-1])))
    return steps


def test_columns_are_the_sensors_they_name():
    environment = tasks.load("pick_place", seed=0)
    model = environment.physics.model
    columns = pick_place._COLUMNS
    for name, sensor, offsets in [
        ("joints", "worm/shoulder_angle", (0, 1)),
        ("joint_velocities", "worm/shoulder_velocity", (0, 1)),
        ("gripper", "worm/grip_position", (0, 2)),
        ("rod", "rod/centre_position", (0, 2)),
        ("rod_top", "rod/top_position", (0, 2)),
        ("rod_velocity", "rod/centre_velocity", (0, 2)),
        ("rod_axis", "rod/axis", (0, 2)),
        ("rod_spin", "rod/tilt_velocity", (0,)),
    ]:
        start = model.sensor(sensor).adr[0]
        assert columns[name] == [start + offset for offset in offsets], name
    assert columns["attached"] == [model.nsensordata]


def test_forward_kinematics_are_the_models():
    environment = tasks.load("pick_place", seed=0)
    random_state = np.random.RandomState(0)
    for _ in range(50):
        joints = random_state.uniform(-worm.JOINT_LIMITS, worm.JOINT_LIMITS)
        with environment.physics.reset_context():
            environment.physics.data.qpos[:2] = joints
        modelled = environment.physics.named.data.site_xpos["worm/grip", ["x", "z"]]
        np.testing.assert_allclose(worm.grip_position(joints), modelled, atol=1e-12)


def test_torques_are_limited():
    environment = tasks.load("pick_place", seed=0)
    np.testing.assert_array_equal(environment.action_spec().maximum, [4.0, 2.5])
    np.testing.assert_array_equal(environment.action_spec().minimum, [-4.0, -2.5])
    environment.reset()
    environment.step(np.array([100.0, -100.0]))
    np.testing.assert_array_equal(environment.physics.data.actuator_force, [4.0, -2.5])


def test_the_worms_weight_is_compensated():
    environment = tasks.load("pick_place", seed=0)
    with environment.physics.reset_context():
        environment.physics.data.qpos[:] = [1.2, 0.4, -0.5, 0.0, 0.0]
    for _ in range(50):
        environment.physics.step()
    np.testing.assert_allclose(environment.physics.data.qpos[:2], [1.2, 0.4], atol=1e-6)


def test_an_untouched_rod_stands_still():
    env, first = _episodes(test=True)
    random_state = np.random.RandomState(0)
    step = first
    for _ in range(150):
        # The elbow alone, pushed weakly: the gripper stays far above the rod.
        actions = np.zeros((env.num_envs, 2))
        actions[:, 1] = random_state.uniform(-0.5, 0.5, env.num_envs)
        step = env.step(actions)
    assert not _part(step, "attached").any()
    np.testing.assert_allclose(_part(step, "rod"), _part(first, "rod"), atol=1e-3)
    np.testing.assert_allclose(_part(step, "rod_axis"), _part(first, "rod_axis"), atol=1e-3)


@pytest.mark.slow
def test_the_solver_carries_the_rod():
    env, first = _episodes(test=True)
    assert not _part(first, "attached").any()
    steps = _play(env, first, 150)
    attached = np.stack([_part(step, "attached") for step in steps])
    assert attached[-1].all()
    assert (np.diff(attached, axis=0) >= 0).all(), "nothing lets go of the rod"
    gap = np.stack([np.linalg.norm(_part(s, "gripper") - _rod_top(s), axis=-1) for s in steps])
    # The gripper had come within reach when it got hold, and the solver has since closed the gap.
    first_attached = attached.argmax(axis=0)
    assert (np.take_along_axis(gap, first_attached[None], axis=0) <= 0.08).all()
    assert (gap[-1] < 0.005).all()
    bottom = _part(steps[-1], "rod")[:, 1] - _ROD_LENGTH / 2 * _part(steps[-1], "rod_axis")[:, 1]
    assert (bottom > 0.03).all(), "carried rods have left the floor"


def test_a_carried_rod_weighs_on_the_worm():
    environment = tasks.load("pick_place", seed=0, test=True)
    joints = np.array([0.9, 0.8])
    drops = []
    for held in (False, True):
        with environment.physics.reset_context():
            x, z = worm.grip_position(joints)
            environment.physics.data.qpos[:] = [*joints, x, z - _ROD_LENGTH, 0.0]
            environment.physics.data.eq_active[:] = held
        for _ in range(30):
            environment.physics.step()
        drops.append(z - environment.physics.named.data.site_xpos["worm/grip", "z"])
    assert abs(drops[0]) < 1e-3
    assert drops[1] > 0.01


def test_attaches_only_within_reach_and_once():
    task = tasks.load("pick_place", seed=0).task
    readings = np.zeros((4, 21))
    columns = pick_place._COLUMNS
    readings[:, columns["rod_top"]] = 0.4, 0.25
    readings[:, columns["gripper"]] = [[0.4, 0.329], [0.4, 0.331], [0.458, 0.25], [0.4, 0.25]]
    readings[3, columns["attached"]] = 1.0
    np.testing.assert_array_equal(task.event_mask(readings), [True, False, True, False])


def test_reset_lets_go():
    env, step = _episodes(test=True)
    step = _play(env, step, 100)[-1]
    assert _part(step, "attached").all()
    half = np.arange(env.num_envs) % 2 == 0
    step = env.reset(_SEEDS, mask=half, test=True)
    np.testing.assert_array_equal(_part(step, "attached"), ~half)
    np.testing.assert_array_equal(env._batch.eq_active[:, 0], ~half)


def test_test_starts():
    _, step = _episodes(test=True)
    assert (np.abs(_part(step, "joints")) <= 0.3).all()
    rod = _part(step, "rod")
    assert (np.abs(rod[:, 0]) >= 0.35).all() and (np.abs(rod[:, 0]) <= 0.65).all()
    assert 0.2 < (rod[:, 0] > 0).mean() < 0.8, "both sides occur"
    np.testing.assert_allclose(rod[:, 1], _ROD_LENGTH / 2, atol=1e-9)
    assert not _part(step, "attached").any()


def test_training_starts():
    _, step = _episodes(test=False)
    held = _part(step, "attached") == 1.0
    assert 0.25 < held.mean() < 0.75
    assert np.ptp(_part(step, "joints"), axis=0).min() > 2.5
    assert (_part(step, "gripper")[:, 1] >= 0.05).all()
    np.testing.assert_allclose(_part(step, "gripper")[held], _rod_top(step)[held], atol=1e-9)
    np.testing.assert_allclose(_part(step, "rod")[~held, 1], _ROD_LENGTH / 2, atol=1e-9)


@pytest.mark.parametrize("test", [True, False])
def test_goals_are_far_clear_and_within_reach(test):
    env, step = _episodes(test)
    goals = step.desired_goal
    assert (np.linalg.norm(goals - _part(step, "rod"), axis=-1) >= 0.3).all()
    assert (goals[:, 1] - _ROD_LENGTH / 2 >= 0.05).all()
    gripper = goals + [0.0, _ROD_LENGTH / 2]
    for target in gripper:
        joints = scripted_worm.inverse_kinematics(target, np.zeros(2))
        assert (np.abs(joints) <= worm.JOINT_LIMITS).all()
        np.testing.assert_allclose(worm.grip_position(joints), target, atol=1e-9)
    assert (env.goal_space.low <= goals).all() and (goals <= env.goal_space.high).all()


def test_a_scripted_controller_succeeds_in_time():
    env, step = _episodes(test=True)
    steps = _play(env, step, 200)
    achieved = np.stack([env.goal_space.achieved(s.achieved_goal, s.desired_goal) for s in steps])
    assert achieved.any(axis=0).all()
    # An efficient learned policy takes about 110; what a script takes keeps the physics calibrated.
    assert 65 <= np.median(achieved.argmax(axis=0)) <= 105


def test_violent_actions_do_not_break_the_physics():
    env, step = _episodes(test=False)
    random_state = np.random.RandomState(0)
    for _ in range(30):
        actions = env.action_high * random_state.choice([-1.0, 1.0], (env.num_envs, 2))
        for _ in range(10):
            step = env.step(actions)
            assert (_part(step, "rod")[:, 1] > 0.0).all()
    assert not step.diverged.any()
    assert np.isfinite(step.observation).all()


@pytest.mark.parametrize(
    ("constant", "what"), [("_GOAL_DISTANCE", "goal"), ("_CLEARANCE", "start")]
)
def test_an_impossible_placement_is_an_error(monkeypatch, constant, what):
    environment = tasks.load("pick_place", seed=0, test=True)
    monkeypatch.setattr(pick_place, constant, 9.0)
    with pytest.raises(composer.EpisodeInitializationError, match=f"PickPlace: no valid {what}"):
        environment.reset()
