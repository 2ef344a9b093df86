"""Whether hierarchy helps: made-up results whose answer is known, and what cannot be compared."""

import json
import re

import numpy as np
import pandas as pd
import pytest

from analysis import verdict
from analysis.verdicts import hierarchy
from analysis.verdicts.hierarchy import HELPS, HURTS, SMALL, UNDECIDED

SLOW, FAST = [0.0, 0.0, 0.1, 0.2], [0.0, 0.5, 0.8, 0.95]


def like(curve, seeds=8):
    """Curves of seeds that differ a little in their last but one test period."""
    return [[*curve[:-2], curve[-2] + 0.005 * seed, curve[-1]] for seed in range(seeds)]


@pytest.mark.parametrize(
    ("flat", "deep", "says"),
    [
        (like(SLOW), like(FAST), HELPS),
        (like(FAST), like(SLOW), HURTS),
        (like(FAST), [[0, 0.51, 0.81, 0.95]] * 8, SMALL),
        (like(SLOW, 3), like(FAST, 3), UNDECIDED),
    ],
)
def test_the_verdict_follows_the_data(make_results, flat, deep, says):
    (found,) = hierarchy.judge(make_results({0: flat, 1: deep}), {})
    assert (found.subgoal_layers, found.says) == (1, says)
    assert f"1 subgoal layer: {says} at equal environment steps (" in found.sentence


def test_area_is_compared_at_equal_steps_minutes_and_episodes(make_results):
    curve = [0.0, 0.3, 0.5, 0.6, 0.7, 0.8, 0.95]
    results = make_results({0: like(curve), 1: like(curve)})
    deep = results["subgoal_layers"] == 1
    results["core_seconds"] = results["wall_seconds"] / 8
    # The same curves in half the environment steps and in twice the time.
    results.loc[deep, "train_steps"] //= 2
    results.loc[deep, "core_seconds"] *= 2
    (found,) = hierarchy.judge(results, {})
    gains = {item.quantity: item.value for item in found.evidence if "area" in item.quantity}
    steps, improvement, minutes, updates, episodes = gains.values()
    assert steps > 0.1 and minutes < -0.1 and episodes == 0
    assert updates == pytest.approx(minutes)  # two levels: twice as many
    assert improvement > 0.9  # of a seed at equal environment steps
    assert found.says == HELPS  # environment steps decide
    assert found.short == "it helps at equal environment steps, it loses at equal core-minutes"
    gain, loss = found.sentence.split("; ")
    assert "it helps at equal environment steps (a gain: +" in gain
    assert loss.startswith("it loses at equal core-minutes (a loss: -")


def test_a_loss_is_called_a_loss_wherever_it_is_told(make_results):
    losses = np.array([0.2, -0.3, 0.1, -0.25, 0.0, -0.2])
    deep = [[0, *[0.5 + loss] * 3] for loss in losses]
    results = make_results({0: [[0, 0.5, 0.5, 0.5]] * 6, 1: deep})
    (found,) = hierarchy.judge(results, {})
    assert found.says == UNDECIDED and found.deciding.value < 0
    assert found.sentence.count("a loss: -") == 2  # at equal steps and at equal minutes
    assert (
        "If the true loss at equal environment steps is the one measured, about" in found.sentence
    )
    told = [found.sentence, *(item.quantity for item in found.evidence)]
    assert not re.search(r"\bgains?\b", " ".join(told))


def test_seeds_are_compared_with_themselves(make_results):
    """Seeds differ much, but each gains the same: pairs tell what means do not."""
    base = np.linspace(0, 0.8, 8)
    flat = [[0, level, level, level] for level in base]
    deep = [[0, *[level + 0.1] * 3] for level in base]
    results = make_results({0: flat, 2: deep})
    (found,) = hierarchy.judge(results, {})
    assert found.deciding.value == pytest.approx(0.25 / 3) and found.says == HELPS
    lacking = results[(results["subgoal_layers"] == 0) | (results["seed"] > 1)]
    (fewer,) = hierarchy.judge(lacking, {})
    assert fewer.deciding.seeds == (6,)


def test_the_strongest_flat_agent_counts(make_results):
    results = make_results({0: like(SLOW), 1: like(FAST), 2: like(FAST)})
    strong = make_results({0: like([0, 0.9, 0.95, 1.0])})
    found = hierarchy.judge(results, {"TD3": strong})
    assert [one.subgoal_layers for one in found] == [1, 2]
    assert {one.says for one in found} == {HURTS}
    assert {name for one in found for name in one.rivals.values()} == {"TD3"}
    weak = make_results({0: [[0.0] * 4] * 8})
    found = hierarchy.judge(results, {"TD3": weak})
    assert {name for one in found for name in one.rivals.values()} == {"DDPG+HER"}


