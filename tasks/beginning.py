"""A task of one's own begun from a model: MJCF in; a working task file and a fuller model out."""

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

_CONTROL = 0.02  # seconds between actions, about
_MAX_STEPS = 200
_DRAWS = 2000  # random postures, to see where the point comes
_PLAYED = 4000  # control steps of random actions, to see how fast joints turn
_SAME = 1e-3  # a coordinate of the point that moves less is none of the goal's
_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_AXES = "xyz"


class Joint(NamedTuple):
    """A joint that the agent drives."""

    name: str
    hinge: bool
    low: float  # of starts
    high: float
    limited: bool
    speed: float  # what its velocity is divided by


class Found(NamedTuple):
    """What the task is made from."""

    joints: list[Joint]
    point: str  # the site or body whose place is the goal
    kind: str  # site or body
    axes: list[int]  # the coordinates of the point that move
    low: np.ndarray  # [3] where it comes
    high: np.ndarray
    control_timestep: float
    first: int  # the first of the readings that are ours


class Begun(NamedTuple):
    """A task that somebody else goes on with."""

    code: str  # Python
    xml: str  # MJCF
    notes: list[str]  # what a person should know of it


def begin(name: str, model: Path, point: str | None = None) -> Begun:
    """The Python and the MJCF of a task for a model.

    Args:
      point: the site or body that is to come to the goal; None takes the end of the chain.

    Raises:
      ValueError: it is none to begin from; one line says why.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(model))
        compiled = spec.compile()
    except Exception as error:  # MuJoCo's parser raises ValueError and others
        reason = " ".join(str(error).split())
        raise ValueError(f"{model} is no MJCF that compiles: {reason}") from error
    found = _look(compiled, str(model), point)
    _complete(spec, compiled, found)
    notes: list[str] = []
    if compiled.nmesh or compiled.ntex:  # the copy lies elsewhere than their files
        spec.meshdir, spec.texturedir = (
            str((model.parent / folder).resolve()) for folder in (spec.meshdir, spec.texturedir)
        )
    if spec.option.integrator == int(mujoco.mjtIntegrator.mjINT_RK4):
        spec.option.integrator = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
        notes.append("the integrator RK4, which training cannot step, became implicitfast")
    spec.modelname = name
    spec.compile()
    return Begun(_code(name, model, found), spec.to_xml(), notes)


# -- What the model is


def _look(model: mujoco.MjModel, path: str, point: str | None) -> Found:
    if not model.nu:
        raise ValueError(f"{path} has no actuators: there is nothing to act with")
    free = [model.actuator(i).name or str(i) for i in range(model.nu)
            if not model.actuator_ctrllimited[i]]  # fmt: skip
    if free:
        raise ValueError(f"{path}: actuator {free[0]} has no ctrlrange; actions are bounded")
    driven = _driven(model)
    if not driven:
        raise ValueError(f"{path} has no hinges or slides: write its task by hand")
    unnamed = [i for i in driven if not model.joint(i).name]
    if unnamed:
        raise ValueError(f"{path}: joint {unnamed[0]} has no name; give it one")
    point, kind = _point(model, path, driven, point)
    places = _places(model, driven, point, kind)
    low, high = places.min(axis=0), places.max(axis=0)
    axes = [i for i in range(3) if high[i] - low[i] > _SAME]
    if not axes:
        raise ValueError(f"{path}: {kind} {point} stays where it is; name another with --point")
    substeps = max(1, round(_CONTROL / model.opt.timestep))
    speeds = _speeds(model, substeps)
    joints = [_joint(model, i, speeds) for i in driven]
    return Found(
        joints, point, kind, axes, low, high, substeps * model.opt.timestep, model.nsensordata
    )


def _driven(model: mujoco.MjModel) -> list[int]:
    """Hinges and slides that actuators act on; all, where actuators act on something else."""
    simple = [i for i in range(model.njnt) if model.jnt_type[i] in (_HINGE, _SLIDE)]
    on_joints = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
    if not on_joints.all():
        return simple
    acted = {int(i) for i in model.actuator_trnid[:, 0]}
    return [i for i in simple if i in acted]


def _point(
    model: mujoco.MjModel, path: str, driven: list[int], name: str | None
) -> tuple[str, str]:
    """The site or body of this name; without one, the end of the chain that is driven."""
    sites = {model.site(i).name for i in range(model.nsite)} - {""}
    bodies = {model.body(i).name: i for i in range(1, model.nbody) if model.body(i).name}
    if name is not None and name in sites:
        return name, "site"
    if name is not None and name not in bodies:
        raise ValueError(f"{path} has no site or body {name!r}; it has "
                           f"{', '.join([*sorted(sites), *bodies])}")  # fmt: skip
    if name is not None:
        return name, "body"
    moved = {int(model.jnt_bodyid[i]) for i in driven}
    depth = {i: _depth(model, i, moved) for i in bodies.values()}
    deepest = [i for i in bodies.values() if depth[i] and depth[i] == max(depth.values())]
    if not deepest:
        raise ValueError(f"{path}: no body with a name moves; give the hand one")
    return model.body(deepest[-1]).name, "body"


def _depth(model: mujoco.MjModel, body: int, moved: set[int]) -> int:
    """How many bodies there are from one down to the first that is moved; 0: it does not move."""
    depth = reached = 0
    while body:
        depth += 1
        reached = depth if body in moved else reached
        body = int(model.body_parentid[body])
    return depth if reached else 0


def _range(model: mujoco.MjModel, joint: int) -> tuple[float, float]:
    if model.jnt_limited[joint]:
        return tuple(map(float, model.jnt_range[joint]))  # type: ignore[return-value]
    return (-np.pi, np.pi) if model.jnt_type[joint] == _HINGE else (-1.0, 1.0)


def _places(model: mujoco.MjModel, driven: list[int], point: str, kind: str) -> np.ndarray:
    """[K, 3] where the point is in random postures."""
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    places = []
    for _ in range(_DRAWS):
        for i in driven:
            data.qpos[model.jnt_qposadr[i]] = rng.uniform(*_range(model, i))
        mujoco.mj_kinematics(model, data)
        at = data.site(point).xpos if kind == "site" else data.body(point).xpos
        places.append(at.copy())
    return np.array(places)


def _speeds(model: mujoco.MjModel, substeps: int) -> np.ndarray:
    """[V] how fast each degree of freedom becomes under random actions, held for a while."""
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    seen = []
    for step in range(_PLAYED):
        if step % 400 == 0:
            mujoco.mj_resetData(model, data)
        if step % 10 == 0:
            data.ctrl[:] = rng.uniform(*model.actuator_ctrlrange.T)
        mujoco.mj_step(model, data, substeps)
        seen.append(np.abs(data.qvel))
    return np.quantile(np.nan_to_num(seen), 0.98, axis=0)


def _joint(model: mujoco.MjModel, i: int, speeds: np.ndarray) -> Joint:
    low, high = _range(model, i)
    speed = float(f"{max(speeds[model.jnt_dofadr[i]], 1e-2):.2g}")
    hinge, limited = model.jnt_type[i] == _HINGE, bool(model.jnt_limited[i])
    return Joint(model.joint(i).name, bool(hinge), low, high, limited, speed)


# -- What is added to it


def _complete(spec: mujoco.MjSpec, model: mujoco.MjModel, found: Found) -> None:
    """Adds the sensors that the task reads, and a camera and a light where there are none."""
    joint, frame = mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_BODY
    for each in found.joints:
        for kind in (mujoco.mjtSensor.mjSENS_JOINTPOS, mujoco.mjtSensor.mjSENS_JOINTVEL):
            spec.add_sensor(type=kind, objtype=joint, objname=each.name)
    if found.kind == "site":
        frame = mujoco.mjtObj.mjOBJ_SITE
    spec.add_sensor(type=mujoco.mjtSensor.mjSENS_FRAMEPOS, objtype=frame, objname=found.point)
    centre, extent = np.array(model.stat.center), float(model.stat.extent)
    if not model.ncam:
        away = np.array([0.0, -1.0, 0.9])
        spec.worldbody.add_camera(
            name="oblique",
            pos=centre + 1.4 * extent * away,
            quat=_looking_along(-away),
        )
    if not model.nlight:
        spec.worldbody.add_light(
            name="key",
            pos=centre + extent * np.array([0.5, -1.0, 3.0]),
            dir=[-0.1, 0.3, -0.9],
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        )


def _looking_along(direction: np.ndarray) -> np.ndarray:
    """The quaternion of a camera that looks that way, x to its right."""
    z = -direction / np.linalg.norm(direction)
    x = np.array([1.0, 0.0, 0.0])
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.stack([x, np.cross(z, x), z], axis=1).ravel())
    return quaternion


# -- The file

_CODE = '''\
"""{title}: the {kind} {point} is to come to a place that it can reach.

