"""Pick and place: the robot worm picks the blue rod up and brings it to the yellow rod.

The worm moves in the vertical x-z plane. When its gripper comes within 8 cm of the rod's top end,
the task switches on a `connect` constraint between the two, and from then on MuJoCo's solver
carries the rod, which hangs from the gripper and swings. Nothing lets go of it again.

Positions of the rod are those of its centre. A goal is a place for it that is at least 0.3 m from
where the rod starts, clear of the floor, and within the worm's reach when the rod hangs straight
down from the gripper; goals are uniform over that region.

Test starts: the worm upright (each joint within 0.3 rad), the rod standing on the floor 0.35-0.65 m
to its left or right. Training starts: the joints anywhere in their range; in half of the episodes
the rod stands on the floor as in tests, in the other half it already hangs from the gripper.
All start at rest.
"""

import numpy as np
from dm_control import composer

from tasks import assets, base, goal_space, markers, registry, scenes, task_spec
from tasks.robots import worm

_ROD_LENGTH = 0.25  # metres, as in rod.xml
_ROD_RADIUS = 0.024  # metres, as in rod.xml
_ATTACH_DISTANCE = 0.08  # metres from the gripper to the rod's top end

_ROD_START = (0.35, 0.65)  # metres from the base, to either side
_TEST_JOINTS = 0.3  # radians either side of upright
_HELD_SHARE = 0.5  # of the training episodes start with the rod in the gripper
_HELD_TILT = 0.3  # radians either side of hanging straight down
_CLEARANCE = 0.05  # metres that gripper and rod keep from the floor at starts and goals

_GOAL_REACH = (worm.INNER_REACH + 0.05, worm.REACH - 0.05)  # metres from shoulder to gripper
_GOAL_DISTANCE = 0.3  # metres at least between the rod's start and its goal

_THRESHOLD = 0.07  # metres, in every dimension of the rod's place
# A gripper subgoal at the rod's top end, reached within this in x and z, is one that attaches.
_GRIPPER_THRESHOLD = 0.05  # metres; 0.05 * sqrt(2) < _ATTACH_DISTANCE
# Two bends of the arm bring the gripper to a place, and one of them may be a dead end: the shoulder
# at its limit. A subgoal says which.
_ELBOW_THRESHOLD = 0.5  # radians
_TOP = worm.BASE_HEIGHT + worm.REACH  # metres, the highest that the gripper gets
_HANGING = np.array([0.0, -_ROD_LENGTH / 2])  # x, z from the rod's top end to its centre
# A rod standing on the floor has its centre at 0.125 m; one dragged along it gets lower.
_ROD_LOW, _ROD_HIGH = np.array([-worm.REACH, 0.05]), np.array([worm.REACH, _TOP + _HANGING[1]])

_GOAL_SPACE = goal_space.GoalSpace(
    names=("rod_x", "rod_z"),
    units=("m", "m"),
    low=_ROD_LOW,
    high=_ROD_HIGH,
    threshold=np.full(2, _THRESHOLD),
)

_SUBGOAL_SPACE = goal_space.GoalSpace(
    names=("gripper_x", "gripper_z", *_GOAL_SPACE.names, "elbow"),
    units=("m", "m", *_GOAL_SPACE.units, "rad"),
    low=np.array([-worm.REACH, 0.0, *_ROD_LOW, -worm.ELBOW_LIMIT]),
    high=np.array([worm.REACH, _TOP, *_ROD_HIGH, worm.ELBOW_LIMIT]),
    threshold=np.array(
        [_GRIPPER_THRESHOLD, _GRIPPER_THRESHOLD, _THRESHOLD, _THRESHOLD, _ELBOW_THRESHOLD]
    ),
)

# Columns of the readings: worm.xml's sensors, then rod.xml's, then the constraint.
_COLUMNS = {
    "joints": [0, 1],
    "joint_velocities": [2, 3],
    "gripper": [4, 6],
    "rod": [7, 9],
    "rod_top": [10, 12],
    "rod_velocity": [13, 15],
    "rod_axis": [16, 18],
    "rod_spin": [19],
    "attached": [20],
}
_GRASP = 0  # the model's only equality constraint

_SPEC = task_spec.TaskSpec(
    title="A robot worm must pick up the blue rod and bring it to the yellow one.",
    control_timestep=0.015,  # seconds
    max_steps=300,
    horizons={1: (30, 10)},  # T_0 and T_1; the paper has one T for all levels (Section 3.2)
    goal_space=_GOAL_SPACE,
    subgoal_space=_SUBGOAL_SPACE,
    observation={
        "joints": worm.JOINT_LIMITS,
        "joint_velocities": (5.0, 5.0),
        "gripper": (0.8, 0.8),
        "rod": (0.8, 0.8),
        "rod_velocity": (2.0, 2.0),
        "rod_axis": (1.0, 1.0),
        "rod_spin": (5.0,),
        "attached": (1.0,),
        "to_top": (0.4, 0.4),  # from the gripper to the rod's top end
    },
    action_bounds=assets.action_bounds(worm.MJCF),
)

_CAMERAS = {
    "front": scenes.Camera((0.0, -2.0, 0.5), (1, 0, 0, 0, 0.06, 1), 42),
    "side": scenes.Camera((1.1, -1.5, 1.0), (0.81, 0.59, 0, -0.2, 0.27, 0.94)),
}


