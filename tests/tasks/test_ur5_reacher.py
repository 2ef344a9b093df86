"""The UR5 reacher: the real arm's kinematics, masses and limits; goals in the right quadrant."""

import numpy as np
import pytest
from dm_control import composer

import tasks
from tasks.families import ur5_reacher
from tasks.robots import ur5
from tests.tasks import scripted_ur5

_SEEDS = np.arange(48)

# The manufacturer's table: a, d in metres and alpha in radians of each joint.
_DH_TABLE = [
    (0.0, 0.089159, np.pi / 2),
    (-0.425, 0.0, 0.0),
    (-0.39225, 0.0, 0.0),
    (0.0, 0.10915, np.pi / 2),
    (0.0, 0.09465, -np.pi / 2),
    (0.0, 0.0823, 0.0),
]
_MASSES = [3.7, 8.393, 2.275, 1.219, 1.219, 0.1879]


def _rotation(axis, angle):
    """A homogeneous rotation about axis 0 (x) or 2 (z)."""
    i, j = (1, 2) if axis == 0 else (0, 1)
    pose = np.eye(4)
    pose[[i, j], [i, j]] = np.cos(angle)
    pose[i, j], pose[j, i] = -np.sin(angle), np.sin(angle)
    return pose


def _translation(x, z):
    pose = np.eye(4)
    pose[[0, 2], 3] = x, z
    return pose


def _effector_by_table(joints):
    pose = np.eye(4)
    for theta, (a, d, alpha) in zip(joints, _DH_TABLE, strict=True):
        pose = pose @ _rotation(2, theta) @ _translation(a, d) @ _rotation(0, alpha)
    return pose[:3, 3]


def _episodes(test):
    env = tasks.load_vector("ur5_reacher", _SEEDS.size)
    return env, env.reset(_SEEDS, test=test)


def test_forward_kinematics_match_the_table():
    environment = tasks.load("ur5_reacher", seed=0)
    low, high = environment.physics.model.jnt_range.T
    random_state = np.random.RandomState(0)
    for _ in range(200):
        joints = random_state.uniform(low, high)
        with environment.physics.reset_context():
            environment.physics.data.qpos[:] = joints
        expected = _effector_by_table(joints)
        modelled = environment.physics.named.data.site_xpos["ur5/effector"]
        np.testing.assert_allclose(modelled, expected, rtol=0, atol=1e-6)
        np.testing.assert_allclose(ur5.effector_position(joints), expected, rtol=0, atol=1e-6)


def test_masses_and_torque_limits_are_the_real_arms():
    environment = tasks.load("ur5_reacher", seed=0)
    masses = environment.physics.model.body_mass
    np.testing.assert_allclose(masses[masses > 0], _MASSES)
    limits = [150.0, 150.0, 150.0, 28.0, 28.0, 28.0]
    np.testing.assert_array_equal(environment.action_spec().maximum, limits)
    np.testing.assert_array_equal(environment.action_spec().minimum, np.negative(limits))
    environment.reset()
    environment.step(np.full(6, 1e3))
    np.testing.assert_array_equal(environment.physics.data.actuator_force, limits)


@pytest.mark.parametrize("joint", range(6))
def test_full_torque_reaches_the_speed_limit_and_no_more(joint):
    environment = tasks.load("ur5_reacher", seed=0)
    physics = environment.physics
    with physics.reset_context():
        physics.data.qpos[:] = [-1.5, -2.2, 0.0, -1.5, -1.5, -1.5]
    torques = np.zeros(6)
    torques[joint] = physics.model.actuator_ctrlrange[joint, 1]
    speeds = []
    for _ in range(60):
        physics.set_control(torques)
        physics.step()
        speeds.append(physics.data.qvel[joint])
    assert 0.9 * ur5.SPEED_LIMIT < max(speeds) < 1.01 * ur5.SPEED_LIMIT


