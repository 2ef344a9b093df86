"""Verdicts on claims (a) to (e) follow the data: made-up results whose answer is known."""

import dataclasses
import json

import numpy as np
import pandas as pd
import pytest

from analysis.claims import COLUMNS, WHY_FILE, judge, main
from analysis.reading import paper
from analysis.statistics.areas import common_budget
from analysis.verdicts.evidence import (
    NOT_SUPPORTED,
    SUPPORTED,
    UNDECIDED,
    Evidence,
    judge_gain,
)
from analysis.verdicts.learning_claims import falls_in_missed, late_missed
from analysis.verdicts.speed_claims import areas_of, episodes_to_solved


def _like(curve, seeds=6):
    """Curves of seeds that differ a little in their last but one test period."""
    return [[*curve[:-2], curve[-2] + 0.005 * seed, curve[-1]] for seed in range(seeds)]


SLOW, FAST, FASTER = [0.0, 0.0, 0.1, 0.2], [0.0, 0.5, 0.8, 0.95], [0.0, 0.9, 0.95, 0.97]
AS_IN_THE_PAPER = {0: _like(SLOW), 1: _like(FAST), 2: _like(FASTER)}


@pytest.fixture
def make_grid(make_run):
    """Writes a grid: every task with the same curves but for those given; None leaves it out."""

    def make(curves=AS_IN_THE_PAPER, **others):
        folder = None
        for task, steps in paper.STEPS_TO_GOAL.items():
            own = others.get(task, curves)
            if own is not None:
                folder = make_run(own, task=task, steps=steps).parent
        return folder

    return make


def _claims(folder):
    return {claim.letter: claim for claim in judge(folder)}


def _verdicts(claim):
    return {(item.task, item.agents): item.verdict for item in claim.evidence if item.verdict}


def test_results_like_the_papers_support_its_claims(make_grid):
    # Ten seeds: six could not decide (e) after a correction for fifteen comparisons.
    ten = {0: _like(SLOW, 10), 1: _like(FAST, 10), 2: _like(FASTER, 10)}
    claims = _claims(make_grid(ten))
    assert [claims[letter].verdict for letter in "abcde"] == [SUPPORTED] * 5
    assert claims["a"].reason == "supported on 10 of 10"
    assert claims["c"].reason == "supported on 4 of 4; not counted: pick_place, supported"
    assert claims["e"].reason == "supported on 15 of 15"


@pytest.mark.slow
def test_one_task_where_the_flat_agent_is_as_good_speaks_against_every_task(make_grid):
    claims = _claims(make_grid(pendulum_climb=dict.fromkeys(range(3), _like(FAST))))
    assert claims["a"].verdict == claims["c"].verdict == NOT_SUPPORTED
    verdicts = _verdicts(claims["a"])
    assert verdicts.pop(("pendulum_climb", "1 against 0")) == NOT_SUPPORTED
    assert verdicts.pop(("pendulum_climb", "2 against 0")) == NOT_SUPPORTED
    assert set(verdicts.values()) == {SUPPORTED}
    assert "not supported: pendulum_climb (1 against 0), pendulum_climb (2 " in claims["a"].reason
    assert claims["b"].verdict == SUPPORTED  # on four tasks, which are many


@pytest.mark.slow
def test_pick_and_place_is_the_papers_exception_to_deeper_is_faster(make_grid):
    claims = _claims(make_grid(pick_place={0: _like(SLOW), 1: _like(FASTER), 2: _like(FAST)}))
    assert claims["c"].verdict == SUPPORTED
    assert _verdicts(claims["c"])["pick_place", "2 against 1"] == NOT_SUPPORTED


@pytest.mark.slow
def test_missing_tasks_and_agents_leave_claims_undecided_and_are_named(make_grid):
    missing = {"cartpole_swingup": None, "ur5_reacher": {0: _like(SLOW), 2: _like(FAST)}}
    claims = _claims(make_grid(**missing))
    assert [claims[letter].verdict for letter in "acde"] == [UNDECIDED] * 4
    assert claims["a"].reason.endswith("no data: ur5_reacher 1 against 0, cartpole_swingup")
    assert claims["e"].reason.endswith("no data: ur5_reacher (1, level 1), cartpole_swingup")
    assert claims["b"].verdict == SUPPORTED


@pytest.mark.slow
def test_few_seeds_decide_nothing(make_grid):
    few = {layers: seeds[:4] for layers, seeds in AS_IN_THE_PAPER.items()}
    verdicts = {letter: claim.verdict for letter, claim in _claims(make_grid(few)).items()}
    # All agents' converged seeds count together for (d).
    assert [verdicts[letter] for letter in "abce"] == [UNDECIDED] * 4


