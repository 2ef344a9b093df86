"""A task's stage in a viser scene: the bodies' shapes once, and then their poses, as they change.

viser is an extra; `load` is the only place that imports it.
"""

import contextlib
import importlib
import io
from collections.abc import Callable, Iterator, Sequence
from types import ModuleType
from typing import Any

import numpy as np

from launch.pictures.stage import Poses, Shape, Stage

LACKING = "it needs the viewer: pip install 'hac-suite[viewer]', in a checkout '.[viewer]'"

_FILL = 0.35  # opacity of markers; their edges are opaque, so that nested ones tell apart
_EDGE_WIDTH = 2.5  # pixels
_DARKER = 0.85  # times its colour, so that yellow shows before white
_OUTSIDE = 1.01  # times their size, so that edges are not half hidden in what they belong to
_AMBIENT, _BRIGHT, _DIM = 1.6, 1.7, 0.5
_KEY_LIGHT, _FILL_LIGHT = (1.5, -2.5, 4.0), (-2.0, -2.0, 3.0)
HERE = (232, 89, 12)
"""The colour of where the agent is: no marker has it, and it shows on white and on black."""
_DOT = 0.03  # metres, the radius
_DROP_WIDTH = 1.5  # pixels
_FLOOR_SIZE = 8.0  # metres
_FLOOR_COLOUR, _CELL_COLOUR, _LINE_COLOUR = (206, 212, 218), (180, 188, 197), (150, 160, 172)
_CELL = 0.25  # metres
_LIFT = 0.002  # metres that the floor lies below the model's, so that what lies on it shows


class ViewerMissing(Exception):
    """The extra is not installed; the message says how to install it."""


def load() -> ModuleType:
    """viser.

    Raises:
      ViewerMissing: it is not installed.
    """
    try:
        return importlib.import_module("viser")
    except ImportError as error:
        raise ViewerMissing(f"{LACKING} ({error})") from error


def private(host: str, port: int) -> Any:
    """A viser server that answers on `host` alone, and hands nothing on to the internet."""
    viser: Any = load()

    class Private(viser.ViserServer):
        """viser can publish a page through a server of its makers'; not this one."""

        def request_share_url(self, verbose: bool = True) -> None:
            return None

    with _quiet():
        server = Private(host=host, port=port, verbose=False)
    server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
    return server


def stop(server: Any) -> None:
    """Ends what `private` began."""
    with _quiet():
        server.stop()


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """viser prints a banner of its own, whatever it is told."""
    with contextlib.redirect_stdout(io.StringIO()):
        yield


