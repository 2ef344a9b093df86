"""What is seen of a task: shapes as MuJoCo bounds them, poses as it has them, markers found."""

import itertools

import mujoco
import numpy as np
import pytest

import tasks
from launch.pictures import stage as stage_lib
from launch.pictures.stage import Stage

_EVERY_SHAPE = """
<mujoco>
  <asset><mesh name="wedge" vertex="0 0 0  1 0 0  0 2 0  0 0 3"/></asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1" pos="0 0 0.25"/>
    <body pos="1 2 3" euler="10 20 30">
      <geom type="sphere" size="0.3" pos="0.1 0 0"/>
      <geom type="capsule" size="0.1 0.4" euler="30 0 0"/>
      <geom type="cylinder" size="0.2 0.5" pos="0 0.2 0" euler="0 60 0"/>
      <geom type="ellipsoid" size="0.1 0.2 0.3"/>
      <geom type="box" size="0.1 0.2 0.3" euler="0 0 45"/>
      <geom type="mesh" mesh="wedge"/>
      <geom type="sphere" size="9" group="3"/>
      <geom type="sphere" size="9" rgba="1 1 1 0"/>
    </body>
  </worldbody>
</mujoco>"""


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(_EVERY_SHAPE)


def test_every_shape_fills_the_box_that_mujoco_bounds_it_with(model):
    shapes = list(stage_lib._shapes(model))
    assert len(shapes) == 6  # neither the floor, nor collision geoms, nor what is transparent
    for geom, shape in enumerate(shapes, start=1):
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        own = (shape.vertices - model.geom_pos[geom]) @ turn.reshape(3, 3)
        centre, half = model.geom_aabb[geom].reshape(2, 3)
        np.testing.assert_allclose(own.min(0), centre - half, atol=5e-3)
        np.testing.assert_allclose(own.max(0), centre + half, atol=5e-3)
        assert shape.faces.max() < len(shape.vertices)


def test_faces_look_outward(model):
    """Counted as signed tetrahedra, the faces enclose the volume of the body."""
    volumes = []
    for shape in stage_lib._shapes(model):
        a, b, c = (shape.vertices[shape.faces[:, corner]].astype(float) for corner in range(3))
        volumes.append((a * np.cross(b, c)).sum() / 6)
    exact = [
        4 / 3 * np.pi * 0.3**3,
        np.pi * 0.1**2 * 0.8 + 4 / 3 * np.pi * 0.1**3,
        np.pi * 0.2**2 * 1.0,
        4 / 3 * np.pi * 0.1 * 0.2 * 0.3,
        8 * 0.1 * 0.2 * 0.3,
        1.0,  # 1 * 2 * 3 / 6
    ]
    np.testing.assert_allclose(volumes, exact, rtol=0.03)


def test_the_floor_is_where_the_plane_is(model):
    assert stage_lib._floor(model) == 0.25


@pytest.fixture(params=tasks.ALL)
def watched(request):
    env = tasks.load_vector(request.param, 1)
    env.reset(np.array([3]), test=True)
    yield env, Stage(env)
    env.close()


def test_markers_are_found_by_what_they_do(watched):
    _, stage = watched
    assert [stage.bodies[body] for body in stage.goal] in (["goal/"], ["goal_rod/"])
    names = [[stage.bodies[body] for body in bodies] for bodies in stage.subgoals]
    assert all(name.startswith(f"subgoal_{k}") for k, own in enumerate(names) for name in own)
    assert len(names) == 2 and all(names)
    colours = [stage.colour(stage.goal), *map(stage.colour, stage.subgoals)]
    assert colours == ["#ffd10d", "#9433c7", "#26b240"]  # yellow, purple, green
    of_levels = list(itertools.chain(*stage.subgoals))
    assert not stage.poses().seen[of_levels].any()  # nothing is proposed yet


def test_looking_changes_nothing(watched):
    env, stage = watched
    model, data = env.simulation(0)
    before = env.snapshot()["state"]
    poses = stage.poses()
    np.testing.assert_array_equal(before, env.snapshot()["state"])
    positions = data.xpos
    moving = model.body_mocapid < 0
    np.testing.assert_allclose(poses.position[moving], positions[moving], atol=1e-6)


def test_the_camera_is_that_of_the_pictures(watched):
    env, stage = watched
    model, _ = env.simulation(0)
    np.testing.assert_allclose(stage.camera.position, model.cam_pos[0])
    assert stage.camera.field_of_view == pytest.approx(np.radians(model.cam_fovy[0]))
    assert np.linalg.norm(stage.camera.look_at - stage.camera.position) > 0.5