@pytest.mark.slow
def test_seeds_that_all_tie_are_judged_without_nan(make_grid):
    nothing, everything = [[0.0] * 4] * 6, [[0.0, 1.0, 1.0, 1.0]] * 6
    claims = _claims(make_grid({0: nothing, 1: everything, 2: everything}))
    gain, improvement, episodes = claims["a"].evidence[:3]
    assert (gain.value, gain.low, gain.high) == pytest.approx((5 / 6,) * 3)
    assert (improvement.value, improvement.low, improvement.high) == (1, 1, 1)
    assert (episodes.value, episodes.low, episodes.high) == (600, 600, 600)
    assert (claims["a"].verdict, claims["c"].verdict) == (SUPPORTED, NOT_SUPPORTED)
    for claim in claims.values():
        for item in claim.evidence:
            assert np.isfinite([item.value, item.low, item.high]).all()


def test_a_gain_that_may_be_large_or_none_is_undecided(make_grid):
    scattered = [[0.0, 0.1 * seed, 0.2 * seed, 0.2 * seed] for seed in range(6)]
    claims = _claims(make_grid({0: scattered, 1: scattered, 2: scattered}))
    gain = claims["a"].evidence[0]
    assert gain.value == 0 and gain.low < -0.05 and gain.high > 0.05
    assert claims["a"].verdict == claims["c"].verdict == UNDECIDED


@pytest.mark.slow
def test_a_flat_agent_that_solves_most_tasks_refutes_inconsistency(make_grid):
    claims = _claims(make_grid(dict.fromkeys(range(3), _like(FAST)), pick_place=AS_IN_THE_PAPER))
    assert claims["b"].verdict == NOT_SUPPORTED
    assert _verdicts(claims["b"])["pick_place", "0"] == SUPPORTED


@pytest.mark.slow
def test_steps_far_from_the_papers_are_not_supported(make_grid, make_results):
    folder = make_grid()
    slow = make_results(AS_IN_THE_PAPER, "ur5_reacher", steps=100)
    slow.to_csv(folder / "ur5_reacher" / "results.csv", index=False)
    claim = _claims(folder)["d"]
    assert claim.verdict == NOT_SUPPORTED
    assert _verdicts(claim)["ur5_reacher", "any, converged"] == NOT_SUPPORTED
    # 12 converged seeds take 100 to 105 steps, against the paper's 60.
    assert claim.evidence[2].value == pytest.approx(102.5 / 60)


@pytest.mark.slow
def test_a_seed_that_ended_early_is_named(make_grid):
    ended = {**AS_IN_THE_PAPER, 2: [[0.0, 0.9, None, None], *_like(FASTER)[1:]]}
    claims = _claims(make_grid(ur5_reacher=ended))
    cut = "; ur5_reacher compared over 300 of 900 episodes, a seed's last"
    assert claims["a"].reason.endswith(cut) and claims["c"].reason.endswith(cut)


def test_areas_end_where_the_first_seed_does(make_results):
    results = make_results({0: [[0.0, 1.0, 1.0, 1.0]], 1: [[0.0, 0.5, 1.0, None]]})
    assert common_budget(results) == 600
    assert areas_of(results, 0).tolist() == [0.75]
    assert areas_of(results, 1).tolist() == [0.5]


def test_episodes_to_80_percent_are_infinite_where_it_never_comes(make_results):
    results = make_results({1: [[0.0, 0.8, 0.5], [0.0, 0.5, 0.7], [0.9, 0.0, 0.0]]})
    assert episodes_to_solved(results, 1).tolist() == [300, np.inf, 0]


def test_falls_in_missed_subgoals_by_hand(make_results):
    # The made-up share of achieved subgoals equals the success rate; there is none at period 0.
    results = make_results({1: [[0.0, 0.2, 0.4, 0.6, 0.8], [0.0, 0.5, 0.25], [0.0, 0.5]]})
    falls = falls_in_missed(results, 1, 1)
    assert falls.to_dict() == pytest.approx({0: 0.4, 1: -0.25})
    assert falls_in_missed(results, 1, 2).empty


def test_what_is_still_missed_by_hand(make_results):
    results = make_results({1: [[0.0, 0.2, 0.4, 0.6, 0.8], [0.0, 0.5, 0.25]]})
    results["level1_test_achieved"] = 1 - results["period"] / 10
    missed = late_missed(results, 1, 1, "achieved")
    assert missed.to_dict() == pytest.approx({0: 0.4, 1: 0.625})
    in_tests = late_missed(results, 1, 1, "test_achieved")
    assert in_tests.to_dict() == pytest.approx({0: 0.3, 1: 0.1})
    assert late_missed(results, 2, 1, "test_achieved").empty