class Scene:
    """A stage as nodes of a viser scene."""

    def __init__(self, server: Any, stage: Stage):
        """Draws all that does not change; nothing moves until `draw`."""
        self._scene = server.scene
        self._floor, self._dots = stage.floor, list[Any]()
        self._markers = {*stage.goal, *(body for bodies in stage.subgoals for body in bodies)}
        server.scene.set_up_direction("+z")
        server.scene.world_axes.visible = False
        _look_from(server.initial_camera, stage)
        self._light()
        self._draw_floor(stage.floor)
        poses = stage.poses()
        self._frames = [
            self._scene.add_frame(f"/{index}_{name.replace('/', '_')}", show_axes=False)
            for index, name in enumerate(stage.bodies)
        ]
        self._drawn = Poses(
            np.full_like(poses.position, np.nan),
            np.full_like(poses.quaternion, np.nan),
            np.ones_like(poses.seen),
        )
        self._meshes = [
            (shape.body, self._draw_shape(f"{self._frames[shape.body].name}/{index}", shape))
            for index, shape in enumerate(stage.shapes)
        ]

    def draw(self, poses: Poses) -> None:
        """Moves the bodies to where they are, as far as they have moved."""
        for body, frame in enumerate(self._frames):
            seen = bool(poses.seen[body])
            if seen != self._drawn.seen[body]:
                frame.visible = seen
            if not seen:
                continue
            if not np.array_equal(poses.position[body], self._drawn.position[body]):
                frame.position = poses.position[body]
            if not np.array_equal(poses.quaternion[body], self._drawn.quaternion[body]):
                frame.wxyz = poses.quaternion[body]
        self._drawn = Poses(
            np.where(poses.seen[:, None], poses.position, self._drawn.position),
            np.where(poses.seen[:, None], poses.quaternion, self._drawn.quaternion),
            poses.seen.copy(),
        )

    def draw_here(self, places: np.ndarray) -> None:
        """Puts dots where the agent is, at places [B, 3], each with a line down to the floor."""
        for index in range(len(self._dots), len(places)):
            self._dots.append(self._add_dot(f"/here_{index}"))
        for dot, place in zip(self._dots, places, strict=True):
            dot.position = place

    def _add_dot(self, name: str) -> Any:
        dot = self._scene.add_icosphere(name, radius=_DOT, color=HERE, cast_shadow=False)
        if self._floor is not None:
            # As long as the floor is wide: the rest of it lies below the floor, which hides it.
            drop = np.array([[[0, 0, 0], [0, 0, -_FLOOR_SIZE]]], np.float32)
            self._scene.add_line_segments(
                f"{name}/drop", drop, colors=HERE, thickness=_DROP_WIDTH, thickness_units="screen"
            )
        return dot

    def _light(self) -> None:
        """As the suite's arena is lit: from above and in front, with some light from everywhere."""
        self._scene.configure_environment_map(None)
        self._scene.configure_default_lights(enabled=False)
        self._scene.add_light_ambient("/light", intensity=_AMBIENT)
        self._scene.add_light_directional(
            "/light/key", position=_KEY_LIGHT, intensity=_BRIGHT, cast_shadow=True
        )
        self._scene.add_light_directional("/light/fill", position=_FILL_LIGHT, intensity=_DIM)

    def _draw_floor(self, height: float | None) -> None:
        if height is None:
            return
        self._scene.add_grid(
            "/floor",
            width=_FLOOR_SIZE,
            height=_FLOOR_SIZE,
            position=(0.0, 0.0, height - _LIFT),
            cell_size=_CELL,
            section_size=4 * _CELL,
            cell_color=_CELL_COLOUR,
            section_color=_LINE_COLOUR,
            plane_color=_FLOOR_COLOUR,
            plane_opacity=1.0,
            shadow_opacity=0.3,
        )

    def on_drag(self, bodies: Sequence[int], call: Callable[[Any], Any]) -> None:
        """Calls `call` with viser's events when a person drags one of these bodies."""
        for body, mesh in self._meshes:
            if body in bodies:
                mesh.on_drag(call)

    def _draw_shape(self, name: str, shape: Shape) -> Any:
        colour = _rgb(shape.rgba)
        marker = shape.body in self._markers
        mesh = self._scene.add_mesh_simple(
            name,
            shape.vertices,
            shape.faces,
            color=colour,
            opacity=_FILL if marker else None if shape.rgba[3] == 1 else shape.rgba[3],
            cast_shadow=not marker,
            receive_shadow=not marker,
            side="double" if marker else "front",
        )
        if marker and len(shape.edges):
            middle = (shape.edges.min(axis=(0, 1)) + shape.edges.max(axis=(0, 1))) / 2
            self._scene.add_line_segments(
                f"{name}_edges",
                middle + _OUTSIDE * (shape.edges - middle),
                colors=_rgb(shape.rgba, _DARKER),
                thickness=_EDGE_WIDTH,
                thickness_units="screen",
            )
        return mesh


def _rgb(rgba: Sequence[float], times: float = 1.0) -> tuple[int, ...]:
    return tuple(round(255 * times * part) for part in rgba[:3])


def _look_from(camera: Any, stage: Stage) -> None:
    camera.position = stage.camera.position
    camera.look_at = stage.camera.look_at
    camera.fov = stage.camera.field_of_view