def test_the_strongest_flat_agent_is_chosen_at_what_is_equal(make_results):
    """One is better per episode; it takes eight times as many environment steps."""
    results = make_results({0: like([0.0, 0.4, 0.5, 0.6]), 1: like(FAST)})
    other = make_results({0: like([0.0, 0.6, 0.7, 0.5])})
    other["train_steps"] *= 8
    (found,) = hierarchy.judge(results, {"TD3": other})
    assert (found.rivals["train_episodes"], found.rivals["train_steps"]) == ("TD3", "DDPG+HER")
    assert "(DDPG+HER at equal environment steps, TD3 at equal core-minutes)" in found.sentence
    named = {item.quantity: item.agents for item in found.evidence}
    last = next(agents for quantity, agents in named.items() if "last 3" in quantity)
    assert last == "1 against 0 (TD3)"  # 0.6 on average, the other 0.5
    ((_, steps, *_, episodes),) = hierarchy.costs([found])
    assert steps.endswith("(DDPG+HER)") and episodes.endswith("(TD3)")
    alone = hierarchy.judge(results, {})[0]
    assert found.deciding.value == alone.deciding.value


def test_a_flat_agent_of_shorter_training_is_rated_over_as_many_episodes(make_results):
    results = make_results({0: like([0.0, 0.2, 0.4, 0.9, 1.0, 1.0]), 1: like([0.0, *[0.95] * 5])})
    shorter = make_results({0: [[0.0, 0.6, 0.9]] * 8})
    (found,) = hierarchy.judge(results, {"TD3": shorter})
    assert set(found.rivals.values()) == {"TD3"}
    untrained = shorter[shorter["period"] == 0]
    (found,) = hierarchy.judge(results, {"TD3": untrained})
    assert set(found.rivals.values()) == {"DDPG+HER"}


def test_a_seed_without_a_pair_changes_nothing(make_results):
    results = make_results({0: like(SLOW), 1: like(FAST)})
    (before,) = hierarchy.judge(results, {})
    extra = results[(results["seed"] == 0) & (results["subgoal_layers"] == 0)]
    early = extra[extra["period"] <= 1].assign(seed=99)
    (after,) = hierarchy.judge(pd.concat([results, early]), {})
    assert after.evidence == before.evidence and after.sentence == before.sentence


def test_the_end_is_compared_after_as_many_episodes(make_results):
    curve = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]
    results = make_results({0: [curve] * 8, 1: [curve[:4]] * 8})
    (found,) = hierarchy.judge(results, {})
    assert found.evidence[-1].value == 0 and "last 3" in found.evidence[-1].quantity
    longer = pd.concat([results, results[results["seed"] == 0].assign(seed=8, success_rate=1.0)])
    assert hierarchy.judge(longer, {})[0].rising


def test_agents_that_are_equally_good_need_no_number_of_seeds(make_results):
    gains = [0.2, -0.2] * 5
    assert hierarchy.seeds_needed(np.array(gains) + 2e-17, np.zeros(10)) is None
    flat, deep = [[0, 0.5, 0.5, 0.5]] * 10, [[0, *[0.5 + gain] * 3] for gain in gains]
    (found,) = hierarchy.judge(make_results({0: flat, 1: deep}), {})
    assert found.says == UNDECIDED and "no number of seeds would decide it" in found.sentence


def test_what_is_undecided_says_how_many_seeds_would_tell(make_results):
    gains = np.array([-0.2, 0.3, -0.1, 0.25, 0.0, 0.2])
    flat = [[0, 0.5, 0.5, 0.5]] * 6
    deep = [[0, *[0.5 + gain] * 3] for gain in gains]
    (found,) = hierarchy.judge(make_results({0: flat, 1: deep}), {})
    assert found.says == UNDECIDED and found.seeds_needed is not None
    # By hand: (1.96 + 0.84)^2 (spread / mean)^2.
    by_hand = (2.8016 * gains.std(ddof=1) / gains.mean()) ** 2
    assert found.seeds_needed == int(np.ceil(by_hand))
    assert f"about {found.seeds_needed} seeds" in found.sentence


