"""The robot worm: a planar arm of two links in the vertical x-z plane."""

import numpy as np
from dm_control import composer

from tasks import assets

MJCF = "worm.xml"
BASE_HEIGHT = 0.1  # metres from the floor to the shoulder, as in worm.xml
LINK_LENGTH = 0.4  # metres, each of the two links
ELBOW_LIMIT = 2.6  # radians either way
JOINT_LIMITS = np.array([1.75, ELBOW_LIMIT])  # radians either way: shoulder, elbow

# Metres from the shoulder to the gripper: arm straight, and arm folded as far as it goes.
REACH = 2 * LINK_LENGTH
INNER_REACH = REACH * np.cos(ELBOW_LIMIT / 2)


class Worm(composer.Entity):
    """The worm. Its joints read 0 upright and lean towards +x; its weight is compensated."""

    def _build(self):
        self._mjcf_root = assets.load_mjcf(MJCF)

    @property
    def mjcf_model(self):
        return self._mjcf_root

    @property
    def grip_site(self):
        """The site at the gripper, where it holds things."""
        return self._mjcf_root.find("site", "grip")


def grip_position(joints: np.ndarray) -> np.ndarray:
    """The gripper's x, z [..., 2] in metres for joint angles [..., 2] in radians."""
    shoulder = joints[..., 0]
    elbow = shoulder + joints[..., 1]
    return np.stack(
        [
            LINK_LENGTH * (np.sin(shoulder) + np.sin(elbow)),
            BASE_HEIGHT + LINK_LENGTH * (np.cos(shoulder) + np.cos(elbow)),
        ],
        axis=-1,
    )
