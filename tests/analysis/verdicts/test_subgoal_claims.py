"""Verdicts on claims (f) and (g) follow where recorded subgoals lie."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import analysis
from analysis.reading.subgoals import recording_command
from analysis.verdicts.evidence import NOT_SUPPORTED, SUPPORTED, UNDECIDED
from analysis.verdicts.subgoal_claims import far_goals, judge_subgoals, relative_position

SEEDS = range(6)


def _row(task, seed, *, layers=2, level=2, episode=0, step=0):
    return {
        "task": task, "subgoal_layers": layers, "seed": seed, "episode": episode, "level": level,
        "step": step, "end_step": step + 9, "outcome": "achieved",
    }  # fmt: skip


def _reach(seed, part, *, distance=1.0, aside=0.0, **key):
    """A subgoal `part` of the way along x to a goal."""
    points = {
        "start_effector_x": 0.1, "start_effector_y": 0.0, "start_effector_z": 0.5,
        "goal_effector_x": 0.1 + distance, "goal_effector_y": 0.0, "goal_effector_z": 0.5,
        "subgoal_effector_x": 0.1 + part * distance, "subgoal_effector_y": aside,
        "subgoal_effector_z": 0.5,
    }  # fmt: skip
    return _row("ur5_reacher", seed, **key) | points


def _pick(seed, gripper, attached, **key):
    """A gripper's subgoal while the rod stands at x = 0.5 m and is to go to x = -0.5 m."""
    points = {
        "start_rod_x": 0.5, "start_rod_z": 0.125, "goal_rod_x": -0.5, "goal_rod_z": 0.4,
        "subgoal_gripper_x": gripper[0], "subgoal_gripper_z": gripper[1],
        "subgoal_rod_x": 0.5, "subgoal_rod_z": 0.125, "attached": float(attached),
    }  # fmt: skip
    return _row("pick_place", seed, **key) | points


@pytest.fixture
def judged(tmp_path):
    """Writes subgoals of a task and returns the claim about it."""

    def write(rows):
        task = rows[0]["task"]
        (tmp_path / task).mkdir()
        pd.DataFrame(rows).to_csv(tmp_path / task / "subgoals.csv", index=False)
        f, g = judge_subgoals(tmp_path)
        return {"ur5_reacher": f, "pick_place": g}[task]

    return write


def _judged_shares(claim):
    return {item.agents: (item.value, item.verdict) for item in claim.evidence if item.verdict}


@pytest.mark.parametrize(
    ("parts", "share", "verdict"),
    [
        ((0.5, 0.4, 0.7), 1, SUPPORTED),
        ((1.0, 0.9, 0.5), 1 / 3, NOT_SUPPORTED),
        ((-0.2, 1.2, 0.8), 0, NOT_SUPPORTED),
    ],
)
def test_halfway_is_measured_along_the_way(judged, parts, share, verdict):
    claim = judged([_reach(seed, part) for seed in SEEDS for part in parts])
    assert _judged_shares(claim) == {"2, far goals": (pytest.approx(share), verdict)}
    assert claim.verdict == verdict
    assert claim.evidence[1].value == pytest.approx(np.median(parts), abs=1e-3)


def test_seeds_that_disagree_leave_it_undecided(judged):
    claim = judged([_reach(seed, 0.5 if seed % 2 else 1.0) for seed in SEEDS])
    assert claim.verdict == UNDECIDED and claim.headline.value == 0.5


def test_only_first_subgoals_of_far_goals_of_the_deepest_agent_count(judged):
    rows = [_reach(seed, 0.5, distance=1.0) for seed in SEEDS]
    rows += [_reach(seed, 1.0, distance=0.3, episode=1) for seed in SEEDS]  # near
    rows += [_reach(seed, 1.0, distance=1.0, step=20) for seed in SEEDS]  # under way
    rows += [_reach(seed, 1.0, distance=1.0, layers=1, level=1) for seed in SEEDS]
    claim = judged(rows)
    assert (claim.headline.value, claim.verdict) == (1, SUPPORTED)


def test_relative_position_by_hand():
    table = pd.DataFrame([_reach(0, 0.5, distance=2.0, aside=0.5), _reach(0, -0.25, distance=0.8)])
    along, beside = relative_position(table)
    np.testing.assert_allclose(along, [0.5, -0.25])
    np.testing.assert_allclose(beside, [0.25, 0], atol=1e-12)
    assert far_goals(table).index.tolist() == [0]


TOP, TARGET_TOP = (0.5, 0.25), (-0.5, 0.525)  # of the rod as it stands, and at the target


@pytest.mark.parametrize(
    ("before", "after", "verdicts"),
    [
        (TOP, TARGET_TOP, (SUPPORTED, SUPPORTED)),
        ((0.3, 0.3), (-0.4, 0.6), (SUPPORTED, SUPPORTED)),
        (TARGET_TOP, TOP, (NOT_SUPPORTED, NOT_SUPPORTED)),
        (TOP, TOP, (SUPPORTED, NOT_SUPPORTED)),
    ],
)
def test_the_grippers_subgoal_moves_from_the_rod_to_the_target(judged, before, after, verdicts):
    rows = [_pick(seed, *pair) for seed in SEEDS for pair in ((before, 0), (after, 1))]
    claim = judged(rows)
    shares = _judged_shares(claim)
    assert shares["2, before attachment"][1] == verdicts[0]
    assert shares["2, after attachment"][1] == verdicts[1]
    assert claim.verdict == (SUPPORTED if set(verdicts) == {SUPPORTED} else NOT_SUPPORTED)
    distances = {
        item.agents: item.value for item in claim.evidence if "from the rod" in item.quantity
    }
    assert distances["2, before attachment"] == pytest.approx(np.hypot(*np.subtract(before, TOP)))


def test_an_agent_that_never_attaches_is_not_taken_for_one_that_does(judged):
    claim = judged([_pick(seed, TOP, 0) for seed in SEEDS])
    assert claim.verdict == UNDECIDED
    assert "no data: after attachment" in claim.reason


def test_without_records_the_claims_name_the_command(tmp_path):
    for claim, task in zip(judge_subgoals(tmp_path), ("ur5_reacher", "pick_place"), strict=True):
        assert claim.verdict == UNDECIDED and claim.headline is None
        command = f"`python launch/record_subgoals.py --task={task} --output={tmp_path}/{task}`"
        assert claim.reason.startswith("no data: ") and command in claim.reason


def test_commands_are_to_be_run_from_the_root():
    published = Path(analysis.__file__).parent / "data" / "ur5_reacher"
    command = recording_command("ur5_reacher", published)
    assert command.endswith("--task=ur5_reacher --output=analysis/data/ur5_reacher")


def test_records_of_other_agents_are_no_data(judged):
    claim = judged([_reach(seed, 0.5, layers=1, level=1) for seed in SEEDS])
    assert claim.verdict == UNDECIDED and "any of 2 subgoal layers" in claim.reason


@pytest.mark.parametrize("text", ["", "task,seed\nur5_reacher,0\n", "a\n1,2,3\n4\n"])
def test_a_damaged_record_is_named(tmp_path, text):
    (tmp_path / "ur5_reacher").mkdir()
    path = tmp_path / "ur5_reacher" / "subgoals.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=str(path)):
        judge_subgoals(tmp_path)
