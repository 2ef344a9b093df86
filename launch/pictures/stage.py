"""Shapes and poses of a task's bodies without GL, and which bodies are markers.

Everything comes from the compiled MuJoCo model and state, so a task in a file of one's own is seen
as the suite's are. `Watched` is all that is asked of an environment.
"""

import copy
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, Protocol

import mujoco
import numpy as np

from analysis.reading import schema
from hac_suite.types import EnvStep, VectorEnv

_GROUPS = (0, 1, 2)  # of geoms: those that MuJoCo's own viewer shows at first
_ROUND = 32  # corners of what is round
_HIDDEN_BELOW = -10.0  # metres; tasks hide markers far below the floor
_HALF_TURN = np.pi
STATE = (
    mujoco.mjtState.mjSTATE_QPOS
    | mujoco.mjtState.mjSTATE_MOCAP_POS
    | mujoco.mjtState.mjSTATE_MOCAP_QUAT
)
"""What of MuJoCo's state says where all bodies are."""
_FALLBACK_VIEW = np.array([0.9, -1.9, 0.9])  # times the model's extent, from its centre
_APART = (0.25, 0.75)  # of each dimension's range: two goals whose markers are apart


class Watched(VectorEnv, Protocol):
    """An environment that can be drawn: `tasks.VectorEnv` is one."""

    def simulation(self, i: int) -> tuple[mujoco.MjModel, mujoco.MjData] | None: ...

    def show_subgoals(self, i: int, subgoals: Sequence[np.ndarray | None]) -> None: ...

    def move_goal(self, i: int, goal: np.ndarray) -> EnvStep: ...


def simulation_of(env: Any) -> tuple[mujoco.MjModel, mujoco.MjData] | None:
    """MuJoCo's model and state of environment 0: it is `Watched`. None: it cannot be drawn."""
    simulation = getattr(env, "simulation", None)
    return None if simulation is None else simulation(0)


class Shape(NamedTuple):
    """A geom as triangles, in the frame of its body; metres."""

    body: int
    rgba: tuple[float, float, float, float]
    vertices: np.ndarray  # float32 [V, 3]
    faces: np.ndarray  # uint32 [F, 3]
    edges: np.ndarray  # float32 [E, 2, 3] lines that tell its form


class Camera(NamedTuple):
    """Where the task's own pictures are taken from."""

    position: np.ndarray  # [3]
    look_at: np.ndarray  # [3]
    field_of_view: float  # radians, vertically


class Poses(NamedTuple):
    """Where all bodies of a model are at one moment; an unseen one's place means nothing."""

    position: np.ndarray  # float32 [B, 3]
    quaternion: np.ndarray  # float32 [B, 4] w, x, y, z
    seen: np.ndarray  # bool [B]