def test_command_line_prints_and_writes_every_claim(make_grid, tmp_path, capsys):
    folder, output = make_grid(cartpole_swingup=None), tmp_path / "out"
    (folder / WHY_FILE).write_text('{"a": "the task is easy"}')
    assert main(["", "--data", str(folder), f"--output={output}"]) == 0
    printed = capsys.readouterr().out
    assert all(f"({letter}) " in printed for letter in "abcdefg")
    command = f"python launch/record_subgoals.py --task=pick_place --output={folder}/pick_place"
    assert command in printed
    table = pd.read_csv(output / "claims.csv")
    assert tuple(table.columns) == COLUMNS
    own = table[table["task"] == "all"].set_index("claim")["verdict"]
    assert own.to_dict() == {**dict.fromkeys("abcdefg", UNDECIDED), "b": SUPPORTED}
    described = json.loads((output / "claims.json").read_text(), parse_constant=pytest.fail)
    assert [claim["letter"] for claim in described["claims"]] == list("abcdefg")
    assert described["claims"][0]["why"] == "the task is easy"
    page = (output / "claims.md").read_text()
    assert "Note: the task is easy" in page
    assert page.count("| (") == 7
    costs = (output / "costs.md").read_text().splitlines()
    rows = [line.split(" | ") for line in costs if line.startswith("| pendulum_climb")]
    assert [row[1] for row in rows] == ["1 against 0", "2 against 0"] * 2
    assert all(
        float(cell.split()[0]) > 0 for cell in rows[0][2:]
    )  # it learns faster, and costs as much


def test_what_cannot_be_judged_is_answered_in_one_line(make_grid, tmp_path, capsys):
    assert main(["", "--data", str(tmp_path / "none")]) == 2
    folder = make_grid({1: [[0.0, 0.5]] * 2})
    (folder / WHY_FILE).write_text("[1]")
    assert main(["", "--data", str(folder)]) == 2
    assert "letters of claims to texts" in capsys.readouterr().err


def test_the_strongest_flat_agent_is_the_one_to_beat(make_grid, make_run, tmp_path):
    strong = make_run({0: _like(FASTER), 1: _like(SLOW)}, task="pendulum_climb")
    strong.rename(tmp_path / "climb")
    make_grid().rename(tmp_path / "grid")
    (tmp_path / "grid_td3").mkdir()
    (tmp_path / "climb").rename(tmp_path / "grid_td3" / "pendulum_climb")
    claims = _claims(tmp_path / "grid")
    verdicts = _verdicts(claims["a"])
    assert verdicts["pendulum_climb", "1 against 0 (TD3+HER)"] == NOT_SUPPORTED
    assert verdicts["pick_place", "1 against 0"] == SUPPORTED  # there is no other
    assert claims["a"].verdict == NOT_SUPPORTED
    weaker = [item for item in claims["a"].evidence if item.agents == "1 against 0 (DDPG+HER)"]
    assert [(item.task, item.verdict) for item in weaker] == [("pendulum_climb", "")]
    assert weaker[0].value > 0.3
    shares = {item.agents: item.value for item in claims["b"].evidence if item.value > 0}
    assert shares == {"0 (TD3+HER)": 1.0}  # all its seeds end at 97%


@pytest.mark.slow
def test_a_weaker_flat_agent_changes_no_verdict(make_grid, make_run, tmp_path):
    weak = make_run({0: [[0.0] * 4] * 6}, task="pendulum_climb")
    weak.rename(tmp_path / "climb")
    make_grid().rename(tmp_path / "grid")
    before = _claims(tmp_path / "grid")
    (tmp_path / "grid_td3").mkdir()
    (tmp_path / "climb").rename(tmp_path / "grid_td3" / "pendulum_climb")
    after = _claims(tmp_path / "grid")
    assert after["a"].headline == before["a"].headline and after["a"].reason == before["a"].reason
    assert [e.value for e in after["b"].evidence] == [e.value for e in before["b"].evidence]
    named = {item.agents for item in after["a"].evidence if item.task == "pendulum_climb"}
    assert {"1 against 0 (DDPG+HER)", "1 against 0 (TD3+HER)"} <= named


def test_a_gain_that_is_sure_and_small_is_too_small():
    sure = Evidence("x", "2 against 1", "gain", "points", (10, 10), 0.02, 0.01, 0.03, 0.001, 0.001)
    assert judge_gain(sure).verdict == NOT_SUPPORTED
    assert judge_gain(dataclasses.replace(sure, high=0.06)).verdict == SUPPORTED