def test_the_arms_weight_is_compensated():
    environment = tasks.load("ur5_reacher", seed=0)
    joints = [0.3, -0.8, 0.9, -1.0, -1.5, 0.2]
    with environment.physics.reset_context():
        environment.physics.data.qpos[:] = joints
    for _ in range(100):
        environment.physics.step()
    np.testing.assert_allclose(environment.physics.data.qpos, joints, atol=1e-6)


def test_the_floor_stops_the_effector():
    environment = tasks.load("ur5_reacher", seed=0)
    physics = environment.physics
    with physics.reset_context():
        physics.data.qpos[:] = [0.0, -0.8, 0.4, -1.0, -1.5, 0.0]
    for _ in range(200):
        physics.set_control([0.0, 40.0, 0.0, 0.0, 0.0, 0.0])  # leans the arm forwards and down
        physics.step()
    assert physics.data.ncon > 0
    assert physics.named.data.site_xpos["ur5/effector", "z"] > 0.02


@pytest.mark.parametrize("test", [True, False])
def test_starts_and_goals(test):
    env, step = _episodes(test)
    start, goal = step.achieved_goal, step.desired_goal
    assert (start[:, 2] >= 0.1).all() and (goal[:, 2] >= 0.1).all()
    turn = np.arctan2(goal[:, 1], goal[:, 0]) - np.arctan2(start[:, 1], start[:, 0])
    turn = np.abs((turn + np.pi) % (2 * np.pi) - np.pi)
    assert (turn >= np.pi / 4).all() and (turn <= 3 * np.pi / 4).all()
    assert (env.goal_space.low <= goal).all() and (goal <= env.goal_space.high).all()
    spread = np.ptp(step.observation[:, :6], axis=0)
    expected = [0.6, 0.2, 0.2, 0.2, 0.2, 0.2] if test else [3.14, 1.7, 2.1, 2.0, 2.0, 6.28]
    assert (spread <= expected).all() and (spread > 0.7 * np.array(expected)).all()
    np.testing.assert_array_equal(step.observation[:, 6:12], 0.0)


def test_goals_lie_to_both_sides():
    _, step = _episodes(test=True)
    start, goal = step.achieved_goal, step.desired_goal
    left = start[:, 0] * goal[:, 1] - start[:, 1] * goal[:, 0] > 0
    assert 0.2 < left.mean() < 0.8


@pytest.mark.slow
def test_a_scripted_controller_succeeds_in_time():
    env, step = _episodes(test=True)
    steps_to_goal = np.full(env.num_envs, -1)
    for t in range(120):
        achieved = env.goal_space.achieved(step.achieved_goal, step.desired_goal)
        steps_to_goal[achieved & (steps_to_goal < 0)] = t
        if (steps_to_goal >= 0).all():
            break
        step = env.step(scripted_ur5.actions(env, step), mask=steps_to_goal < 0)
    assert (steps_to_goal >= 0).all()
    # An efficient learned policy takes about 60; what a script takes keeps the physics calibrated.
    assert 35 <= np.median(steps_to_goal) <= 60


def test_violent_actions_do_not_break_the_physics():
    env, step = _episodes(test=False)
    random_state = np.random.RandomState(0)
    for _ in range(20):
        actions = env.action_high * random_state.choice([-1.0, 1.0], (env.num_envs, 6))
        for _ in range(10):
            step = env.step(actions)
    assert not step.diverged.any()
    assert np.isfinite(step.observation).all()


@pytest.mark.parametrize(("constant", "what"), [("_LEAST_RADIUS", "goal"), ("_CLEARANCE", "start")])
def test_an_impossible_placement_is_an_error(monkeypatch, constant, what):
    environment = tasks.load("ur5_reacher", seed=0, test=True)
    monkeypatch.setattr(ur5_reacher, constant, 9.0)
    with pytest.raises(composer.EpisodeInitializationError, match=f"UR5Reacher: no valid {what}"):
        environment.reset()