@pytest.mark.parametrize(("hierarchies", "least"), [((1,), 6), ((1, 2), 7)])
def test_fewer_seeds_decide_nothing_however_large_the_gain(make_results, hierarchies, least):
    def judged(seeds):
        curves = {0: SLOW, **dict.fromkeys(hierarchies, FAST)}
        return hierarchy.judge(make_results({k: [c] * seeds for k, c in curves.items()}), {})

    assert hierarchy.least_seeds(len(hierarchies)) == least
    assert {found.says for found in judged(least)} == {HELPS}
    for found in judged(least - 1):
        assert found.says == UNDECIDED
        assert f"{least} seeds" in found.sentence


def test_so_many_seeds_find_the_gain_as_often_as_is_said():
    random = np.random.default_rng(0)
    new, old = random.normal(0.05, 0.1, 12), np.zeros(12)
    needed = hierarchy.seeds_needed(new, old)
    mean, spread = new.mean(), new.std(ddof=1)
    drawn = random.normal(mean, spread, (4000, needed))
    t = drawn.mean(1) / (drawn.std(1, ddof=1) / np.sqrt(needed))
    assert 0.72 < (abs(t) > 1.96).mean() < 0.88


def test_the_command_prints_sentences_and_all_that_was_measured(make_run, capsys, tmp_path):
    folder = make_run({0: like(SLOW), 1: like(FAST)})
    assert verdict.main(["", str(folder)]) == 0
    printed = capsys.readouterr().out
    assert "- 1 subgoal layer: it helps at equal environment steps (a gain: +" in printed
    assert printed.count("| 1 against 0 |") == 10
    folder.rename(tmp_path / "ours")
    other = make_run({0: like(FAST), 1: like(FAST)})
    assert verdict.main(["", str(tmp_path / "ours"), f"--flat={other}"]) == 0
    assert f"1 against 0 ({other})" in capsys.readouterr().out


def test_what_cannot_be_compared_is_said_in_a_line(make_run, capsys, tmp_path):
    folder = make_run({1: like(FAST), 2: like(FAST)})
    assert verdict.main(["", str(folder)]) == 2
    assert "train an agent without subgoal layers" in capsys.readouterr().err
    folder.rename(tmp_path / "deep")
    flat = make_run({0: like(FAST)})
    assert verdict.main(["", str(flat)]) == 2
    assert "train agents with subgoal layers" in capsys.readouterr().err
    other = make_run({0: like(FAST)}, task="ur5_reacher")
    assert verdict.main(["", str(tmp_path / "deep"), f"--flat={other}"]) == 2
    assert "holds results of ur5_reacher, not of" in capsys.readouterr().err
    assert verdict.main(["", str(tmp_path / "none")]) == 2


def test_a_results_file_is_as_good_as_its_folder(make_run, tmp_path):
    folder = make_run({0: like(SLOW), 1: like(FAST)})
    described = json.dumps({"config": {"updates_per_episode": 20, "upper_updates_per_episode": 5}})
    (folder / "manifest.json").write_text(described)
    by_folder, by_file = verdict.judge(folder, []), verdict.judge(folder / "results.csv", [])
    assert hierarchy.rows(by_folder) == hierarchy.rows(by_file)
    (folder / "manifest.json").write_text('{"config": null}')
    assert verdict._name(folder) == str(folder)
    with pytest.raises(ValueError, match="holds no agent without subgoal layers"):
        verdict.judge(folder.rename(tmp_path / "ours"), [make_run({1: like(FAST)})])


@pytest.mark.parametrize(("last", "rising"), [(0.4, True), (0.22, False)])
def test_success_that_was_still_rising_is_said(make_results, last, rising):
    results = make_results({0: [[0.0, 0.2, last]] * 6, 1: [[0.0, 0.9, 0.9]] * 6})
    (found,) = hierarchy.judge(results, {})
    assert ("still rising at the end" in found.sentence) == rising
    assert found.evidence[-1].quantity.endswith("over the last 2 test periods")


def test_a_weak_agent_that_ended_early_has_no_say_in_who_is_the_strongest(make_results):
    early = make_results({0: like([0.0, 0.6, 0.6, 0.6, 0.6, 0.6]), 1: like([0.0, *[0.5] * 5])})
    late = make_results({0: like([0.0, 0.3, 0.9, 0.9, 0.9, 0.9])})
    weak = make_results({0: like([0.0, 0.1])})
    (alone,) = hierarchy.judge(early, {"late": late})
    (beside,) = hierarchy.judge(early, {"late": late, "weak": weak})
    assert set(alone.rivals.values()) == {"late"}
    assert beside.evidence == alone.evidence


