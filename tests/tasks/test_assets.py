"""MJCF files that stand on their own, what is said of missing ones, and the bounds they state."""

import mujoco
import numpy as np
import pytest

from tasks import assets


@pytest.mark.parametrize("path", sorted(assets.MJCF_DIRECTORY.glob("*.xml")), ids=lambda p: p.name)
def test_every_mjcf_file_compiles_alone(path):
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for _ in range(10):
        mujoco.mj_step(model, data)
    assert not data.warning.number.any()
    assert 'angle="radian"' in path.read_text()


def test_a_missing_mjcf_file_is_named():
    with pytest.raises(FileNotFoundError, match=r"nowhere\.xml"):
        assets.load_mjcf("nowhere.xml")


@pytest.mark.parametrize("text", ["<mujoco><worldbody></mujoco>", "<mujoco><bdoy/></mujoco>"])
def test_a_broken_mjcf_file_is_named(text, tmp_path, monkeypatch):
    (tmp_path / "broken.xml").write_text(text)
    monkeypatch.setattr(assets, "MJCF_DIRECTORY", tmp_path)
    with pytest.raises(ValueError, match=r"broken\.xml"):
        assets.load_mjcf("broken.xml")


_MOTORS = """
<mujoco>
  <default>
    <motor ctrlrange="-5 5"/>
    <default class="weak">
      <motor ctrlrange="-1 2"/>
      <default class="weaker"><motor gear="2"/></default>
    </default>
  </default>
  <worldbody><body><joint name="j"/><geom size="1"/></body></worldbody>
  <actuator>
    <motor name="own" joint="j" ctrlrange="-3 4"/>
    <motor name="default" joint="j"/>
    <motor name="class" class="weak" joint="j"/>
    <motor name="inherited" class="weaker" joint="j"/>
  </actuator>
</mujoco>
"""


def test_bounds_of_actions_are_read_as_mujoco_compiles_them(tmp_path):
    file = tmp_path / "motors.xml"
    file.write_text(_MOTORS)
    bounds = assets.action_bounds(str(file))
    compiled = mujoco.MjModel.from_xml_path(str(file)).actuator_ctrlrange
    np.testing.assert_array_equal(compiled, [[-3, 4], [-5, 5], [-1, 2], [-1, 2]])
    np.testing.assert_array_equal(np.stack(bounds, axis=1), compiled)


def test_an_actuator_without_bounds_is_named(tmp_path):
    file = tmp_path / "motors.xml"
    file.write_text(_MOTORS.replace('    <motor ctrlrange="-5 5"/>\n', ""))
    with pytest.raises(ValueError, match=r"'default' of .*motors\.xml.* needs a ctrlrange"):
        assets.action_bounds(str(file))


def test_a_model_without_actuators_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(assets, "MJCF_DIRECTORY", tmp_path)
    (tmp_path / "still.xml").write_text("<mujoco><worldbody/></mujoco>")
    with pytest.raises(ValueError, match="has no actuators"):
        assets.action_bounds("still.xml")
