"""A hand-written controller that swings the pendulum up: pump energy, then hold."""

import numpy as np

_WEIGHT = 9.81 * 0.5  # N m, the torque that holds the 1 kg bob level at 0.5 m
_INERTIA = 0.251  # kg m^2 about the pivot
_NEAR_UPRIGHT = 0.35  # radians, within which 2 N m can hold the bob
_STIFFNESS, _DAMPING = 20.0, 3.0  # N m per rad, N m per rad/s


def actions(env, step) -> np.ndarray:
    """The torques [N, 1] in N m for a `VectorStep` of N environments."""
    sine, cosine, velocity = step.observation.T
    missing = _WEIGHT * (1 + cosine) - _INERTIA * velocity**2 / 2
    pump = 10.0 * missing * np.where(velocity < 0, -1.0, 1.0)
    from_upright = np.arctan2(-sine, -cosine)
    hold = -_STIFFNESS * from_upright - _DAMPING * velocity
    torque = np.where(np.abs(from_upright) < _NEAR_UPRIGHT, hold, pump)
    return np.clip(torque[:, np.newaxis], env.action_low, env.action_high)
