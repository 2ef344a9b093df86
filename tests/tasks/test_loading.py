"""Loading by name, the registry's refusals, and MJCF files that stand on their own."""

import mujoco
import pytest

import tasks
from tasks import assets, registry


def test_the_five_tasks_are_registered():
    assert tasks.ALL == (
        "pendulum_climb",
        "pendulum_balance",
        "ur5_reacher",
        "cartpole_swingup",
        "pick_place",
    )
    assert tasks.TAGS
    assert {name for tag in tasks.TAGS for name in registry.tagged(tag)} == set(tasks.ALL)


@pytest.mark.parametrize("load", [tasks.load, lambda name: tasks.load_vector(name, 1)])
def test_an_unknown_name_is_answered_with_the_closest_first(load):
    with pytest.raises(ValueError, match=r"'pick_plce'.*did you mean pick_place.*are pick_place, "):
        load("pick_plce")


def test_a_duplicate_name_is_refused():
    def pick_place(test=False):
        raise AssertionError("never built")

    with pytest.raises(ValueError, match="pick_place"):
        registry.add("worm")(pick_place)
    assert registry.get("pick_place") is not pick_place


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
