"""Models of copies: compiled twice, copied after that, and never shared."""

import sys

import mujoco
import numpy as np
import pytest

from tasks.worlds import making
from tasks.worlds.making import CompiledOnce

_XML = "<mujoco><worldbody><body><joint/><geom size='{size}'/></body></worldbody></mujoco>"


class World:
    """Whatever compiles a model when it is made."""

    def __init__(self, size: float = 0.1, models: int = 1):
        xml = _XML.format(size=size)
        self.models = [mujoco.MjModel.from_xml_string(xml) for _ in range(models)]


@pytest.fixture
def compiled(monkeypatch):
    """The XML of every model that is compiled while the test runs."""
    own, seen = mujoco.MjModel.from_xml_string, []

    def counted(xml, *rest):
        seen.append(xml)
        return own(xml, *rest)

    monkeypatch.setattr(mujoco.MjModel, "from_xml_string", staticmethod(counted))
    return seen


def test_the_third_copy_and_those_after_it_compile_nothing(compiled):
    make = CompiledOnce(lambda: World(models=2))
    worlds = [make() for _ in range(5)]
    assert len(compiled) == 4  # two copies, each with two models
    assert len({id(model) for world in worlds for model in world.models}) == 10
    assert all(model.geom_size[0, 0] == 0.1 for world in worlds for model in world.models)
    World()
    assert len(compiled) == 5  # outside of it everything compiles


def test_what_an_environment_does_to_its_model_stays_with_it():
    make = CompiledOnce(World)
    first = make()
    first.models[0].geom_size[:] = 7
    make().models[0].geom_size[:] = 8
    third = make()
    assert third.models[0].geom_size[0, 0] == 0.1
    third.models[0].geom_size[:] = 9
    assert make().models[0].geom_size[0, 0] == 0.1


def test_an_environment_whose_models_differ_compiles_each(compiled):
    sizes = np.random.default_rng(0)
    make = CompiledOnce(lambda: World(size=sizes.uniform(0.1, 0.2)))
    found = {make().models[0].geom_size[0, 0] for _ in range(5)}
    assert len(found) == len(compiled) == 5


def test_a_copy_that_compiles_more_than_the_first_ones_did_gets_more(compiled):
    numbers = iter([1, 1, 3])
    make = CompiledOnce(lambda: World(models=next(numbers)))
    assert len([make() for _ in range(3)][-1].models) == 3
    assert len(compiled) == 4


def test_an_error_of_the_environment_leaves_the_compilers_as_they_were():
    own = mujoco.MjModel.from_xml_string
    with pytest.raises(ValueError, match="XML"):
        CompiledOnce(lambda: mujoco.MjModel.from_xml_string("<nothing>"))()
    assert mujoco.MjModel.from_xml_string is own


def test_a_notice_of_other_environments_of_a_package_is_dropped(tmp_path, monkeypatch, capsys):
    (tmp_path / "noisy_worlds.py").write_text(
        "import sys\n"
        "print('AdroitHand has changed', file=sys.stderr)\n"
        "print('mind the gap', file=sys.stderr)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    making._import("gym:noisy_worlds:Reach-v0", "noisy_worlds:Reach-v0")
    assert capsys.readouterr().err == "mind the gap\n"
    monkeypatch.delitem(sys.modules, "noisy_worlds")
    making._import("gym:noisy_worlds:AdroitHand-v1", "noisy_worlds:AdroitHand-v1")
    assert "AdroitHand has changed" in capsys.readouterr().err
