"""The cartpole task: swing the pole up and slow it down near the marker, with the cart below.

Test starts: the pole hanging (within 0.1 rad), the cart within 0.1 m of the middle. Training
starts: the pole anywhere but within 45 degrees of upright, the cart within 1 m of the middle. All
start at rest, and the goal is always the same.
"""

import numpy as np

from tasks import assets, base, goal_space, markers, registry, scenes, task_spec

_MJCF = "cartpole.xml"
# T_0, T_1 and T_2; the paper has one T for all levels (Section 3.2). In 8 steps, the cube root of
# max_steps, the cart can hardly change where the pole's tip goes. These end training episodes after
# 480 of the 500 steps.
_HORIZONS = {2: (20, 8, 3)}

_RAIL_HEIGHT = 1.2  # metres, as in cartpole.xml
_RAIL_HALF_LENGTH = 1.8  # metres, as in cartpole.xml
_POLE_LENGTH = 1.0  # metres, as in cartpole.xml

_TRAINING_CART, _TEST_CART = (-1.0, 1.0), (-0.1, 0.1)  # metres from the middle
_TRAINING_ANGLE, _TEST_ANGLE = (-0.75 * np.pi, 0.75 * np.pi), (-0.1, 0.1)  # radians from hanging

_POSITION_THRESHOLD = 0.075  # metres
_VELOCITY_THRESHOLD = 0.75  # rad/s
_VELOCITY_BOUND = 10.0  # rad/s; the pole's free fall from upright reaches 7.7
_CART_HALF_WIDTH = 0.16  # metres, as in cartpole.xml
_MARKER_HALF_WIDTH = 0.07  # metres
# The tip's height alone would let the cart stand 0.38 m to the side of the marker. "Below" it means
# that some of the cart is below some of the marker.
_CART_THRESHOLD = _CART_HALF_WIDTH + _MARKER_HALF_WIDTH

_TIP_BOUND = 2.0  # metres to either side; beyond lies nothing that helps

_SUBGOAL_SPACE = goal_space.GoalSpace(
    names=("tip_x", "tip_z", "angular_velocity"),
    units=("m", "m", "rad/s"),
    low=np.array([-_TIP_BOUND, _RAIL_HEIGHT - _POLE_LENGTH, -_VELOCITY_BOUND]),
    high=np.array([_TIP_BOUND, _RAIL_HEIGHT + _POLE_LENGTH, _VELOCITY_BOUND]),
    threshold=np.array([_POSITION_THRESHOLD, _POSITION_THRESHOLD, _VELOCITY_THRESHOLD]),
)

_GOAL_SPACE = goal_space.GoalSpace(
    names=(*_SUBGOAL_SPACE.names, "cart_x"),
    units=(*_SUBGOAL_SPACE.units, "m"),
    low=np.append(_SUBGOAL_SPACE.low, -_RAIL_HALF_LENGTH),
    high=np.append(_SUBGOAL_SPACE.high, _RAIL_HALF_LENGTH),
    threshold=np.append(_SUBGOAL_SPACE.threshold, _CART_THRESHOLD),
)

# The pole upright and still, above the middle of the rail.
_END_GOAL = np.array([0.0, _RAIL_HEIGHT + _POLE_LENGTH, 0.0, 0.0])

# Columns of the readings, in the order of cartpole.xml's sensors.
_TIP_X, _TIP_Z, _CART_X, _CART_VELOCITY, _ANGLE, _ANGULAR_VELOCITY = 0, 2, 3, 4, 5, 6

_SPEC = task_spec.TaskSpec(
    title="A cart on a rail must swing up its pole and slow it down near a marker, with the cart "
    "below.",
    control_timestep=0.0175,  # seconds
    max_steps=500,
    horizons=_HORIZONS,
    goal_space=_GOAL_SPACE,
    subgoal_space=_SUBGOAL_SPACE,
    observation={
        "cart_position": (_RAIL_HALF_LENGTH,),
        "angle": (1.0, 1.0),
        "cart_velocity": (5.0,),
        "angular_velocity": (10.0,),
    },
    action_bounds=assets.action_bounds(_MJCF),
)

_MARKER_RADIUS = 0.075  # metres
_CAMERAS = {
    "front": scenes.Camera((0, -5.2, 1.5), (1, 0, 0, 0, 0.05, 1), 40),
    "side": scenes.Camera((3.2, -3.8, 2.3), (0.76, 0.64, 0, -0.16, 0.19, 0.97)),
}


class Cartpole(base.GoalTask):
    """Swing the pole up by pushing the cart, and be still with the cart below the marker."""

    def __init__(self, test: bool):
        """Initialises the task; `test` starts episodes hanging near the middle of the rail."""
        self._goal_marker = markers.Marker(
            "goal", "cube", markers.GOAL_RGBA, (_MARKER_HALF_WIDTH,) * 3
        )
        self._subgoal_markers = markers.subgoal_markers("sphere", (_MARKER_RADIUS,))
        super().__init__(
            scenes.build(assets.load_mjcf(_MJCF), cameras=_CAMERAS),
            _SPEC,
            markers=[self._goal_marker, *self._subgoal_markers],
            test=test,
        )

    def observation_parts(self, readings):
        angle = readings[..., _ANGLE]
        return {
            "cart_position": readings[..., [_CART_X]],
            "angle": np.stack([np.sin(angle), np.cos(angle)], axis=-1),
            "cart_velocity": readings[..., [_CART_VELOCITY]],
            "angular_velocity": readings[..., [_ANGULAR_VELOCITY]],
        }

    def achieved_goal(self, readings):
        return readings[..., [_TIP_X, _TIP_Z, _ANGULAR_VELOCITY, _CART_X]]

    def achieved_subgoal(self, readings):
        return readings[..., [_TIP_X, _TIP_Z, _ANGULAR_VELOCITY]]

    def sample_episode(self, physics, random_state, test):
        cart = random_state.uniform(*(_TEST_CART if test else _TRAINING_CART))
        angle = random_state.uniform(*(_TEST_ANGLE if test else _TRAINING_ANGLE))
        physics.data.qpos[:] = cart, angle
        physics.data.qvel[:] = 0.0
        return _END_GOAL

    def place_goal_marker(self, physics, goal):
        self._goal_marker.show_in_plane(physics, goal)

    def place_subgoal_marker(self, physics, level, subgoal):
        self._subgoal_markers[level].show_in_plane(physics, subgoal)


@registry.add(_SPEC)
def cartpole_swingup(test: bool = False) -> Cartpole:
    return Cartpole(test)
