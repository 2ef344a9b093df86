"""A hand-written controller that solves pick-and-place: inverse kinematics and a PD law."""

import numpy as np

from tasks.robots import worm

_STIFFNESS = 30.0  # N m per rad
_DAMPING = 1.5  # N m per rad/s
_TO_ROD_TOP = 0.125  # metres from the rod's centre
_FULL_REACH = 0.999 * worm.REACH  # just short of straight, where the inverse is singular


def actions(env, step) -> np.ndarray:
    """The torques [N, 2] in N m for a `VectorStep` of N environments."""
    rows = [
        _torques(observation, goal)
        for observation, goal in zip(step.observation, step.desired_goal, strict=True)
    ]
    return np.clip(rows, env.action_low, env.action_high)


def _torques(observation: np.ndarray, goal: np.ndarray) -> np.ndarray:
    joints, velocities = observation[:2], observation[2:4]
    rod, axis, attached = observation[6:8], observation[10:12], observation[13]
    hanging = np.array([0.0, 1.0])
    target = goal + _TO_ROD_TOP * hanging if attached else rod + _TO_ROD_TOP * axis
    return _STIFFNESS * (inverse_kinematics(target, joints) - joints) - _DAMPING * velocities


def inverse_kinematics(target: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """The joint angles [2] nearest to `joints` that bring the gripper to `target` (x, z)."""
    x, z = target[0], target[1] - worm.BASE_HEIGHT
    reach = min(np.hypot(x, z), _FULL_REACH)
    bend = np.arccos(reach**2 / (2 * worm.LINK_LENGTH**2) - 1)
    # The shoulder leans half the bend away from the target's direction.
    candidates = [np.array([np.arctan2(x, z) - elbow / 2, elbow]) for elbow in (bend, -bend)]
    allowed = [c for c in candidates if (np.abs(c) <= worm.JOINT_LIMITS).all()]
    return min(allowed, key=lambda c: np.abs(c - joints).max())
