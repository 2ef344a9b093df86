"""Renders an episode's bodies at any moment of it, as a view shows them.

Markers are not in the pictures: `launch.drawing.markers` draws them, with outlines.
"""

import copy
import itertools

import mujoco
import numpy as np

from launch.drawing.view import View, placed
from launch.pictures.course import Course
from launch.pictures.stage import STATE, Poses

_UNSEEN_GROUP = 5  # of geoms and sites
_SEEN_GROUPS = 3  # those before it are seen
_ROOM = 8  # pixels around bodies, for what rounding leaves out
_MOST_GEOMS = 10_000  # that a scene can hold
_CORNERS = np.array(list(itertools.product((-1, 1), repeat=3)))  # of a cube


class Lens:
    """Renders a course's bodies at any moment of it, as a view shows them.

    Software takes longest where most pixels are, and those are floor and sky. They stay as they
    are: only the part of the picture in which bodies are is rendered anew.
    """

    def __init__(self, course: Course, view: View):
        self._course, self._view = course, view
        stage = course.stage
        self._model = model = copy.copy(stage.model)
        self._data = mujoco.MjData(model)
        model.vis.quality.offsamples = 0  # smoothed edges take software three times as long
        model.vis.global_.offwidth, model.vis.global_.offheight = view.size
        markers = [*stage.goal, *itertools.chain(*stage.subgoals)]
        model.geom_group[np.isin(model.geom_bodyid, markers)] = _UNSEEN_GROUP
        model.site_group[np.isin(model.site_bodyid, markers)] = _UNSEEN_GROUP
        seen = (model.site_bodyid > 0) & (model.site_group < _SEEN_GROUPS)
        self._sites = np.flatnonzero(seen & (model.site_rgba[:, 3] > 0))
        self._shapes = [shape for shape in stage.shapes if shape.body not in (0, *markers)]
        self._camera = mujoco.MjvCamera()
        self._camera.lookat = view.position + view.axes[2]  # `_aim` has the last word
        self._scene = mujoco.MjvScene(model, _MOST_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
        self._gl = mujoco.GLContext(*view.size)
        self._gl.make_current()
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._background = self._without_bodies()

    def picture(self, moment: float) -> np.ndarray:
        """Bodies at a moment in steps; between two steps, on the way from one to the next."""
        self._place(moment)
        left, top, right, bottom = self._where()
        picture = self._background.copy()
        if right > left and bottom > top:
            picture[top:bottom, left:right] = self._render(left, top, right, bottom)
        return picture

    def _without_bodies(self) -> np.ndarray:
        model, groups = self._model, self._model.site_group.copy()
        self._place(0)
        # MuJoCo takes sites of mocap bodies for static.
        model.site_group[model.body_weldid[model.site_bodyid] > 0] = _UNSEEN_GROUP
        picture = self._render(0, 0, *self._view.size, mujoco.mjtCatBit.mjCAT_STATIC)
        model.site_group[:] = groups
        return picture

    def _where(self) -> tuple[int, int, int, int]:
        """Columns and rows between which bodies are: left, top, right, bottom."""
        width, height = self._view.size
        model = self._model
        if model.nskin or model.nflex or model.ntendon or not self._shapes:
            return 0, 0, width, height
        poses = Poses(self._data.xpos, self._data.xquat, np.ones(model.nbody, bool))
        corners = [placed(shape.vertices, poses, shape.body) for shape in self._shapes]
        for site in self._sites:
            reach = np.linalg.norm(model.site_size[site])  # of its farthest corner, however turned
            corners.append(self._data.site_xpos[site] + reach * _CORNERS)
        pixels = self._view.pixels(np.concatenate(corners))
        low = np.clip(np.floor(pixels.min(0)) - _ROOM, 0, self._view.size).astype(int)
        high = np.clip(np.ceil(pixels.max(0)) + _ROOM, 0, self._view.size).astype(int)
        return int(low[0]), int(low[1]), int(high[0]), int(high[1])

    def _render(
        self,
        left: int,
        top: int,
        right: int,
        bottom: int,
        what: mujoco.mjtCatBit = mujoco.mjtCatBit.mjCAT_ALL,
    ) -> np.ndarray:
        """A part of the picture, uint8 [bottom - top, right - left, 3]; `what` to have in it."""
        self._gl.make_current()
        mujoco.mjv_updateScene(
            self._model, self._data, mujoco.MjvOption(), None, self._camera, what, self._scene
        )
        bounds = self._view.bounds_of(left, top, right, bottom)
        for camera in self._scene.camera:
            self._aim(camera, bounds)
        part = mujoco.MjrRect(0, 0, right - left, bottom - top)
        pixels = np.empty((part.height, part.width, 3), np.uint8)
        mujoco.mjr_render(part, self._scene, self._context)
        mujoco.mjr_readPixels(pixels, None, part, self._context)
        return pixels[::-1]

    def _place(self, moment: float) -> None:
        model, data, states = self._model, self._data, self._course.states
        step = min(int(moment), len(states) - 1)
        mujoco.mj_setState(model, data, states[step], STATE)
        rest = moment - step
        if rest > 0:
            before = data.qpos.copy()
            mujoco.mj_setState(model, data, states[step + 1], STATE)
            way = np.zeros(model.nv)
            mujoco.mj_differentiatePos(model, way, 1.0, before, data.qpos)
            mujoco.mj_setState(model, data, states[step], STATE)
            mujoco.mj_integratePos(model, data.qpos, way, rest)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        mujoco.mj_tendon(model, data)

    def _aim(self, camera: mujoco.MjvGLCamera, bounds: np.ndarray) -> None:
        """Makes the camera see these bounds and no more."""
        (left, bottom), (right, top) = bounds * camera.frustum_near
        camera.frustum_center = (left + right) / 2
        camera.frustum_width = (right - left) / 2
        camera.frustum_bottom, camera.frustum_top = bottom, top
        camera.pos = self._view.position
        camera.forward, camera.up = self._view.axes[2], self._view.axes[1]

    def close(self) -> None:
        """Frees the rendering context."""
        self._gl.make_current()
        self._context.free()
        self._gl.free()
