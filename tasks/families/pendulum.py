"""The pendulum tasks: swing up and touch the peak, or swing up and come to rest there.

The motor is too weak to lift the bob directly: it must swing to and fro first. The goal is the
same in every episode.

Test starts: hanging, the angle uniform within 0.3 rad. Training starts: the angle uniform over
everything but the 45 degrees either side of upright. All start at rest.
"""

import dataclasses

import numpy as np

from tasks import assets, base, goal_space, markers, registry, scenes, task_spec

_MJCF = "pendulum.xml"
_SUBSTEPS = 2  # physics steps in a control step

_PIVOT_HEIGHT = 0.8  # metres, as in pendulum.xml
_LENGTH = 0.5  # metres from the pivot to the tip, as in pendulum.xml
_PEAK = (0.0, _PIVOT_HEIGHT + _LENGTH)  # tip x, z in metres

# Radians from hanging.
_TRAINING_START = (-0.75 * np.pi, 0.75 * np.pi)
_TEST_START = (-0.3, 0.3)

_POSITION_THRESHOLD = 0.075  # metres
_VELOCITY_THRESHOLD = 0.75  # rad/s
_VELOCITY_BOUND = 15.0  # rad/s; free fall from the peak reaches 8.9

_TIP_SPACE = goal_space.GoalSpace(
    names=("tip_x", "tip_z"),
    units=("m", "m"),
    low=np.array([-_LENGTH, _PIVOT_HEIGHT - _LENGTH]),
    high=np.array([_LENGTH, _PIVOT_HEIGHT + _LENGTH]),
    threshold=np.array([_POSITION_THRESHOLD, _POSITION_THRESHOLD]),
)

_TIP_AND_VELOCITY_SPACE = goal_space.GoalSpace(
    names=(*_TIP_SPACE.names, "angular_velocity"),
    units=(*_TIP_SPACE.units, "rad/s"),
    low=np.append(_TIP_SPACE.low, -_VELOCITY_BOUND),
    high=np.append(_TIP_SPACE.high, _VELOCITY_BOUND),
    threshold=np.append(_TIP_SPACE.threshold, _VELOCITY_THRESHOLD),
)

# From test starts, a sampling planner (tests/tasks/planner.py) takes about 92 steps of 0.025 s to
# touch the peak and 120 of 0.02 s to come to rest there.
_CLIMB = task_spec.TaskSpec(
    title="Swing up a pendulum until its tip touches the peak. Its motor is too weak to lift it at "
    "once, so it must swing to and fro first.",
    control_timestep=0.025,  # seconds
    max_steps=300,
    goal_space=_TIP_SPACE,
    subgoal_space=_TIP_SPACE,
    observation={"angle": (1.0, 1.0), "angular_velocity": (10.0,)},
    action_bounds=assets.action_bounds(_MJCF),
)

_BALANCE = dataclasses.replace(
    _CLIMB,
    title="Swing up a pendulum and bring it to rest at the peak. Its motor is too weak to lift it "
    "at once, so it must swing to and fro first.",
    control_timestep=0.02,
    max_steps=400,
    goal_space=_TIP_AND_VELOCITY_SPACE,
    subgoal_space=_TIP_AND_VELOCITY_SPACE,
)

_MARKER_RADIUS = 0.06  # metres
_CAMERAS = {
    "front": scenes.Camera((0.0, -2.3, 1.0), (1, 0, 0, 0, 0.08, 1), 42),
    "side": scenes.Camera((1.6, -1.7, 1.4), (0.73, 0.69, 0, -0.2, 0.22, 0.95)),
}


# Columns of the readings, in the order of pendulum.xml's sensors.
_TIP_X, _TIP_Z, _ANGLE, _ANGULAR_VELOCITY = 0, 2, 3, 4


class Pendulum(base.GoalTask):
    """Swing the pendulum to its peak; with a velocity in the goal space, come to rest there."""

    def __init__(self, spec: task_spec.TaskSpec, goal: tuple[float, ...], *, test: bool):
        """Initialises the task.

        Args:
          spec: its space of goals and subgoals alike is tip x, z and perhaps angular velocity.
          goal: the end goal, the same in every episode.
          test: whether episodes begin hanging rather than anywhere.
        """
        arena = scenes.build(assets.load_mjcf(_MJCF), cameras=_CAMERAS)
        arena.mjcf_model.option.timestep = spec.control_timestep / _SUBSTEPS
        self._end_goal = np.array(goal)
        self._goal_marker = markers.Marker("goal", "cube", markers.GOAL_RGBA, (0.05, 0.05, 0.05))
        self._subgoal_markers = markers.subgoal_markers("sphere", (_MARKER_RADIUS,))
        shown = [self._goal_marker, *self._subgoal_markers]
        super().__init__(arena, spec, markers=shown, test=test)

    def observation_parts(self, readings):
        angle = readings[..., _ANGLE]
        return {
            "angle": np.stack([np.sin(angle), np.cos(angle)], axis=-1),
            "angular_velocity": readings[..., [_ANGULAR_VELOCITY]],
        }

    def achieved_goal(self, readings):
        columns = [_TIP_X, _TIP_Z, _ANGULAR_VELOCITY]
        return readings[..., columns[: self.spec.goal_space.dim]]

    def achieved_subgoal(self, readings):
        return self.achieved_goal(readings)

    def sample_episode(self, physics, random_state, test):
        physics.data.qpos[0] = random_state.uniform(*(_TEST_START if test else _TRAINING_START))
        physics.data.qvel[0] = 0.0
        return self._end_goal

    def place_goal_marker(self, physics, goal):
        self._goal_marker.show_in_plane(physics, goal)

    def place_subgoal_marker(self, physics, level, subgoal):
        self._subgoal_markers[level].show_in_plane(physics, subgoal)


@registry.add(_CLIMB)
def pendulum_climb(test: bool = False) -> Pendulum:
    return Pendulum(_CLIMB, _PEAK, test=test)


@registry.add(_BALANCE)
def pendulum_balance(test: bool = False) -> Pendulum:
    return Pendulum(_BALANCE, (*_PEAK, 0.0), test=test)
