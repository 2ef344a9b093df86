"""The UR5: a six-joint arm with the real robot's kinematics."""

import numpy as np
from dm_control import composer

from tasks import assets

# Denavit-Hartenberg parameters: metres along x and z, radians about x, one per joint. The arm's
# MJCF has the same numbers as body offsets.
DH_A = (0.0, -0.425, -0.39225, 0.0, 0.0, 0.0)
DH_D = (0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823)
DH_ALPHA = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)

SPEED_LIMIT = np.pi  # rad/s, every joint
MJCF = "ur5.xml"


class UR5(composer.Entity):
    """The UR5, standing at its attachment frame. Its weight is compensated."""

    def _build(self):
        self._mjcf_root = assets.load_mjcf(MJCF)

    @property
    def mjcf_model(self):
        return self._mjcf_root


def frame_positions(joints: np.ndarray) -> np.ndarray:
    """The origins [6, 3] in metres of the six DH frames, for joint angles [6] in radians.

    The last two are the wrist and the effector.
    """
    pose = np.eye(4)
    origins = []
    for theta, a, d, alpha in zip(joints, DH_A, DH_D, DH_ALPHA, strict=True):
        pose = pose @ _dh_transform(theta, a, d, alpha)
        origins.append(pose[:3, 3])
    return np.array(origins)


def effector_position(joints: np.ndarray) -> np.ndarray:
    """The effector's x, y, z [3] in metres for joint angles [6] in radians."""
    return frame_positions(joints)[-1]


def _dh_transform(theta: float, a: float, d: float, alpha: float) -> np.ndarray:
    """The pose [4, 4] of a DH frame in the one before it."""
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array(
        [
            [ct, -st * ca, st * sa, a * ct],
            [st, ct * ca, -ct * sa, a * st],
            [0.0, sa, ca, d],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
