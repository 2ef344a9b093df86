"""Reacher: the body fingertip is to come to a place that it can reach.

Begun by launch/new_task.py from reacher.xml; it is yours now.
docs/your_own_task.md explains the parts.
"""

from pathlib import Path

import numpy as np
from dm_control import composer

from tasks import assets, base, goal_space, markers, registry, task_spec

_MJCF = str(Path(__file__).resolve().with_suffix(".xml"))

# The joints that are driven, and where they are at starts: radians, or metres for slides.
_JOINTS = ("joint0", "joint1")
_START_LOW = np.array([-3.14, -3.0])
_START_HIGH = np.array([3.14, 3.0])
_REST = np.array([0.0, 0.0])  # in the model as it is written

# Readings are the sensors of the model, in its order. The last of them were added for this task:
# each joint's position and velocity by turns, then the place of fingertip.
_POSITIONS = [0, 2]
_VELOCITIES = [1, 3]
_PLACE = [4, 5]

_SPACE = goal_space.GoalSpace(
    names=("fingertip_x", "fingertip_y"),
    units=("m", "m"),
    low=np.array([-0.231, -0.229]),
    high=np.array([0.231, 0.231]),
    threshold=np.array([0.0168, 0.0168]),  # how near counts as achieved
)

_SPEC = task_spec.TaskSpec(
    title="Bring the body fingertip to the marker.",
    control_timestep=0.02,  # seconds
    max_steps=200,  # about three times what a good policy takes
    goal_space=_SPACE,
    subgoal_space=_SPACE,
    # What each number is divided by, to come out about [-1, 1].
    observation={
        "positions": (1.0, 1.0, 1.0, 1.0),
        "velocities": (75.0, 31.0),
        "place": (0.21, 0.21),
    },
    action_bounds=assets.action_bounds(_MJCF),
)


class Reacher(base.GoalTask):
    """Reacher; see the module."""

    def __init__(self, test: bool):
        """Initialises the task; `test`: whether episodes begin from test starts."""
        arena = composer.Arena(xml_path=_MJCF)
        self._goal_marker = markers.Marker("goal", "sphere", markers.GOAL_RGBA, (0.0126,))
        self._subgoal_markers = markers.subgoal_markers("sphere", (0.0126,))
        shown = [self._goal_marker, *self._subgoal_markers]
        super().__init__(arena, _SPEC, markers=shown, test=test)

    def observation_parts(self, readings):
        positions = readings[..., _POSITIONS]
        return {
            "positions": np.concatenate([np.sin(positions), np.cos(positions)], axis=-1),
            "velocities": readings[..., _VELOCITIES],
            "place": readings[..., _PLACE],
        }

    def achieved_goal(self, readings):
        return readings[..., _PLACE]

    def achieved_subgoal(self, readings):
        return self.achieved_goal(readings)

    def sample_episode(self, physics, random_state, test):
        """The goal is where a random posture has the point; the start is another posture.

        Tests begin near the posture of the model as it is written; training begins anywhere.
        """
        goal = self._place(physics, random_state.uniform(_START_LOW, _START_HIGH))
        physics.data.qvel[:] = 0.0

        def propose():
            anywhere = random_state.uniform(_START_LOW, _START_HIGH)
            rest = np.clip(_REST, _START_LOW, _START_HIGH)
            posture = rest + 0.1 * (anywhere - rest) if test else anywhere
            return self._place(physics, posture)

        self.draw("start", propose, lambda place: not _SPACE.achieved(place, goal))
        return goal

    def _place(self, physics, posture):
        """Puts the joints into a posture, and returns where the point then is."""
        for name, value in zip(_JOINTS, posture, strict=True):
            physics.named.data.qpos[name] = value
        physics.forward()
        return physics.data.sensordata[_PLACE].copy()

    def place_goal_marker(self, physics, goal):
        self._goal_marker.show(physics, self._in_space(goal))

    def place_subgoal_marker(self, physics, level, subgoal):
        marker = self._subgoal_markers[level]
        if subgoal is None:
            marker.hide(physics)
        else:
            marker.show(physics, self._in_space(subgoal))

    def _in_space(self, place):
        """A place in x, y, z; coordinates that never change are those of the model."""
        point = np.array([0.000136, 0.00102, 0.01])
        point[[0, 1]] = place
        return point


@registry.add(_SPEC)
def reacher(test: bool = False) -> Reacher:
    return Reacher(test)
