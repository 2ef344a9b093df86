"""Finds what a task needs in a model: driven joints, and a point that they move."""

from typing import NamedTuple

import mujoco
import numpy as np

_CONTROL = 0.02  # seconds between actions, about
_DRAWS = 2000  # random postures, to see where the point comes
_PLAYED = 4000  # control steps of random actions, to see how fast joints turn
_SAME = 1e-3  # a coordinate of the point that moves less is none of the goal's
_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_ON_JOINT, _ON_TENDON = int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_TENDON)
_WRAPS_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)


class Joint(NamedTuple):
    """A joint that the agent drives."""

    name: str
    hinge: bool
    low: float  # of starts
    high: float
    rest: float  # in the model as it is written
    limited: bool
    speed: float  # what its velocity is divided by


class Found(NamedTuple):
    """What the task is made from."""

    joints: list[Joint]
    idle: list[str]  # joints that the agent does not drive
    point: str  # the site, or the body by its centre of mass, whose place is the goal
    kind: str  # site or body
    axes: list[int]  # the coordinates of the point that move
    low: np.ndarray  # [3] where it comes
    high: np.ndarray
    control_timestep: float
    first: int  # the first of the readings that are ours


def look(model: mujoco.MjModel, path: str, point: str | None) -> Found:
    """What a task can be made from in a model that is read from `path`; see `beginning.begin`.

    Raises:
      ValueError: the model cannot be used; one line says why.
    """
    if not model.nu:
        raise ValueError(f"{path} has no actuators, so an agent cannot act")
    free = [model.actuator(i).name or str(i) for i in range(model.nu)
            if not model.actuator_ctrllimited[i]]  # fmt: skip
    if free:
        raise ValueError(f"{path}: actuator {free[0]} has no ctrlrange; actions must be bounded")
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
        raise ValueError(
            f"{path}: no actuator moves the {kind} {point}; name another with --point: "
            f"{', '.join(_names(model))}"
        )
    substeps = max(1, round(_CONTROL / model.opt.timestep))
    speeds = _speeds(model, substeps)
    joints = [_joint(model, i, speeds) for i in driven]
    idle = [model.joint(i).name or str(i) for i in range(model.njnt) if i not in driven]
    return Found(
        joints, idle, point, kind, axes, low, high, substeps * model.opt.timestep,
        model.nsensordata,
    )  # fmt: skip


def _driven(model: mujoco.MjModel) -> list[int]:
    """Hinges and slides that actuators act on, also by tendons; all, where it is not clear."""
    simple = [i for i in range(model.njnt) if model.jnt_type[i] in (_HINGE, _SLIDE)]
    acted: set[int] = set()
    for kind, on in zip(model.actuator_trntype, model.actuator_trnid[:, 0], strict=True):
        joints = {int(on)} if kind == _ON_JOINT else set()
        if kind == _ON_TENDON:
            wraps = slice(model.tendon_adr[on], model.tendon_adr[on] + model.tendon_num[on])
            joints = set(model.wrap_objid[wraps][model.wrap_type[wraps] == _WRAPS_JOINT].tolist())
        if not joints:
            return simple
        acted |= joints
    return [i for i in simple if i in acted]


def _names(model: mujoco.MjModel) -> list[str]:
    """The sites and bodies that have names."""
    sites = sorted(model.site(i).name for i in range(model.nsite))
    bodies = [model.body(i).name for i in range(1, model.nbody)]
    return [name for name in (*sites, *bodies) if name]


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
                           f"{', '.join(_names(model))}")  # fmt: skip
    if name is not None:
        return name, "body"
    moved = {int(model.jnt_bodyid[i]) for i in driven}
    depth = {i: _depth(model, i, moved) for i in bodies.values()}
    deepest = [i for i in bodies.values() if depth[i] and depth[i] == max(depth.values())]
    if not deepest:
        raise ValueError(f"{path}: no named body moves; give the hand a name")
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
        at = data.site(point).xpos if kind == "site" else data.body(point).xipos
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
    rest = float(model.qpos0[model.jnt_qposadr[i]])
    return Joint(model.joint(i).name, bool(hinge), low, high, rest, limited, speed)
