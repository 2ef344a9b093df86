"""A camera's view of an episode: which part of it is shown, and where points are in it."""

from collections.abc import Iterable, Sequence

import mujoco
import numpy as np

from analysis.program import CommandError, unknown
from launch.pictures.course import Course
from launch.pictures.stage import Poses, Stage, still_camera

_MARGIN = 0.12  # of the picture, on every side of what is to be seen
_SAMPLES = 24  # moments at which it is looked what is to be seen
_NEAREST = 1e-3  # metres before the camera


class View:
    """A camera's place and what part of its sight the picture shows.

    Attributes:
      camera: its name, if a person asked for it.
      bounds: [2, 2] the least and the most of x / z and y / z that are shown.
    """

    def __init__(self, stage: Stage, camera: str | None, size: tuple[int, int]):
        """Shows what the camera itself shows; size is width, height in pixels.

        Args:
          camera: its name; None is the first that stands still, or else a view of everything.

        Raises:
          CommandError: the model has no such camera.
        """
        self.camera, self.size = camera, size
        self.position, self.axes, field = _standing(stage, _camera_number(stage, camera))
        half = np.tan(field / 2)
        self.bounds = np.array([[-1, -1], [1, 1]]) * half * [size[0] / size[1], 1]

    def sighted(self, points: np.ndarray) -> np.ndarray:
        """x / z and y / z [..., 2] of points [..., 3] in metres, from the camera."""
        seen = (points - self.position) @ self.axes.T
        return seen[..., :2] / np.maximum(seen[..., 2:], _NEAREST)

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Columns and rows [..., 2] of points [..., 3] in metres."""
        share = (self.sighted(points) - self.bounds[0]) / (self.bounds[1] - self.bounds[0])
        return np.stack([share[..., 0], 1 - share[..., 1]], axis=-1) * self.size

    def bounds_of(self, left: int, top: int, right: int, bottom: int) -> np.ndarray:
        """The bounds of a part of the picture, between these columns and rows."""
        width, height = self.size
        shares = np.array([[left / width, 1 - bottom / height], [right / width, 1 - top / height]])
        return self.bounds[0] + shares * (self.bounds[1] - self.bounds[0])

    def frame(self, points: np.ndarray) -> None:
        """Shows all these points [N, 3] as large as the picture allows.

        Where some are behind the camera, as one that rides on a robot, it shows what that sees.
        """
        if ((points - self.position) @ self.axes[2]).min() < _NEAREST:
            return
        seen = self.sighted(points)
        low, high = seen.min(0), seen.max(0)
        middle, half = (low + high) / 2, (high - low) / 2 / (1 - 2 * _MARGIN)
        wide = np.array(self.size) / self.size[1]
        half = wide * max(half / wide)
        self.bounds = np.stack([middle - half, middle + half])


def points_of_interest(course: Course) -> np.ndarray:
    """Points [N, 3] of bodies and markers over the episode: what a picture is to have in it."""
    if not course.poses:
        return np.zeros((0, 3))
    moments = np.linspace(0, course.steps, min(_SAMPLES, course.steps + 1)).astype(int)
    found = [corners for step in moments for corners in _corners(course.stage, course.poses[step])]
    return np.concatenate(found) if found else np.zeros((0, 3))


def _corners(stage: Stage, poses: Poses) -> Iterable[np.ndarray]:
    for shape in stage.shapes:
        if shape.body and poses.seen[shape.body]:
            yield placed(shape.vertices, poses, shape.body)


def placed(points: np.ndarray, poses: Poses, body: int) -> np.ndarray:
    """Points [..., 3] in a body's frame, where they are in the world."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, poses.quaternion[body].astype(float))
    return points @ turn.reshape(3, 3).T + poses.position[body]


def _camera_number(stage: Stage, name: str | None) -> int:
    """-1 is a free camera: the task has none of its own that stands still."""
    model = stage.model
    names = [model.camera(index).name for index in range(model.ncam)]
    if name is None:
        return still_camera(model)
    if name not in names:
        raise CommandError(f"flag --camera: {unknown('camera', name, names)}")
    return names.index(name)


def _standing(stage: Stage, number: int) -> tuple[np.ndarray, np.ndarray, float]:
    """A camera's position at the start, its axes [3, 3] right, up, ahead, and field of view."""
    if number < 0:
        position, towards = stage.camera.position, stage.camera.look_at
        return position, _axes(towards - position), stage.camera.field_of_view
    model, data = stage.model, stage.start
    turn = data.cam_xmat[number].reshape(3, 3).T * [[1], [1], [-1]]
    return data.cam_xpos[number].copy(), turn, float(np.radians(model.cam_fovy[number]))


def _axes(ahead: Sequence[float] | np.ndarray) -> np.ndarray:
    ahead = np.asarray(ahead) / np.linalg.norm(ahead)
    right = np.cross(ahead, [0, 0, 1])
    right /= max(np.linalg.norm(right), _NEAREST)
    return np.stack([right, np.cross(right, ahead), ahead])