class Stage:
    """Environment 0 of a task as something to draw.

    Attributes:
      shapes: of all bodies, but for floors.
      floor: height of the floor in metres, None where there is none.
      goal: the bodies that mark the end goal: those that move when it is moved.
      subgoals: per level that can show its subgoal, the lowest first, the bodies that mark it.
      camera: where to look from.
      model: compiled, as it was at the start; to be read only.
      start: MuJoCo's state when this was made, with bodies and cameras placed.
    """

    def __init__(self, env: Watched):
        """`env` has begun an episode, whose end goal stays; its subgoals are hidden here."""
        self._env = env
        model, data = self._simulation()
        self.model = copy.copy(model)  # others' tasks write the next episode's goal into theirs
        self._scratch = mujoco.MjData(self.model)
        self.start = _placed(self.model, data)
        self.shapes = list(_shapes(self.model))
        self.floor = _floor(self.model)
        self.subgoals = self._marked_by_level()
        self.goal = self._marking_the_goal()
        self.camera = _camera(self.model, self.start)

    def _simulation(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        found = simulation_of(self._env)
        assert found is not None, "it cannot be drawn"
        return found

    @property
    def bodies(self) -> list[str]:
        """The bodies' names, the world's first."""
        return [self.model.body(body).name or f"body{body}" for body in range(self.model.nbody)]

    def colour(self, bodies: Sequence[int]) -> str | None:
        """The colour of the first of these bodies that has a shape, as #rrggbb."""
        for shape in self.shapes:
            if shape.body in bodies:
                return "#" + "".join(f"{round(255 * part):02x}" for part in shape.rgba[:3])
        return None

    def _marked_by_level(self) -> list[list[int]]:
        """Bodies that come to sight with each level's subgoal: tasks name markers as they like."""
        space = self._env.subgoal_space
        middle = (np.asarray(space.low) + space.high) / 2
        self._env.show_subgoals(0, [])
        hidden = self.poses().seen
        found: list[list[int]] = []
        for level in range(schema.MAX_LEVELS):
            self._env.show_subgoals(0, [None] * level + [middle])
            shown = np.flatnonzero(self.poses().seen & ~hidden).tolist()
            if not shown:
                break
            found.append(shown)
        self._env.show_subgoals(0, [])
        return found

    def _marking_the_goal(self) -> list[int]:
        """Bodies that move with the end goal; others' may be the handles of robots."""
        mocap = self.model.body_mocapid >= 0
        if not (mocap & self.poses().seen).any():
            return []
        space, idle = self._env.goal_space, np.zeros(self._env.num_envs, bool)
        actions = np.zeros((self._env.num_envs, len(self._env.action_low)))
        goal = self._env.step(actions, idle).desired_goal[0]  # no environment steps
        low, high = np.asarray(space.low), np.asarray(space.high)
        try:
            here, there = (self._poses_at(low + share * (high - low)) for share in _APART)
        except ValueError:  # it cannot be moved
            return []
        self._env.move_goal(0, goal)
        moved = (here.position != there.position).any(1)
        moved |= (here.quaternion != there.quaternion).any(1)
        return np.flatnonzero(mocap & moved).tolist()

    def _poses_at(self, goal: np.ndarray) -> Poses:
        self._env.move_goal(0, goal)
        return self.poses()

    def poses(self) -> Poses:
        """Where the bodies are now; the state itself is left as it is."""
        model, data = self._simulation()
        mujoco.mj_copyData(self._scratch, model, data)
        mujoco.mj_kinematics(model, self._scratch)
        return Poses(
            self._scratch.xpos.astype(np.float32),
            self._scratch.xquat.astype(np.float32),
            self._scratch.xpos[:, 2] > _HIDDEN_BELOW,
        )

    def state(self) -> np.ndarray:
        """Where the bodies are now, as `STATE` has it: for `mujoco.mj_setState`."""
        state = np.empty(mujoco.mj_stateSize(self.model, STATE))
        mujoco.mj_getState(*self._simulation(), state, STATE)
        return state

    def show(self, subgoals: Sequence[np.ndarray | None]) -> None:
        """Shows environment 0's subgoals [H], the lowest level's first."""
        self._env.show_subgoals(0, subgoals)


class Unseen(Stage):
    """Of an environment that only draws itself: there is nothing to draw."""

    def __init__(self) -> None:
        self.shapes, self.floor, self.goal, self.subgoals = [], None, [], []
        self.camera = Camera(-_FALLBACK_VIEW, np.zeros(3), np.radians(45))
        self.model = mujoco.MjModel.from_xml_string("<mujoco/>")


def _shapes(model: mujoco.MjModel) -> Iterator[Shape]:
    """The geoms that are to be seen, but for planes."""
    for geom in range(model.ngeom):
        rgba = _colour(model, geom)
        if model.geom_group[geom] not in _GROUPS or rgba[3] == 0:
            continue
        made = _triangles(model, geom)
        if made is None:
            continue
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        vertices, edges = (
            (part @ turn.reshape(3, 3).T + model.geom_pos[geom]).astype(np.float32)
            for part in (made[0], made[2])
        )
        yield Shape(int(model.geom_bodyid[geom]), rgba, vertices, made[1].astype(np.uint32), edges)


def _colour(model: mujoco.MjModel, geom: int) -> tuple[float, float, float, float]:
    material = model.geom_matid[geom]
    rgba = model.geom_rgba[geom]
    if material >= 0 and (rgba == (0.5, 0.5, 0.5, 1.0)).all():  # MuJoCo's default: not set
        rgba = model.mat_rgba[material]
    red, green, blue, opacity = rgba.tolist()
    return red, green, blue, opacity


def _triangles(
    model: mujoco.MjModel, geom: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Vertices, faces and telling edges in the geom's own frame; None for what is not drawn."""
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return _box(size)
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return _mesh(model, model.geom_dataid[geom])
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return _revolve(np.array([[0, -size[1]], [size[0], -size[1]], [size[0], size[1]],
                                  [0, size[1]]]), sharp=True)  # fmt: skip
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return _revolve(_round_profile(size[0], size[0], size[1]), sharp=False)
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return _revolve(_round_profile(size[0], size[0], 0.0), sharp=False)
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        made = _revolve(_round_profile(1.0, 1.0, 0.0), sharp=False)
        return made[0] * size, made[1], made[2] * size
    return None


def _box(half: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = signs * half
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    # Each side has corners of its own, so that light breaks at the edges.
    vertices = np.concatenate([corners[list(side)] for side in sides])
    faces = np.concatenate([[[k, k + 1, k + 2], [k, k + 2, k + 3]] for k in range(0, 24, 4)])
    pairs = [(a, b) for a in range(8) for b in range(a) if (signs[a] != signs[b]).sum() == 1]
    return vertices, faces, corners[np.array(pairs)]


def _mesh(model: mujoco.MjModel, mesh: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    vertices = model.mesh_vert[first : first + count].copy()
    return vertices, model.mesh_face[face : face + faces].copy(), np.zeros((0, 2, 3))


def _round_profile(radius: float, height: float, straight: float) -> np.ndarray:
    """Half an outline [P, 2] of radius and z, from the lower pole to the upper."""
    angles = np.linspace(-_HALF_TURN / 2, _HALF_TURN / 2, _ROUND // 2 + 1)
    z = height * np.sin(angles)
    around = np.stack([radius * np.cos(angles), z], axis=1)
    lower, upper = around[z <= 1e-9], around[z >= -1e-9]
    return np.concatenate([lower - [0, straight], upper + [0, straight]])


def _revolve(profile: np.ndarray, *, sharp: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The body that an outline [P, 2] of radius and z makes about the z axis.

    Args:
      sharp: whether the outline's corners are edges, at which light breaks.
    """
    if sharp:
        profile = np.repeat(profile, 2, axis=0)[1:-1]
    turn = np.linspace(0, 2 * _HALF_TURN, _ROUND, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    rings = [np.column_stack([r * circle, np.full(_ROUND, z)]) for r, z in profile]
    here, after = np.arange(_ROUND), (np.arange(_ROUND) + 1) % _ROUND
    faces = []
    for ring in range(0, len(rings) - 1, 2 if sharp else 1):
        a, b = ring * _ROUND, (ring + 1) * _ROUND
        faces += [np.stack([a + here, a + after, b + after], 1),
                  np.stack([a + here, b + after, b + here], 1)]  # fmt: skip
    widest = profile[:, 0].max()
    marked = [ring for ring in rings if np.hypot(*ring[0, :2]) > 0.999 * widest]
    edges = [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in marked]
    for quarter in range(0, _ROUND, _ROUND // 4):
        line = np.stack([ring[quarter] for ring in rings])
        edges.append(np.stack([line[:-1], line[1:]], axis=1))
    return np.concatenate(rings), np.concatenate(faces), np.concatenate(edges)


def _floor(model: mujoco.MjModel) -> float | None:
    """The height of the first plane."""
    planes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)
    return float(model.geom_pos[planes[0]][2]) if len(planes) else None


def _placed(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    """A copy of a state in which bodies and cameras are where they belong."""
    placed = mujoco.MjData(model)
    mujoco.mj_copyData(placed, model, data)
    mujoco.mj_kinematics(model, placed)
    mujoco.mj_comPos(model, placed)  # cameras may look at a centre of mass
    mujoco.mj_camlight(model, placed)
    return placed


def still_camera(model: mujoco.MjModel) -> int:
    """The number of the first camera that does not move with a body; -1: the model has none."""
    fixed = model.cam_mode == int(mujoco.mjtCamLight.mjCAMLIGHT_FIXED)
    still = np.flatnonzero(fixed & (model.body_weldid[model.cam_bodyid] == 0))
    return int(still[0]) if len(still) else -1


def _camera(model: mujoco.MjModel, start: mujoco.MjData) -> Camera:
    """The model's first still camera; where it has none, a place with all of it in sight."""
    centre, number = model.stat.center.copy(), still_camera(model)
    if number < 0:
        return Camera(centre + _FALLBACK_VIEW * model.stat.extent, centre, np.radians(45))
    position = start.cam_xpos[number].copy()
    ahead = -start.cam_xmat[number].reshape(3, 3)[:, 2]
    distance = max(float((centre - position) @ ahead), 0.5)
    return Camera(position, position + distance * ahead, float(np.radians(model.cam_fovy[number])))