Begun by launch/new_task.py from {model}; it is yours now. docs/your_own_task.md explains the parts.
"""

from pathlib import Path

import numpy as np
from dm_control import composer

from tasks import assets, base, goal_space, markers, registry, task_spec

_MJCF = str(Path(__file__).resolve().with_suffix(".xml"))

# The joints that are driven, and where they are at starts: radians, or metres for slides.
_JOINTS = {names}
_START_LOW = np.array({low})
_START_HIGH = np.array({high})

# Readings are the sensors of the model, in its order. The last of them were added for this task:
# each joint's position and velocity by turns, then the place of {point}.
_POSITIONS = {positions}
_VELOCITIES = {velocities}
_PLACE = {place}

_SPACE = goal_space.GoalSpace(
    names={goal_names},
    units={units},
    low=np.array({goal_low}),
    high=np.array({goal_high}),
    threshold=np.array({threshold}),  # how near counts as achieved
)

_SPEC = task_spec.TaskSpec(
    title="Bring the {kind} {point} to the marker.",
    control_timestep={control},  # seconds
    max_steps={max_steps},  # about three times what a good policy takes
    goal_space=_SPACE,
    subgoal_space=_SPACE,
    # What each number is divided by, to come out about [-1, 1].
    observation={{
        "positions": {position_scale},
        "velocities": {speeds},
        "place": {place_scale},
    }},
    action_bounds=assets.action_bounds(_MJCF),
)


class {title}(base.GoalTask):
    """{title}; see the module."""

    def __init__(self, test: bool):
        """Initialises the task; `test`: whether episodes begin from test starts."""
        arena = composer.Arena(xml_path=_MJCF)
        self._goal_marker = markers.Marker("goal", "sphere", markers.GOAL_RGBA, ({marker},))
        self._subgoal_markers = markers.subgoal_markers("sphere", ({marker},))
        shown = [self._goal_marker, *self._subgoal_markers]
        super().__init__(arena, _SPEC, markers=shown, test=test)

    def observation_parts(self, readings):
        positions = readings[..., _POSITIONS]
        return {{
            "positions": {position_code},
            "velocities": readings[..., _VELOCITIES],
            "place": readings[..., _PLACE],
        }}

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
            rest = np.clip(np.zeros(len(_JOINTS)), _START_LOW, _START_HIGH)
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
        point = np.array({middle})
        point[{axes}] = place
        return point


@registry.add(_SPEC)
def {name}(test: bool = False) -> {title}:
    return {title}(test)
'''


def _code(name: str, model: Path, found: Found) -> str:
    """The Python of the task."""
    joints, first, axes = found.joints, found.first, found.axes
    count = len(joints)
    width = found.high - found.low
    whole = [joint.hinge and not joint.limited for joint in joints]
    low, high = (np.array(end)[axes] for end in (found.low, found.high))
    margin = 0.05 * (high - low)
    largest = np.maximum(np.abs(low), np.abs(high))
    return _CODE.format(
        title="".join(word.capitalize() for word in name.split("_")),
        name=name,
        kind=found.kind,
        point=found.point,
        model=model.name,
        names=_tuple(repr(joint.name).replace("'", '"') for joint in joints),
        low=_list(joint.low for joint in joints),
        high=_list(joint.high for joint in joints),
        positions=list(range(first, first + 2 * count, 2)),
        velocities=list(range(first + 1, first + 2 * count, 2)),
        place=[first + 2 * count + axis for axis in axes],
        goal_names=_tuple(f'"{found.point}_{_AXES[axis]}"' for axis in axes),
        units=_tuple('"m"' for _ in axes),
        goal_low=_list(low - margin),
        goal_high=_list(high + margin),
        threshold=_list([0.04 * width.max()] * len(axes)),
        control=float(f"{found.control_timestep:.6g}"),
        max_steps=_MAX_STEPS,
        position_scale=_tuple(
            ["1.0"] * 2 * count if any(whole) else
            [_text(max(abs(joint.low), abs(joint.high))) for joint in joints]
        ),
        speeds=_tuple(_text(joint.speed) for joint in joints),
        place_scale=_tuple(map(_text, np.maximum(largest, 0.1 * width.max()))),
        position_code=(
            "np.concatenate([np.sin(positions), np.cos(positions)], axis=-1)"
            if any(whole) else "positions"
        ),
        marker=_text(0.03 * width.max()),
        middle=_list((found.low + found.high) / 2),
        axes=axes,
    )  # fmt: skip


def _text(value: float) -> str:
    return repr(float(f"{value:.3g}"))


def _list(values) -> str:
    return f"[{', '.join(map(_text, values))}]"


def _tuple(texts) -> str:
    listed = list(texts)
    return f"({', '.join(listed)}{',' if len(listed) == 1 else ''})"
