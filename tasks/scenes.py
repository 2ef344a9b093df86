"""The scene of every task: sky, lights, floor and cameras."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from dm_control import composer, mjcf

from tasks import assets


class Camera(NamedTuple):
    """Where a camera stands and looks; see `camera` in MuJoCo's XML reference.

    Attributes:
      position: x, y, z in metres.
      axes: the directions of the picture's right and up, three numbers each.
      field_of_view: degrees, vertically; None is MuJoCo's own 45.
    """

    position: tuple[float, float, float]
    axes: tuple[float, float, float, float, float, float]
    field_of_view: float | None = None


def build(
    *bodies: composer.Entity | mjcf.RootElement,
    cameras: Mapping[str, Camera],
    solid_floor: bool = False,
) -> composer.Arena:
    """Makes the arena of a task.

    Args:
      bodies: its contents: entities, or the MJCF of bodies that need no entity.
      cameras: by name; the first one is the default for pictures.
      solid_floor: whether things can rest on the floor; otherwise it is only seen.
    """
    arena = composer.Arena(xml_path=str(assets.MJCF_DIRECTORY / "arena.xml"))
    model = arena.mjcf_model
    if solid_floor:
        floor = model.find("geom", "floor")
        floor.contype, floor.conaffinity = 1, 1
    for body in bodies:
        if isinstance(body, composer.Entity):
            arena.attach(body)
        else:
            model.attach(body)
    for name, camera in cameras.items():
        model.worldbody.add("camera", name=name, **_attributes(camera))
    return arena


def _attributes(camera: Camera) -> dict[str, Any]:
    placed = {"pos": camera.position, "xyaxes": camera.axes}
    return placed if camera.field_of_view is None else {**placed, "fovy": camera.field_of_view}