class Rod(composer.Entity):
    """The blue rod, free in the x-z plane. Its x and z joints read 0 standing at the origin."""

    def _build(self):
        self._mjcf_root = assets.load_mjcf("rod.xml")

    @property
    def mjcf_model(self):
        return self._mjcf_root

    @property
    def top_site(self):
        """The site at the rod's top end, where it is held."""
        return self._mjcf_root.find("site", "top")


class PickPlace(base.GoalTask):
    """Fetch the rod and bring it to the goal."""

    def __init__(self, test: bool, spec: task_spec.TaskSpec = _SPEC):
        """Initialises the task.

        Args:
          test: whether episodes begin from the test starts.
          spec: another control step or number of them; everything else as in the suite's task. A
            control step below the worm's physics step makes that as short.
        """
        self._goal_marker = _rod_marker("goal_rod", markers.GOAL_RGBA)
        self._subgoal_markers = [
            (
                markers.Marker(f"subgoal_{level}_gripper", "sphere", rgba, (0.04,)),
                _rod_marker(f"subgoal_{level}_rod", rgba),
            )
            for level, rgba in enumerate(markers.SUBGOAL_RGBA)
        ]
        arena = _build_arena()
        option = arena.mjcf_model.option
        option.timestep = min(option.timestep, spec.control_timestep)
        super().__init__(
            arena,
            spec,
            markers=[self._goal_marker, *(m for pair in self._subgoal_markers for m in pair)],
            test=test,
        )

    def observation_parts(self, readings):
        to_top = readings[..., _COLUMNS["rod_top"]] - readings[..., _COLUMNS["gripper"]]
        read = [name for name in self.spec.observation if name != "to_top"]
        parts = {name: readings[..., _COLUMNS[name]] for name in read}
        return {**parts, "to_top": to_top}

    def achieved_goal(self, readings):
        return readings[..., _COLUMNS["rod"]]

    def achieved_subgoal(self, readings):
        return readings[..., _COLUMNS["gripper"] + _COLUMNS["rod"] + _COLUMNS["joints"][1:]]

    def event_mask(self, readings):
        """Where the gripper gets hold of the rod."""
        apart = readings[..., _COLUMNS["gripper"]] - readings[..., _COLUMNS["rod_top"]]
        near = np.square(apart).sum(axis=-1) <= _ATTACH_DISTANCE**2
        return near & (readings[..., _COLUMNS["attached"][0]] == 0.0)

    def apply_event(self, physics):
        physics.data.eq_active[_GRASP] = 1

    def sample_episode(self, physics, random_state, test):
        held = not test and random_state.uniform() < _HELD_SHARE
        joints = self._sample_joints(random_state, test, held)
        if held:
            tilt = random_state.uniform(-_HELD_TILT, _HELD_TILT)
            top = worm.grip_position(joints)
            rod = top - _ROD_LENGTH / 2 * np.array([np.sin(tilt), np.cos(tilt)])
        else:
            tilt = 0.0
            side = random_state.choice([-1.0, 1.0])
            rod = np.array([side * random_state.uniform(*_ROD_START), _ROD_LENGTH / 2])
        physics.data.qpos[:] = [*joints, rod[0], rod[1] - _ROD_LENGTH / 2, tilt]
        physics.data.qvel[:] = 0.0
        physics.data.eq_active[_GRASP] = held
        return self._sample_goal(random_state, rod)

    def _sample_joints(self, random_state, test: bool, held: bool) -> np.ndarray:
        limits = _TEST_JOINTS if test else worm.JOINT_LIMITS
        lowest = _CLEARANCE + (_ROD_LENGTH if held else 0.0)
        return self.draw(
            "start of the worm clear of the floor",
            lambda: random_state.uniform(-limits, limits, size=2),
            lambda joints: worm.grip_position(joints)[1] >= lowest,
        )

    def _sample_goal(self, random_state, rod: np.ndarray) -> np.ndarray:
        """Draws a place for the rod's centre [2], given where that is at the start [2]."""
        shoulder = np.array([0.0, worm.BASE_HEIGHT])

        def accept(goal: np.ndarray) -> bool:
            reach = np.linalg.norm(goal - _HANGING - shoulder)
            return bool(
                _GOAL_REACH[0] <= reach <= _GOAL_REACH[1]
                and goal[1] + _HANGING[1] >= _CLEARANCE
                and np.linalg.norm(goal - rod) >= _GOAL_DISTANCE
            )

        return self.draw(
            "goal for the rod", lambda: random_state.uniform(_ROD_LOW, _ROD_HIGH), accept
        )

    def place_goal_marker(self, physics, goal):
        self._goal_marker.show_in_plane(physics, goal)

    def place_subgoal_marker(self, physics, level, subgoal):
        for i, marker in enumerate(self._subgoal_markers[level]):
            marker.show_in_plane(physics, None if subgoal is None else subgoal[2 * i : 2 * i + 2])


def _rod_marker(name: str, rgba) -> markers.Marker:
    # A little thicker than the rod, so that the marker shows when the rod is in it.
    radius = _ROD_RADIUS + 0.006
    return markers.Marker(name, "rod", rgba, (radius, _ROD_LENGTH / 2 - radius))


def _build_arena() -> composer.Arena:
    robot, rod = worm.Worm(), Rod()
    arena = scenes.build(robot, rod, cameras=_CAMERAS, solid_floor=True)
    arena.mjcf_model.equality.add(
        "connect", name="grasp", site1=robot.grip_site, site2=rod.top_site, active="false"
    )
    return arena


@registry.add(_SPEC)
def pick_place(test: bool = False) -> PickPlace:
    return PickPlace(test)
