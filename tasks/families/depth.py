"""The same motion in more decisions: two of the suite's tasks at 1, 2 and 4 times their rate.

Where does a second subgoal layer start to pay? `python -m analysis.depth` answers that on these
tasks. They are not in `tasks.ALL`: `tasks.find("tasks/families/depth.py:ur5_reacher_400")` finds
one.

Starts, goals, thresholds, torques and the seconds of an episode are those of the suite's task; only
the decisions are closer together. At the suite's own rate it is the suite's task, bit for bit.

The physics step stays the suite's as far as the control step allows. At twice the rate they are
equal, so that an action held for two decisions moves the arm bit for bit as at the suite's rate. At
four times, the physics step is half as long: the same motion, integrated a little more finely. The
goal, and whether the worm's gripper is near enough to grasp the rod, are checked two or four times
as often.
"""

import dataclasses
from collections.abc import Mapping

from tasks import registry, task_spec
from tasks.families import pick_place, ur5_reacher

Attempts = tuple[int, ...]  # (T_0, ..., T_n)


def attempts(coarse: Attempts, rate: int) -> Attempts:
    """T of an agent that decides `rate` times as often as one whose T is `coarse`.

    Level 0 has `rate` times the attempts, and the levels above as many as before. So a goal of any
    level lasts as many seconds as at the suite's rate. The rule is the same for every agent;
    without subgoal layers, T_0 is `max_steps`.

        attempts((6, 6, 6), 2) == (12, 6, 6)
    """
    lowest, *above = coarse
    return (rate * lowest, *above)


def finer(
    spec: task_spec.TaskSpec, rate: int, coarse: Mapping[int, Attempts]
) -> task_spec.TaskSpec:
    """The spec of a task with `rate` times the decisions, in as many seconds.

    Args:
      coarse: by number of subgoal layers, the T of agents at the rate of `spec`.
    """
    return dataclasses.replace(
        spec,
        control_timestep=spec.control_timestep / rate,
        max_steps=spec.max_steps * rate,
        horizons={layers: attempts(own, rate) for layers, own in coarse.items()},
    )


# T of the suite's agents: its tasks' own where they have one, else the least equal T_i.
_SUITE = {
    "ur5_reacher": {1: (15, 15), 2: (6, 6, 6)},
    "pick_place": {1: (30, 10), 2: (7, 7, 7)},
}


def _specs(name: str) -> dict[int, task_spec.TaskSpec]:
    """By number of decisions in an episode, the specs of a task of the suite."""
    entry = registry.get(name)
    assert entry is not None  # its module was imported above
    found = [finer(entry.spec, rate, _SUITE[name]) for rate in (1, 2, 4)]
    return {spec.max_steps: spec for spec in found}


_UR5 = _specs("ur5_reacher")
_PICK = _specs("pick_place")


@registry.add(_UR5[200])
def ur5_reacher_200(test: bool = False) -> ur5_reacher.UR5Reacher:
    return ur5_reacher.UR5Reacher(test, _UR5[200])


@registry.add(_UR5[400])
def ur5_reacher_400(test: bool = False) -> ur5_reacher.UR5Reacher:
    return ur5_reacher.UR5Reacher(test, _UR5[400])


@registry.add(_UR5[800])
def ur5_reacher_800(test: bool = False) -> ur5_reacher.UR5Reacher:
    return ur5_reacher.UR5Reacher(test, _UR5[800])


@registry.add(_PICK[300])
def pick_place_300(test: bool = False) -> pick_place.PickPlace:
    return pick_place.PickPlace(test, _PICK[300])


@registry.add(_PICK[600])
def pick_place_600(test: bool = False) -> pick_place.PickPlace:
    return pick_place.PickPlace(test, _PICK[600])


@registry.add(_PICK[1200])
def pick_place_1200(test: bool = False) -> pick_place.PickPlace:
    return pick_place.PickPlace(test, _PICK[1200])
