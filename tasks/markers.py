"""Visual markers for goals and subgoals, in the colours of the paper's Figures 4 and 5."""

from collections.abc import Sequence

import numpy as np
from dm_control import composer

from tasks import assets

GOAL_RGBA = (1.0, 0.82, 0.05, 0.75)
# Indexed by level: the subgoals that the lowest level pursues are purple, those of the level
# above it green.
SUBGOAL_RGBA = ((0.58, 0.20, 0.78, 0.75), (0.15, 0.70, 0.25, 0.75))
SUBGOAL_LEVELS = len(SUBGOAL_RGBA)

# Where a marker waits until it is shown: below the floor, out of every camera's sight.
HIDDEN_POSITION = (0.0, 0.0, -50.0)
_UPRIGHT = (1.0, 0.0, 0.0, 0.0)


class Marker(composer.Entity):
    """A body that is only seen: a mocap body without mass or contact.

    Moving it changes nothing but its own pose, so trajectories are the same with and without it.
    """

    def _build(self, name: str, shape: str, rgba: Sequence[float], size: Sequence[float]):
        """Builds a marker.

        Args:
          name: the marker's name in the model.
          shape: "sphere", "cube" or "rod" (a capsule along z).
          rgba: colour and opacity, each in [0, 1].
          size: metres; radius for a sphere, half edges for a cube, radius and half length of the
            straight part for a rod.
        """
        self._mjcf_root = assets.load_mjcf(f"marker_{shape}.xml")
        self._mjcf_root.model = name
        geom = self._mjcf_root.find("geom", "shape")
        geom.rgba = rgba
        if shape == "rod":
            radius, half_length = size
            geom.size = (radius,)
            geom.fromto = (0, 0, -half_length, 0, 0, half_length)
        else:
            geom.size = size
        self._mocap_id = -1  # known once compiled

    @property
    def mjcf_model(self):
        return self._mjcf_root

    def attach_to(self, arena: composer.Arena) -> None:
        """Puts the marker into the arena, hidden; a mocap body must be the world's own child."""
        frame = arena.attach(self)
        frame.mocap = "true"
        frame.pos = HIDDEN_POSITION

    def after_compile(self, physics, random_state) -> None:
        del random_state
        body_id = physics.model.name2id(f"{self.mjcf_model.model}/", "body")
        self._mocap_id = int(physics.model.body_mocapid[body_id])

    def show(self, physics, position, quaternion=_UPRIGHT) -> None:
        """Moves the marker to a position [3] in metres and an orientation [4] (w, x, y, z).

        `physics` is anything with MuJoCo's `data`. The array is written directly: going through
        `bind` would mark the physics dirty, which costs a forward pass at the next reading.
        """
        physics.data.mocap_pos[self._mocap_id] = position
        physics.data.mocap_quat[self._mocap_id] = quaternion

    def show_in_plane(self, physics, point: np.ndarray | None) -> None:
        """Moves the marker to a point [2 or more] that begins with x and z; hides it for None."""
        if point is None:
            self.hide(physics)
        else:
            self.show(physics, (point[0], 0.0, point[1]))

    def hide(self, physics) -> None:
        """Puts the marker out of sight."""
        self.show(physics, np.asarray(HIDDEN_POSITION))


def subgoal_markers(shape: str, size: Sequence[float], name: str = "subgoal") -> list[Marker]:
    """Makes one marker for each level that can show its subgoal, the lowest level's first."""
    return [Marker(f"{name}_{level}", shape, rgba, size) for level, rgba in enumerate(SUBGOAL_RGBA)]
