"""A hand-written controller that solves the UR5 reacher: resolved-rate control to the goal."""

import numpy as np

from tasks.robots import ur5

# N m per rad/s, the joints' damping in ur5.xml: the torque that keeps a joint at a speed.
_DAMPING = np.array([47.7, 47.7, 47.7, 8.9, 8.9, 8.9])
_GAIN = 12.0  # per second
_REGULARISATION = 0.003  # square metres
_FACING = 0.3  # radians; turned farther away than this, only the pan heeds the goal


def actions(env, step) -> np.ndarray:
    """The torques [N, 6] in N m for a `VectorStep` of N environments."""
    rows = [
        _torques(observation[:6], observation[12:15], goal)
        for observation, goal in zip(step.observation, step.desired_goal, strict=True)
    ]
    return np.clip(rows, env.action_low, env.action_high)


def _torques(joints: np.ndarray, effector: np.ndarray, goal: np.ndarray) -> np.ndarray:
    turn = np.arctan2(goal[1], goal[0]) - np.arctan2(effector[1], effector[0])
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    # Turned about the base's axis to face the goal, what is left is for the other joints too.
    cos, sin = np.cos(turn), np.sin(turn)
    turned = np.array(
        [cos * effector[0] - sin * effector[1], sin * effector[0] + cos * effector[1], effector[2]]
    )
    joints = joints + np.array([turn, 0, 0, 0, 0, 0])
    jacobian = _jacobian(joints, turned)
    damped = jacobian @ jacobian.T + _REGULARISATION * np.eye(3)
    change = jacobian.T @ np.linalg.solve(damped, goal - turned)
    change[0] = turn if abs(turn) > _FACING else change[0] + turn
    return _DAMPING * _GAIN * change


def _jacobian(joints: np.ndarray, effector: np.ndarray) -> np.ndarray:
    """The effector's velocity [3, 6] per joint velocity, by finite differences."""
    small = 1e-5
    columns = [ur5.effector_position(joints + small * unit) - effector for unit in np.eye(6)]
    return np.stack(columns, axis=1) / small
