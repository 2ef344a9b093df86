"""The anatomy of an episode shows its path, every subgoal and what came of it."""

import json

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.patches import Rectangle

from analysis.anatomy import main
from analysis.figures.anatomy import draw_anatomy
from analysis.figures.diagnostics import LOOKS
from analysis.reading import paper
from analysis.reading.episodes import load_episodes

LEVEL_1, LEVEL_2 = (to_rgba(look.colour)[:3] for look in LOOKS[1:3])


def _subgoal(level, step, end_step, outcome, point):
    keys = ("level", "step", "end_step", "outcome", "subgoal")
    return dict(zip(keys, (level, step, end_step, outcome, point), strict=True))


def _record():
    """Two agents of pick-and-place that move the gripper and the rod along x for 40 steps."""
    path = [[0.01 * step, 0.5, 0.02 * step, 0.2] for step in range(41)]
    episode = {"seed": 7, "episode": 0, "success": True, "goal": [0.8, 0.2], "path": path}
    subgoals = [
        _subgoal(1, 0, 10, "achieved", [0.1, 0.5, 0.2, 0.2]),
        _subgoal(1, 10, 30, "missed", [0.9, 0.9, 0.2, 0.2]),
        _subgoal(1, 30, 40, "cut short", [0.5, 0.5, 0.9, 0.2]),
        _subgoal(2, 0, 30, "missed", [0.2, 0.9, 0.3, 0.3]),
        _subgoal(2, 30, 40, "achieved", [0.4, 0.5, 0.8, 0.2]),
    ]
    return {
        "task": "pick_place",
        "control_timestep": 0.015,
        "subgoal_space": {
            "names": ["gripper_x", "gripper_z", "rod_x", "rod_z"],
            "units": ["m"] * 4,
            "threshold": [0.05, 0.05, 0.07, 0.07],
        },
        "goal_space": {"names": ["rod_x", "rod_z"], "units": ["m"] * 2, "threshold": [0.07, 0.08]},
        "episodes": [
            episode | {"subgoal_layers": 0, "subgoals": []},
            episode | {"subgoal_layers": 2, "subgoals": subgoals},
        ],
    }


@pytest.fixture
def folder(tmp_path):
    """A folder of run folders of which one has a record."""
    (tmp_path / "pick_place").mkdir()
    (tmp_path / "pick_place" / "anatomy.json").write_text(json.dumps(_record()))
    return tmp_path


@pytest.fixture
def axes(folder):
    """The axes of the agent with two subgoal layers: two planes, four dimensions, outcomes."""
    _, deep = load_episodes(folder / "pick_place", "pick_place")
    return draw_anatomy(deep).axes


def _boxes(ax, colour):
    """Rectangles of a colour: start, lowest value, width, height, whether they are filled."""
    return [
        (*box.get_xy(), box.get_width(), box.get_height(), box.get_facecolor()[:3] == colour)
        for box in ax.patches
        if isinstance(box, Rectangle) and box.get_edgecolor()[:3] == colour
    ]


def test_planes_show_the_path_the_goal_and_subgoals_filled_if_achieved(axes):
    gripper, rod = axes[:2]
    assert (gripper.get_title(), rod.get_title()) == ("gripper", "rod")
    lines = {len(line.get_xdata()): line for line in rod.lines}
    np.testing.assert_allclose(lines[41].get_xdata(), 0.02 * np.arange(41))
    (goal,) = rod.patches
    assert goal.get_xy() == pytest.approx((0.73, 0.12))
    assert (goal.get_width(), goal.get_height()) == pytest.approx((0.14, 0.16))
    assert not gripper.patches  # the end goal says nothing about the gripper
    filled = {}
    for line in gripper.lines:
        edge, face = (
            to_rgba(c)[:3] for c in (line.get_markeredgecolor(), line.get_markerfacecolor())
        )
        if len(line.get_xdata()) == 1 and edge in (LEVEL_1, LEVEL_2):
            filled[line.get_xdata()[0]] = face == edge
    assert filled == {0.1: True, 0.9: False, 0.5: False, 0.2: False, 0.4: True}
    assert [text.get_text() for text in gripper.texts] == ["1", "2"]  # the top level's


