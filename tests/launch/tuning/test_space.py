"""The search space: what its file may say, what it means for each agent, and T from T_0."""

import dataclasses
import math

import numpy as np
import pytest

import hac_suite
from analysis.program import CommandError
from analysis.reading import schema
from launch.asking import settings
from launch.tuning import space
from tests.hac_suite.tiny_envs import PointEnv

SPACE = space.read(space.FILE)
UPPER = {"subgoal_noise", "random_subgoal_rate", "subgoal_test_rate", "T_0"}


def config(label, layers):
    """The config and T_0 that a start stands for."""
    chosen, attempts = space.settings_of(SPACE.of(layers), SPACE.start(label, layers))
    return settings.to_config({**settings.as_json(hac_suite.Config()), **chosen}), attempts


@pytest.mark.parametrize("layers", [0, 1, 2])
def test_the_first_start_is_what_config_is(layers):
    assert config("default", layers) == (hac_suite.Config(), "own")


def test_the_candidate_sets_what_its_file_says():
    wanted = dataclasses.replace(hac_suite.Config(), **SPACE.starts["candidate"])
    assert config("candidate", 2) == (wanted, "own")
    assert wanted.hindsight_relabels == "future" and wanted.subgoal_noise == 0.03


def test_every_agent_has_the_same_space_but_for_what_does_nothing():
    names = [{parameter.name for parameter in SPACE.of(layers)} for layers in (0, 1, 2)]
    assert names[1] - names[0] == UPPER and names[2] - names[1] == {"test_draw"}
    assert names[0] < names[1] < names[2] and "learning_rate" in names[0]


def rows(layers, **changes):
    """What a short training of tiny networks gives, and what it took."""
    small = hac_suite.Config(
        episodes_per_period=8, test_episodes=4, batch_size=8, updates_per_episode=2,
        hidden_sizes=(8,), **changes,
    )  # fmt: skip
    results = hac_suite.train(
        PointEnv, small, [100], subgoal_layers=layers, horizons=(3,) * (layers + 1), periods=2
    )
    drop = set(schema.CLOCKS)
    return [[{k: v for k, v in row.items() if k not in drop} for row in r.rows] for r in results]


@pytest.mark.parametrize(
    ("field", "value", "least"),
    [
        ("subgoal_noise", 0.3, 1),
        ("random_subgoal_rate", 0.9, 1),
        ("subgoal_test_rate", 0.9, 1),
        ("test_draw", "each_level", 2),
    ],
)
def test_what_an_agent_is_spared_does_nothing_for_it(field, value, least):
    (parameter,) = [p for p in SPACE.parameters if p.name == field]
    assert parameter.least_layers == least
    for layers in (0, 1, 2):
        plain, changed = rows(layers), rows(layers, **{field: value})
        same = all(
            np.array_equal(list(a.values()), list(b.values()), equal_nan=True)
            for before, after in zip(plain, changed, strict=True)
            for a, b in zip(before, after, strict=True)
        )
        assert same == (layers < least)


@pytest.mark.parametrize(
    ("max_steps", "layers", "attempts", "wanted"),
    [
        (400, 0, 8, (400,)),
        (400, 0, "own", (400,)),
        (300, 1, 30, (30, 10)),
        (400, 2, 8, (8, 8, 7)),
        (400, 2, 20, (20, 5, 4)),
        (500, 2, "own", (20, 8, 3)),
        (200, 1, "own", (15, 15)),
        (200, 3, 3, (3, 5, 4, 4)),
        (20, 2, 30, (20, 1, 1)),
    ],
)
def test_the_levels_above_share_what_t_0_leaves(max_steps, layers, attempts, wanted):
    assert space.horizons(max_steps, layers, attempts, {2: (20, 8, 3)}) == wanted


@pytest.mark.parametrize("attempts", [5, 8, 12, 20, 30])
@pytest.mark.parametrize("layers", [1, 2, 3])
def test_t_spans_the_horizon_and_wastes_little(layers, attempts):
    for max_steps in (200, 300, 400, 500, 800):
        found = space.horizons(max_steps, layers, attempts, {})
        assert len(found) == layers + 1 and found[0] == attempts
        assert max_steps <= math.prod(found)
        assert math.prod(found[:-1]) * (found[-1] - 1) < max_steps


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[space", "cannot be read"),
        ("core_minutes = 1", "[space] names no hyperparameter to vary"),
        ("core_minutes = 0\n[space]\ndiscount = {low=0.9, high=1}", "core_minutes = 0"),
        ("[space]\ndiscount = {low=0.9, high=1}", "core_minutes = None"),
        ("[spaces]\ndiscount = {low=0.9, high=1}", "unknown name 'spaces': did you mean 'space'"),
        ("discuont = {low=0.9, high=1}", "did you mean 'discount'"),
        ("discount = 0.9", "discount = 0.9: it takes {low, high}, {choices}, {together}"),
        ("discount = {}", "it takes one of {low, high}, {choices}, {together}"),
        ("discount = {low=0.9, choices=[1.0]}", "it takes one of"),
        ("discount = {low=0.9}", "low = 0.9 and high = None are no range"),
        ("discount = {low=0.9, high=0.8}", "are no range"),
        ("discount = {low=0.9, high=nan}", "are no range"),
        ("discount = {low=0.9, high=1.5}", "discount is 1.5; it must be between 0 and 1"),
        ("discount = {low=0.0, high=1.0, log=true}", "true needs low above zero"),
        ("discount = {low=0.9, hihg=1.0}", "discount: unknown key 'hihg': did you mean 'high'"),
        ("discount = {low=0.9, high=1.0, least_layers=-1}", "least_layers = -1"),
        ("batch_size = {low=1.5, high=8}", "batch_size takes a value like 256"),
        ("test_draw = {choices=['tpo']}", "test_draw is 'tpo'; it must be one of top, each_level"),
        ("test_draw = {choices=[]}", "give a list of values to choose from"),
        ("test_draw = {choices=['top', 'top']}", "one of them is listed twice"),
        ("T_0 = {choices=['owm']}", "T_0 = 'owm': it takes a count, or 'own'"),
        ("T_0 = {low=2, high=9}", "T_0 takes choices"),
        ("a = {together=[{discount=0.9}, {batch_size=8}]}", "each entry must set the same fields"),
        (
            "a = {together=[{discount=0.9}]}\ndiscount = {choices=[0.98]}",
            "discount is varied twice",
        ),
        ("discount = {choices=[0.9]}\n[starts.x]", "[starts.x]: discount = 0.98 is not in the sea"),
        ("discount = {low=0.9, high=0.95}\n[starts.x]", "discount = 0.98 is not in the search sp"),
        ("discount = {choices=[0.9]}\n[starts.x]\ndicsount = 0.9", "did you mean 'discount'"),
        ("discount = {choices=[0.9]}\n[starts]\nx = 3", "[starts] must hold tables"),
    ],
)
def test_a_bad_search_file_is_answered_by_what_is_wrong(tmp_path, text, said):
    path = tmp_path / "search.toml"
    whole = text if "[space" in text or "core_" in text else f"core_minutes = 1\n[space]\n{text}"
    path.write_text(whole)
    with pytest.raises(CommandError) as caught:
        space.read(path)
    message = str(caught.value)
    assert said in message and message.startswith(str(path)) and "\n" not in message
