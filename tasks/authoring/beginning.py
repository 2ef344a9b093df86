"""Writes a task for a model: MJCF in; a working task file and a completed model out."""

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from tasks.authoring.model import Found, look

_MAX_STEPS = 200
_AXES = "xyz"
_IDLE = (
    "no actuator drives {joints}: the task does not observe them or set them at starts; add "
    "sensors and observation_parts for those that matter"
)
_TEMPLATE = Path(__file__).with_name("template.txt")  # of the task file


class Begun(NamedTuple):
    """The start of a task for a user to edit."""

    code: str  # Python
    xml: str  # MJCF
    notes: list[str]  # what a person should know of it


def begin(name: str, model: Path, point: str | None = None) -> Begun:
    """The Python and the MJCF of a task for a model.

    Args:
      point: the site or body that moves to the goal; None takes the end of the chain.

    Raises:
      ValueError: the model cannot be used; one line says why.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(model))
        compiled = spec.compile()
    except Exception as error:  # MuJoCo's parser raises ValueError and others
        reason = " ".join(str(error).split())
        raise ValueError(f"{model} does not compile as MJCF: {reason}") from error
    found = look(compiled, str(model), point)
    _complete(spec, compiled, found)
    notes: list[str] = []
    # The copy lies elsewhere than their files.
    if compiled.nmesh or compiled.ntex or compiled.nhfield or compiled.nskin:
        spec.meshdir, spec.texturedir = (
            str((model.parent / folder).resolve()) for folder in (spec.meshdir, spec.texturedir)
        )
    if spec.option.integrator == int(mujoco.mjtIntegrator.mjINT_RK4):
        spec.option.integrator = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
        notes.append(
            "the integrator RK4 was replaced by implicitfast, because training cannot use RK4"
        )
    if found.idle:
        notes.append(_IDLE.format(joints=", ".join(found.idle)))
    spec.modelname = name
    spec.compile()
    return Begun(_code(name, model, found), spec.to_xml(), notes)


# -- What is added to it


def _complete(spec: mujoco.MjSpec, model: mujoco.MjModel, found: Found) -> None:
    """Adds the sensors that the task reads, a camera and a light where there are none, and sizes.

    MuJoCo would measure the task's model with its hidden markers, far below all else, and clip what
    is nearer to a camera than a part of that.
    """
    joint, frame = mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_BODY
    for each in found.joints:
        for kind in (mujoco.mjtSensor.mjSENS_JOINTPOS, mujoco.mjtSensor.mjSENS_JOINTVEL):
            spec.add_sensor(type=kind, objtype=joint, objname=each.name)
    if found.kind == "site":
        frame = mujoco.mjtObj.mjOBJ_SITE
    spec.add_sensor(type=mujoco.mjtSensor.mjSENS_FRAMEPOS, objtype=frame, objname=found.point)
    centre, extent = np.array(model.stat.center), float(model.stat.extent)
    spec.stat.center, spec.stat.extent = centre.round(3), float(f"{extent:.3g}")
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


def _code(name: str, model: Path, found: Found) -> str:
    """The Python of the task."""
    joints, first, axes = found.joints, found.first, found.axes
    count = len(joints)
    width = found.high - found.low
    whole = [joint.hinge and not joint.limited for joint in joints]
    low, high = (np.array(end)[axes] for end in (found.low, found.high))
    margin = 0.05 * (high - low)
    largest = np.maximum(np.abs(low), np.abs(high))
    return _TEMPLATE.read_text(encoding="utf-8").format(
        title="".join(word.capitalize() for word in name.split("_")),
        name=name,
        kind=found.kind,
        point=found.point,
        model=model.name,
        names=_tuple(repr(joint.name).replace("'", '"') for joint in joints),
        low=_list(joint.low for joint in joints),
        high=_list(joint.high for joint in joints),
        rest=_list(joint.rest for joint in joints),
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