def test_missed_subgoals_are_crossed_in_planes_and_hatched_over_time(axes):
    gripper, gripper_z = axes[0], axes[3]
    crossed = {line.get_xdata()[0] for line in gripper.lines if line.get_marker() == "x"}
    assert crossed == {0.9, 0.2}
    hatched = [box.get_x() for box in gripper_z.patches if box.get_hatch()]
    assert sorted(hatched) == [0, 10]


def test_dimensions_show_each_subgoal_for_as_long_as_it_stood(axes):
    gripper_z = axes[3]
    assert gripper_z.get_ylabel() == "gripper z\n(m)"
    expected = [
        (0, 0.45, 10, 0.1, True),
        (10, 0.85, 20, 0.1, False),
        (30, 0.45, 10, 0.1, False),
    ]
    assert _boxes(gripper_z, LEVEL_1) == [pytest.approx(box) for box in expected]
    assert [box[0] for box in _boxes(gripper_z, LEVEL_2)] == [0, 30]


def test_outcomes_tell_achieved_missed_and_cut_short_apart(axes):
    outcomes = axes[-1]
    bars = {
        (bar.get_x(), bar.get_width(), bar.get_edgecolor()[:3]): (
            bar.get_facecolor()[:3] == bar.get_edgecolor()[:3],
            bar.get_hatch() is not None,
        )
        for bar in outcomes.patches
    }
    assert bars == {
        (0, 10, LEVEL_1): (True, False),
        (10, 20, LEVEL_1): (False, True),
        (30, 10, LEVEL_1): (False, False),
        (0, 30, LEVEL_2): (False, True),
        (30, 10, LEVEL_2): (True, False),
    }
    assert [label.get_text() for label in outcomes.get_yticklabels()] == ["level 1", "level 2"]
    assert outcomes.get_xlim() == (0, 40)


def test_the_legend_lies_outside_the_data_and_counts(folder):
    flat, deep = map(draw_anatomy, load_episodes(folder / "pick_place", "pick_place"))
    assert all(ax.get_legend() is None for ax in deep.axes)
    texts = [text.get_text() for text in deep.legends[0].get_texts()]
    assert "level 1's subgoals: 1 of 3 achieved" in texts
    assert "level 2's subgoals: 1 of 2 achieved" in texts
    assert "hollow: cut short, by a level above or the end" in texts
    assert deep.get_suptitle() == (
        "1-Object Pick-and-Place, 2 subgoal layers, seed 7: goal achieved in 40 steps"
    )
    assert [text.get_text() for text in flat.axes[-1].texts] == ["proposes no subgoals"]


def test_a_point_in_space_is_seen_from_two_sides(folder):
    record = _record()
    record["subgoal_space"]["names"] = ["effector_x", "effector_y", "effector_z", "speed"]
    (folder / "pick_place" / "anatomy.json").write_text(json.dumps(record))
    flat, _ = load_episodes(folder / "pick_place", "pick_place")
    above, side, *_ = draw_anatomy(flat).axes
    assert (above.get_title(), side.get_title()) == (
        "effector, from above",
        "effector, from the side",
    )
    assert side.get_ylabel() == "effector z (m)"


def test_dimensions_that_are_no_places_are_drawn_as_well(folder):
    """Those of Gymnasium environments have numbers for names, and no units."""
    record = _record()
    record["goal_space"] = record["subgoal_space"] = {
        "names": [f"goal[{i}]" for i in range(4)], "units": [""] * 4, "threshold": [0.1] * 4
    }  # fmt: skip
    for episode in record["episodes"]:
        episode["goal"] = [0.4, 0.5, 0.8, 0.2]
    (folder / "pick_place" / "anatomy.json").write_text(json.dumps(record))
    _, deep = load_episodes(folder / "pick_place", "pick_place")
    plane, first, *_ = draw_anatomy(deep).axes
    assert plane.get_title() == "goal[0] and goal[1]" and len(plane.patches) == 1
    assert first.get_ylabel() == "goal[0]"


