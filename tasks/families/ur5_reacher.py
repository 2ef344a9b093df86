"""UR5 reacher: bring the effector of a UR5 to a random point, about a quarter turn away.

The arm has the real robot's kinematics, link masses, torque and speed limits; its weight is
compensated, as the real controller does.

A goal is where the effector is in some configuration of the arm, so it is within reach. Both its
shoulder pan and its direction from the base differ from the start's by 45 to 135 degrees, to
either side.

Test starts: the arm bent with the gripper pointing down, each joint within 0.1 rad of that and
the pan within 0.3. Training starts: pan within 90 degrees, shoulder, elbow and the first two wrist
joints anywhere in ranges of 97 to 120 degrees, the last wrist joint anywhere. All start at rest,
wrist and effector clear of the floor.
"""

import numpy as np

from tasks import assets, base, goal_space, markers, registry, scenes, task_spec
from tasks.robots import ur5

# Radians: shoulder pan, shoulder lift, elbow, wrists 1, 2 and 3.
_TEST_JOINTS = np.array([0.0, -1.9, 2.2, -1.87, -np.pi / 2, 0.0])
_TEST_SPREAD = np.array([0.3, 0.1, 0.1, 0.1, 0.1, 0.1])
_TRAINING_LOW = np.array([-np.pi / 2, -2.4, 0.4, -2.9, -2.6, -np.pi])
_TRAINING_HIGH = np.array([np.pi / 2, -0.7, 2.5, -0.9, -0.6, np.pi])
# Goals come from these joints, and a pan turned from the start's by an angle in _TURN.
_GOAL_LOW = np.array([-2.2, 0.6, -2.5, -2.2, -np.pi])
_GOAL_HIGH = np.array([-0.7, 2.4, -1.0, -0.9, np.pi])
_TURN = (np.pi / 4, 3 * np.pi / 4)
_PAN_LIMIT = 3.0  # radians, for goals; the joint turns a little farther

_CLEARANCE = 0.1  # metres from the floor to the wrist and the effector
_LEAST_RADIUS = 0.2  # metres from the base's axis; nearer, a direction means little

_THRESHOLD = 0.07  # metres, in every dimension
_REACH = 0.95  # metres from the base's axis to the effector

_EFFECTOR_SPACE = goal_space.GoalSpace(
    names=("effector_x", "effector_y", "effector_z"),
    units=("m", "m", "m"),
    low=np.array([-_REACH, -_REACH, 0.0]),
    high=np.array([_REACH, _REACH, 1.05]),
    threshold=np.full(3, _THRESHOLD),
)

# Columns of the readings, in the order of ur5.xml's sensors.
_COLUMNS = {"joints": slice(0, 6), "joint_velocities": slice(6, 12), "effector": slice(12, 15)}

_SPEC = task_spec.TaskSpec(
    title="A UR5 arm must bring its gripper to a point a quarter turn away.",
    control_timestep=0.01,  # seconds
    max_steps=200,
    goal_space=_EFFECTOR_SPACE,
    subgoal_space=_EFFECTOR_SPACE,
    observation={
        "joints": (np.pi,) * 6,
        "joint_velocities": (ur5.SPEED_LIMIT,) * 6,
        "effector": (1.0, 1.0, 1.0),
    },
    action_bounds=assets.action_bounds(ur5.MJCF),
)

_CAMERAS = {
    "front": scenes.Camera((-1.7, 0.0, 1.15), (0, -1, 0, 0.42, 0, 0.91)),
    "side": scenes.Camera((-1.0, -1.35, 1.15), (0.8, -0.6, 0, 0.25, 0.34, 0.91)),
}
_GOAL_SIZE = (0.05, 0.05, 0.05)  # metres, half edges
_SUBGOAL_SIZE = (0.04, 0.04, 0.04)


class UR5Reacher(base.GoalTask):
    """Reach the goal with the effector, at any speed."""

    def __init__(self, test: bool, spec: task_spec.TaskSpec = _SPEC):
        """Initialises the task.

        Args:
          test: whether episodes begin from the test starts.
          spec: another control step or number of them; everything else as in the suite's task. A
            control step below the arm's physics step makes that as short.
        """
        self._goal_marker = markers.Marker("goal", "cube", markers.GOAL_RGBA, _GOAL_SIZE)
        self._subgoal_markers = markers.subgoal_markers("cube", _SUBGOAL_SIZE)
        arena = scenes.build(ur5.UR5(), cameras=_CAMERAS, solid_floor=True)
        option = arena.mjcf_model.option
        option.timestep = min(option.timestep, spec.control_timestep)
        super().__init__(
            arena,
            spec,
            markers=[self._goal_marker, *self._subgoal_markers],
            test=test,
        )

    def observation_parts(self, readings):
        return {name: readings[..., columns] for name, columns in _COLUMNS.items()}

    def achieved_goal(self, readings):
        return readings[..., _COLUMNS["effector"]]

    def achieved_subgoal(self, readings):
        return self.achieved_goal(readings)

    def sample_episode(self, physics, random_state, test):
        if test:
            low, high = _TEST_JOINTS - _TEST_SPREAD, _TEST_JOINTS + _TEST_SPREAD
        else:
            low, high = _TRAINING_LOW, _TRAINING_HIGH
        start = self.draw(
            "start of the arm clear of the floor",
            lambda: random_state.uniform(low, high),
            lambda joints: _is_clear(ur5.frame_positions(joints)),
        )
        physics.data.qpos[:] = start
        physics.data.qvel[:] = 0.0
        return self._sample_goal(random_state, start)

    def _sample_goal(self, random_state, start: np.ndarray) -> np.ndarray:
        """Draws a point [3] for the effector, given the joints [6] at the start."""
        start_direction = _direction(ur5.effector_position(start))

        def propose() -> np.ndarray:
            pan = start[0] + random_state.choice([-1.0, 1.0]) * random_state.uniform(*_TURN)
            return np.array([pan, *random_state.uniform(_GOAL_LOW, _GOAL_HIGH)])

        def accept(joints: np.ndarray) -> bool:
            positions = ur5.frame_positions(joints)
            turn = _direction(positions[-1]) - start_direction
            turn = abs((turn + np.pi) % (2 * np.pi) - np.pi)
            return (
                abs(joints[0]) <= _PAN_LIMIT
                and _is_clear(positions)
                and np.hypot(*positions[-1, :2]) >= _LEAST_RADIUS
                and _TURN[0] <= turn <= _TURN[1]
            )

        return ur5.effector_position(self.draw("goal for the effector", propose, accept))

    def place_goal_marker(self, physics, goal):
        self._goal_marker.show(physics, goal)

    def place_subgoal_marker(self, physics, level, subgoal):
        if subgoal is None:
            self._subgoal_markers[level].hide(physics)
        else:
            self._subgoal_markers[level].show(physics, subgoal)


def _is_clear(positions: np.ndarray) -> bool:
    """Whether wrist and effector, the last two of the DH frames [6, 3], are clear of the floor."""
    return bool((positions[-2:, 2] >= _CLEARANCE).all())


def _direction(position: np.ndarray) -> float:
    """The direction of a point [3] from the base's axis, in radians about the vertical."""
    return float(np.arctan2(position[1], position[0]))


@registry.add(_SPEC)
def ur5_reacher(test: bool = False) -> UR5Reacher:
    return UR5Reacher(test)