@pytest.mark.parametrize("seeds", [slice(0, 2), slice(8, 16)])
def test_an_agent_of_too_few_common_seeds_is_no_rival(make_results, seeds):
    results = make_results({0: like(SLOW), 1: like(FAST)})
    lucky = make_results({0: like([0.0, 1.0, 1.0, 1.0], 16)})
    lucky = lucky[lucky["seed"].isin(range(16)[seeds])]
    (found,) = hierarchy.judge(results, {"lucky": lucky})
    assert set(found.rivals.values()) == {"DDPG+HER"} and found.says == HELPS


def test_a_seed_whose_time_is_unknown_is_left_out_of_both_agents(make_results):
    results = make_results({0: like(SLOW), 1: like(FAST)})
    unknown = (results["subgoal_layers"] == 1) & (results["seed"] == 3)
    results["core_seconds"] = results["wall_seconds"] / 8
    results.loc[unknown, ["core_seconds", "wall_seconds"]] = np.nan
    (found,) = hierarchy.judge(results, {})
    assert found.deciding.seeds == (8,) and found.minutes.seeds == (7,)


def test_an_agent_that_was_hardly_tested_is_not_judged(make_results):
    flat, deep = like([0.0, 0.2, 0.3]), like([0.0, 0.5, 0.6])
    (found,) = hierarchy.judge(make_results({0: flat, 1: deep}), {})
    assert found.says == UNDECIDED and found.deciding.p_holm < 0.05
    assert "an agent was tested fewer than 3 times" in found.sentence
    assert "seeds of each agent would decide" not in found.sentence
    certain = make_results({0: [[0.0, 0.0, 0.1]] * 8, 1: like([0.0, 0.9, 0.9])})
    assert hierarchy.judge(certain, {})[0].says == HELPS


def test_a_sure_loss_of_less_than_five_points_is_small(make_results):
    flat, deep = like([0.0, 0.5, 0.8, 0.95]), like([0.0, 0.49, 0.78, 0.93])
    (found,) = hierarchy.judge(make_results({0: flat, 1: deep}), {})
    assert found.deciding.high < 0 and found.deciding.p_holm < 0.05
    assert found.says == SMALL


def test_success_is_compared_when_the_budget_is_spent(make_results):
    results = make_results({0: [[0.0, 0.5, 0.9]] * 6, 1: [[0.0, 0.2, 0.4, 0.6, 0.8]] * 6})
    (found,) = hierarchy.judge(results, {})
    at_end = {item.quantity: item.value for item in found.evidence}
    # Two levels make as many updates in half the episodes: at 0.2 against 0.9.
    assert at_end["difference in success at equal updates"] == pytest.approx(-0.7)
    ((_, steps, _, updates, _),) = hierarchy.ends([found])
    assert updates == "-70.0 [-70.0, -70.0] at 25%" and steps.endswith(" at 50%")


def test_a_star_marks_what_no_path_between_the_tests_can_turn(make_results):
    flat = [[0.0, 0.4, 0.4, 0.4, 0.4]] * 6
    for level, certain in ((0.9, True), (0.5, False)):
        deep = [[0.0, level, level, level, level]] * 6
        (found,) = hierarchy.judge(make_results({0: flat, 1: deep}), {})
        ((_, steps, *_),) = hierarchy.costs([found])
        assert ("*" in steps) == certain and found.deciding.value > 0


def test_what_was_cut_is_said(make_results):
    results = make_results({0: like(SLOW), 1: like(FAST)})
    stopped = (results["subgoal_layers"] == 0) & (results["seed"] == 0) & (results["period"] > 2)
    (found,) = hierarchy.judge(results[~stopped], {})
    assert "Areas end after 600 of 900 episodes, where a seed ended." in found.sentence


def test_where_no_agent_learns_nothing_is_judged(make_results):
    flat, deep = like([0.08, 0.08, 0.08, 0.08, 0.08]), like([0.08, 0.08, 0.09, 0.1, 0.1])
    (found,) = hierarchy.judge(make_results({0: flat, 1: deep}), {})
    assert found.says == UNDECIDED and "nothing to compare" in found.sentence
    assert "seeds of each agent would" not in found.sentence


def test_an_agent_whose_first_test_comes_after_the_others_training_is_not_judged(make_results):
    results = make_results({0: [[0.1] * 4] * 6, 1: like(FAST)})
    later = 1000 * (results["subgoal_layers"] == 1)
    results["core_seconds"] = 10.0 * results["period"] + later
    (found,) = hierarchy.judge(results, {})
    assert found.minutes.verdict == UNDECIDED
