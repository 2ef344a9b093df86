"""Pictures that explain: they show each recorded start, failure, subgoal and value."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb

from analysis.explain import main
from analysis.figures.diagnostics import LOOKS
from analysis.figures.maps import draw_subgoal_maps, draw_values
from analysis.figures.starts import draw_failures, draw_starts
from analysis.reading import grid, names
from analysis.reading.episodes import load_episodes, load_units, some_planes
from analysis.report.explanations import explanations
from analysis.report.run_report import write_report

TASK = "pick_place"
_SPACE = {"names": ["gripper_x", "gripper_z"], "units": ["m", "m"], "threshold": [0.1, 0.2]}


def _key(seed, layers=2, stage=300):
    return {"task": TASK, "subgoal_layers": layers, "seed": seed, "train_episodes": stage}


def _starts():
    return pd.DataFrame(
        _key(seed, layers) | {
            "episode": episode, "success": int(episode != 1), "steps": 50,
            "start_gripper_x": 0.1 * episode, "start_gripper_z": 0.5,
            "goal_rod_x": 0.2 * episode, "goal_rod_z": 0.1 * seed,
        }
        for layers in (0, 2) for seed in (0, 1) for episode in range(5)
    )  # fmt: skip


def _maps():
    rows = [
        _key(0, stage=stage) | {
            "episode": 0, "level": level, "step": step,
            "outcome": "achieved" if step < stage / 100 else "missed",
            "subgoal_gripper_x": 0.1 * step, "subgoal_gripper_z": 0.1 * level,
            "goal_gripper_x": 0.3, "goal_gripper_z": 0.4,
        }
        for stage in (0, 300) for level in (1, 2) for step in range(6)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def _failed():
    episode = {"subgoal_layers": 2, "seed": 5, "episode": 3, "success": False, "subgoals": []}
    path = [[0.1 * step, 0.0] for step in range(6)]
    return {"task": TASK, "control_timestep": 0.01, "subgoal_space": _SPACE, "goal_space": _SPACE,
            "episodes": [episode | {"goal": [0.8, 0.1], "path": path}]}  # fmt: skip


def _values():
    level = {"level": 0, "title": "gripper", "names": _SPACE["names"], "units": ["m", "m"],
             "axes": [[0.0, 1.0, 2.0]] * 2, "q": [[-1, -2, -3], [-4, -5, -6], [-7, -8, -9]],
             "here": [0.0, 0.0], "goal": [1.0, 2.0]}  # fmt: skip
    return {"task": TASK, "agents": [{"subgoal_layers": 0, "seed": 1, "levels": [level]}]}


@pytest.fixture
def folder(tmp_path):
    """A run folder with results and all records."""
    run = tmp_path / TASK
    run.mkdir()
    for name in (names.RESULTS, names.MANIFEST):
        shutil.copy(grid.FOLDER / TASK / name, run / name)
    _starts().to_csv(run / names.STARTS, index=False)
    _maps().to_csv(run / names.MAPS, index=False)
    (run / names.FAILED_EPISODES).write_text(json.dumps(_failed()))
    (run / names.VALUES).write_text(json.dumps(_values()))
    return run


@pytest.mark.slow
def test_every_picture_is_written_and_in_the_report(folder, capsys):
    assert main(["", str(folder)]) == 0
    written = [line.rpartition("/")[2] for line in capsys.readouterr().out.split()]
    assert written == ["starts.png", "failures_2layers.png", "subgoal_maps.png", "values.png"]
    assert all((folder / name).stat().st_size > 5000 for name in written)
    page = write_report(folder).read_text()
    for shown in explanations(folder, TASK):
        assert shown.description in page
    assert "No episodes are recorded" not in page


@pytest.mark.slow
def test_without_records_the_command_that_makes_them_is_named(folder, capsys):
    for name in (names.STARTS, names.MAPS, names.FAILED_EPISODES, names.VALUES):
        (folder / name).unlink()
    assert main(["", str(folder)]) == 2
    assert f"launch/record_episodes.py --task={TASK} --run={folder}" in capsys.readouterr().err
    assert "launch/record_episodes.py" in write_report(folder).read_text()


def test_records_need_no_results(folder, capsys):
    """Those of published policies are in a folder of their own."""
    for name in (names.RESULTS, names.MAPS, names.FAILED_EPISODES, names.VALUES):
        (folder / name).unlink()
    assert main(["", str(folder)]) == 0
    assert capsys.readouterr().out.split() == [str(folder / "starts.png")]
    (folder / names.STARTS).unlink()
    assert main(["", str(folder)]) == 2
    assert "no results.csv here" in capsys.readouterr().err


def test_a_damaged_record_hides_no_other(folder):
    (folder / names.STARTS).write_text("nonsense")
    (folder / names.VALUES).write_text("{}")
    found = [shown.name for shown in explanations(folder, TASK)]
    assert found == ["failures_2layers", "subgoal_maps"]
    record = _failed()  # which can be read, and not be drawn
    subgoal = {"level": 1, "step": 0, "end_step": 3, "outcome": "missed", "subgoal": []}
    record["episodes"][0]["subgoals"] = [subgoal]
    (folder / names.FAILED_EPISODES).write_text(json.dumps(record))
    assert [shown.name for shown in explanations(folder, TASK)] == ["subgoal_maps"]


def test_the_published_subgoals_are_mapped_where_nothing_else_is(folder):
    (folder / names.MAPS).unlink()
    shutil.copy(grid.FOLDER / TASK / names.SUBGOALS, folder / names.SUBGOALS)
    shown = _map_of(folder)
    titles = [ax.get_title() for ax in shown.figure.axes]
    assert titles[0].startswith("trained, gripper\n")
    assert shown.caption.startswith(
        "Where the subgoals of level 2 of the agent with 2 subgoal layers are in test episodes of "
        "the trained policies."
    )


def _map_of(folder):
    (shown,) = [shown for shown in explanations(folder, TASK) if shown.name == "subgoal_maps"]
    return shown


def test_a_map_says_which_levels_and_policies_it_is_of(folder):
    training = "are in test episodes, from left to right as training continues."
    assert f"of each level of the agent with 2 subgoal layers {training}" in _map_of(folder).caption
    one = _maps().assign(subgoal_layers=1).query("level == 1 and train_episodes == 300")
    two = _maps().query("level == 2 and train_episodes == 300")
    pd.concat([one, two]).to_csv(folder / names.MAPS, index=False)
    assert (
        "level 1 of the agent with 1 subgoal layer and level 2 of the agent with 2 subgoal layers "
        "are in test episodes after 300 training episodes."
    ) in _map_of(folder).caption


def test_each_test_is_a_dot_or_a_cross():
    figure = draw_starts(_starts(), {"gripper_x": "m"})
    assert len(figure.axes) == 4  # 2 agents, start and goal
    for ax in figure.axes:
        dots, crosses = (part.get_offsets() for part in ax.collections)
        assert (len(dots), len(crosses)) == (8, 2)
    assert "2 of 10 tests of 2 seeds fail" in figure.axes[0].get_ylabel()
    assert figure.axes[0].get_xlabel() == "gripper x (m)"
    assert np.allclose(figure.axes[0].collections[1].get_offsets()[:, 0], 0.1)


def _on_a_line(table):
    """Such a table of a task whose starts, goals and subgoals are places on a line."""
    kept = [name for name in table if not name.endswith("_z")]
    names = {"start_gripper_x": "start_x", "goal_rod_x": "goal_x", "goal_gripper_x": "goal_x",
             "subgoal_gripper_x": "subgoal_x"}  # fmt: skip
    return table[kept].rename(columns=names)


def test_starts_and_goals_on_a_line_share_a_panel():
    flat, deep = draw_starts(_on_a_line(_starts()), {"x": "m"}).axes
    assert deep.get_xlabel() == "start: x (m)" and flat.get_ylabel().endswith("\ngoal: x (m)")
    np.testing.assert_allclose(flat.collections[1].get_offsets(), [[0.1, 0.2]] * 2)
    with pytest.raises(ValueError, match="no plane"):
        draw_starts(_on_a_line(_starts()).drop(columns="goal_x"), {})


@pytest.mark.parametrize("stages", [1, 2])
def test_subgoals_on_a_line_have_no_map_and_hide_no_other_picture(folder, stages):
    table = _on_a_line(_maps())
    shown = table[table["train_episodes"].isin([0, 300][:stages])]
    with pytest.raises(ValueError, match="no plane"):
        draw_subgoal_maps(shown, {})
    shown.to_csv(folder / names.MAPS, index=False)
    found = [shown.name for shown in explanations(folder, TASK)]
    assert found == ["starts", "failures_2layers", "values"]


def test_maps_count_every_subgoal_once():
    *axes, _, _ = draw_subgoal_maps(_maps(), {}).axes
    titles = [ax.get_title() for ax in axes]
    assert titles == [
        "untrained, gripper\n6 subgoals, 0% achieved",
        "after 300 episodes, gripper\n6 subgoals, 50% achieved",
    ] * 2  # fmt: skip
    for ax in axes:
        counts = ax.collections[0].get_array()
        assert counts.sum() == 6 and counts.count() == 6


def test_a_map_has_tints_of_its_level_and_one_scale_for_all_stages():
    crowded = pd.concat([_maps(), *[_maps().query("train_episodes == 300")] * 4])
    *axes, lower, upper = draw_subgoal_maps(crowded, {"gripper_x": "m"}).axes
    for scale in (lower, upper):
        assert scale.get_ylabel() == "subgoals per cell (log)"
        assert scale.get_yscale() == "log" and scale.get_ylim() == pytest.approx((1, 5))
    for ax, level in zip(axes, (1, 1, 2, 2), strict=True):
        mesh = ax.collections[0]
        assert (mesh.norm.vmin, mesh.norm.vmax) == (1, 5)
        own = np.array(to_rgb(LOOKS[level].colour))
        np.testing.assert_allclose(mesh.cmap(0.5)[:3], own, atol=0.01)
        np.testing.assert_allclose(mesh.cmap(0.0)[:3], 0.2 * own + 0.8, atol=0.01)
        assert (ax.get_xlabel(), ax.get_ylabel().split("\n")[-1]) == ("gripper x (m)", "gripper z")


def test_units_come_from_a_record_of_episodes(folder):
    assert load_units(folder) == {"gripper_x": "m", "gripper_z": "m"}
    assert _map_of(folder).figure.axes[0].get_xlabel() == "gripper x (m)"
    (folder / names.FAILED_EPISODES).write_text("{}")
    assert load_units(folder) == {}
    shutil.copy(grid.FOLDER / TASK / names.ANATOMY, folder)
    assert load_units(folder)["elbow"] == "rad"


def test_q_is_drawn_where_its_goal_is():
    ax = draw_values(_values()["agents"], TASK).axes[0]
    mesh = ax.collections[0]
    assert mesh.get_array().tolist() == [[-1, -2, -3], [-4, -5, -6], [-7, -8, -9]]
    assert "0 subgoal layers, level 0: end goals" in ax.get_title()


def test_a_failure_says_how_near_it_came(folder):
    figure = draw_failures(load_episodes(folder, TASK, names.FAILED_EPISODES))
    # It ends 0.3 from the goal in x, 3 thresholds of 0.1.
    assert "nearest: 3.0 thresholds from the goal" in figure.axes[0].get_title()
    with pytest.raises(ValueError, match="no failure"):
        draw_failures([])


def test_nearness_counts_what_only_the_end_goal_has(folder):
    record = _failed()
    wider = {"names": [*_SPACE["names"], "cart_x"], "units": ["m"] * 3, "threshold": [0.1, 0.2, 1]}
    record["goal_space"] = wider
    record["episodes"][0] |= {"goal": [0.8, 0.1, 9.0], "goal_path": [[0.0]] * 6}
    for said in ("nearest: 9.0 thresholds", "nearest: 3.0 thresholds from the goal (cart x not"):
        (folder / names.FAILED_EPISODES).write_text(json.dumps(record))
        figure = draw_failures(load_episodes(folder, TASK, names.FAILED_EPISODES))
        assert said in figure.axes[0].get_title()
        record["episodes"][0].pop("goal_path", None)


def test_planes_are_told_from_names():
    assert some_planes(["tip_x", "tip_z", "speed"]) == [("tip", (0, 1))]
    assert some_planes(["a", "b", "c"]) == [("a and b", (0, 1))]
    assert some_planes(["a"]) == []