def test_a_space_of_one_dimension_has_no_plane(folder):
    record = _record()
    record["goal_space"] = record["subgoal_space"] = {
        "names": ["goal[0]"], "units": [""], "threshold": [0.1]
    }  # fmt: skip
    for episode in record["episodes"]:
        episode["goal"], episode["path"] = [0.4], [point[:1] for point in episode["path"]]
        for subgoal in episode["subgoals"]:
            subgoal["subgoal"] = subgoal["subgoal"][:1]
    (folder / "pick_place" / "anatomy.json").write_text(json.dumps(record))
    flat, deep = map(draw_anatomy, load_episodes(folder / "pick_place", "pick_place"))
    assert [ax.get_xlabel() for ax in flat.axes] == ["", "step"]
    assert len(_boxes(deep.axes[0], LEVEL_1)) == 3


@pytest.mark.parametrize("recorded", [True, False])
def test_what_only_the_end_goal_has_is_shown_or_said_to_be_missing(folder, recorded):
    record = _record()
    record["goal_space"] = {
        "names": ["rod_x", "cart_x", "rod_z"], "units": ["m", "m", "m"],
        "threshold": [0.07, 0.2, 0.08],
    }  # fmt: skip
    for episode in record["episodes"]:
        episode["goal"] = [0.8, 0.5, 0.2]
        if recorded:
            episode["goal_path"] = [[0.1 * step] for step in range(41)]
    (folder / "pick_place" / "anatomy.json").write_text(json.dumps(record))
    _, deep = load_episodes(folder / "pick_place", "pick_place")
    *_, cart, outcomes = draw_anatomy(deep).axes
    assert cart.get_ylabel() == "cart x\n(m)" and outcomes.get_xlabel() == "step"
    (band,) = cart.patches
    assert (band.get_y(), band.get_height()) == pytest.approx((0.3, 0.4))
    said = cart.get_title(loc="right")
    if recorded:
        np.testing.assert_allclose(cart.lines[0].get_ydata(), 0.1 * np.arange(41))
        assert said == "only the end goal asks for it"
    else:
        assert not cart.lines and said.endswith("where the agent was is not recorded")


def test_a_goal_path_of_other_dimensions_is_refused(folder):
    record = _record()
    record["episodes"][0]["goal_path"] = [[0.0]] * 41  # both dimensions are subgoals' as well
    (folder / "pick_place" / "anatomy.json").write_text(json.dumps(record))
    with pytest.raises(ValueError, match="does not match the path"):
        load_episodes(folder / "pick_place", "pick_place")


@pytest.mark.slow
def test_the_command_draws_what_is_recorded_and_names_what_is_not(folder, capsys):
    assert main(["", "--data", str(folder)]) == 0
    printed = capsys.readouterr().out.splitlines()
    task = "pendulum_climb"
    command = f"python launch/record_subgoals.py --task={task} --output={folder}/{task}"
    assert printed[0] == f"{task}: no episodes are recorded; record some with `{command}`"
    assert len(printed) == len(paper.TITLES) - 1 + 2
    for name in printed[-2:]:
        assert (folder / name).stat().st_size > 30_000


@pytest.mark.parametrize("change", [lambda r: r.pop("episodes"), lambda r: r.update(episodes=[{}])])
def test_a_damaged_record_is_named_with_the_command_that_makes_it(folder, capsys, change):
    record = _record()
    change(record)
    path = folder / "pick_place" / "anatomy.json"
    path.write_text(json.dumps(record))
    assert main(["", "--data", str(folder)]) == 2
    error = capsys.readouterr().err
    assert str(path) in error and "launch/record_subgoals.py --task=pick_place" in error
