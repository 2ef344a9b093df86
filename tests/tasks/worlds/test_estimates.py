"""Estimated spaces: against those that were made by hand, and against what is known of toys."""

import dataclasses

import numpy as np
import pytest

import hac_suite
import tasks
from tasks.worlds import cautions, estimates, fitted
from tasks.worlds.copies import Options
from tasks.worlds.estimates import Played
from tasks.worlds.world import World
from tests.tasks.worlds import toys


@pytest.fixture(scope="module", params=tasks.ALL)
def own(request):
    """A task of ours: its spec, and what is estimated for it."""
    task = tasks.unfitted(request.param)
    played = estimates.random_episodes(task.env_of, task.about)
    return task, played, estimates.settings(task.about, played)


def test_scales_are_those_made_by_hand_within_a_factor(own):
    task, _, settings = own
    found = np.abs(settings.observation_offset) + settings.observation_scale
    ratio = found / task.own.observation_scale
    assert (ratio > 1 / 4).all() and (ratio < 4).all()
    assert not [w for w in cautions.warnings(task.about, own[1], own[1], settings, task.own)
                if "times off" in w]  # fmt: skip


def test_bounds_are_those_made_by_hand_by_and_large(own):
    task, _, settings = own
    for name in ("goal", "subgoal"):
        space = getattr(task.own, f"{name}_space")
        low, high = (np.array(getattr(settings, f"{name}_{end}")) for end in ("low", "high"))
        common = np.minimum(high, space.high) - np.maximum(low, space.low)
        assert (common > 0.4 * (space.high - space.low)).all()
        assert (common > 0.55 * (high - low)).all()


def test_thresholds_are_those_made_by_hand(own):
    task, _, settings = own
    np.testing.assert_allclose(settings.goal_threshold, task.own.goal_space.threshold, rtol=1e-3)
    ratio = np.array(settings.subgoal_threshold) / task.own.subgoal_space.threshold
    assert (ratio > 0.25).all() and (ratio < 2).all()


def test_T_is_that_made_by_hand_by_and_large(own):
    task, _, settings = own
    assert settings.max_steps == task.own.max_steps
    for layers, attempts in settings.horizons.items():
        chosen = hac_suite.horizons(task.own.max_steps, layers, task.own.horizons)
        assert len(attempts) == layers + 1 and np.prod(attempts) >= task.own.max_steps
        assert np.prod(attempts) <= 1.5 * task.own.max_steps
        assert chosen[0] / 3 <= attempts[0] <= 3 * chosen[0]


# -- On episodes of which everything is known


def walk(observation, *, asked=((0.0,),), success=False, failed=False) -> Played:
    """Episodes [T + 1, E] of one number that is observation, goal and subgoal."""
    seen_ = np.array(observation, float)[..., None]
    episodes = np.zeros(seen_.shape[1], bool)
    return Played(
        seen_, seen_, seen_, np.array(asked), np.full(len(episodes), len(seen_) - 1),
        episodes | success, episodes, episodes | failed, episodes, episodes,
    )  # fmt: skip


def about(**changes) -> estimates.About:
    usual = estimates.About(
        title="a", max_steps=100, control_timestep=0.1, action_low=np.array([-1.0]),
        action_high=np.array([1.0]), goal_names=("x",), subgoal_names=("x",),
        judge=lambda a, g: (np.abs(a - g) <= 0.25).all(-1),
    )  # fmt: skip
    return usual._replace(**changes)


RAMP = np.linspace(0.0, 10.0, 101)  # 0.1 a step


def test_numbers_about_zero_stay_there_and_others_are_centred():
    rng = np.random.default_rng(0)
    columns = rng.uniform([-1, 0, 99, 7, -1e-6], [1.1, 20, 101, 7, 1e-6], (4000, 5))
    offset, scale = estimates.scales(columns)
    np.testing.assert_allclose(offset, [0, 10, 100, 7, 0], rtol=0.02)
    np.testing.assert_allclose(scale, [1.2, 11, 1.1, 1, 1e-3], rtol=0.05)  # the fourth stands still
    columns[:3, 3] = 9.0  # but for a touch
    offset, scale = estimates.scales(columns)
    assert (offset[3], scale[3]) == (7, 0.2)


def test_an_observed_goal_is_scaled_for_where_goals_are():
    played = walk(np.stack([0.01 * RAMP] * 2, axis=1), asked=[[0.0], [4.0]])
    settings = estimates.settings(about(), played)
    high = settings.observation_offset[0] + settings.observation_scale[0]
    assert 4.0 < high < 4.5
    still = walk(np.stack([5 + 1e-3 * RAMP] * 2, axis=1), asked=[[5.0], [5.1]])
    settings = estimates.settings(about(), still)
    assert settings.observation_scale[0] == pytest.approx(0.25)  # the goal's threshold


def test_subgoals_may_lie_where_end_goals_do_in_the_dimensions_that_they_share():
    hand = np.stack([RAMP[::-1]] * 2, axis=1)
    played = walk(np.stack([0.01 * RAMP] * 2, axis=1), asked=[[0.0], [4.0]])
    both = np.stack([hand, played.achieved_goal[..., 0]], axis=-1)
    played = played._replace(achieved_subgoal=both)
    settings = estimates.settings(about(subgoal_names=("hand", "x")), played)
    assert 10.5 < settings.subgoal_high[0] < 11.5 and 4.0 < settings.subgoal_high[1] < 4.5


def test_bounds_are_finite_and_have_width_whatever_was_seen():
    low, high = estimates.bounds(np.full((50, 1), 3.0), np.array([[5.0]]))
    assert low[0] < 3 and high[0] > 5 and high[0] - low[0] < 3
    low, high = estimates.bounds(np.zeros((50, 1)))
    assert low[0] < 0 < high[0] < 0.1
    low, high = estimates.bounds(4.5e6 + np.linspace(0.0, 10.0, 50)[:, None])
    assert 11 < high[0] - low[0] < 13  # however far from zero


def test_how_far_steps_carry():
    played = walk(np.stack([RAMP, RAMP, RAMP, np.zeros(101)], axis=1))
    np.testing.assert_allclose(estimates.carried(played, 10, 0.75), 1.0)
    cut = played._replace(steps=np.array([5, 5, 5, 5]))
    np.testing.assert_allclose(estimates.carried(cut, 10, 0.75), 0.0)


def test_a_longer_first_level_where_equal_ones_go_nowhere():
    slow, quick = (walk(np.stack([RAMP * speed] * 2, axis=1)) for speed in (0.02, 1.0))
    width = np.array([10.0])
    assert estimates.attempts(quick, 100, 1, width) == (10, 10)
    first, second = estimates.attempts(slow, 100, 1, width)
    assert first > 20 and first * second >= 100
    assert estimates.attempts(quick, 300, 2, width) == (7, 7, 7)


def test_subgoal_thresholds_are_neither_met_by_standing_still_nor_jumped_over():
    played, unknown = walk(np.stack([RAMP] * 2, axis=1)), np.array([np.nan])
    width = np.array([10.0])
    (near,) = estimates.subgoal_threshold(played, 10, width, unknown)
    assert near == pytest.approx(0.25)  # at least a fortieth of the space
    (near,) = estimates.subgoal_threshold(played, 10, width, np.array([3.0]))
    assert near == pytest.approx(0.5)  # the goal's is met by standing still
    (near,) = estimates.subgoal_threshold(played, 10, width, np.array([0.001]))
    assert near == pytest.approx(0.05)  # half a step
    flat = np.stack([RAMP, 0.02 + 1e-4 * RAMP], axis=1)  # a block that is pushed on a table
    both = played._replace(achieved_subgoal=np.stack([flat] * 2, axis=1))
    goals = np.array([0.05, 0.05])
    near = estimates.subgoal_threshold(both, 10, np.array([10.0, 0.003]), goals)
    np.testing.assert_allclose(near, 0.05)  # its height does not matter


def test_the_goals_threshold_is_found_by_asking_the_judge():
    played = walk(np.stack([RAMP] * 2, axis=1), asked=[[1.0], [9.0]])
    settings = estimates.settings(about(), played)
    assert settings.goal_threshold == (0.25,)
    assert settings.goal_low[0] <= 1.0 and settings.goal_high[0] >= 9.0
    one = estimates.settings(about(), walk(np.stack([RAMP] * 2, axis=1), asked=[[1.0], [1.1]]))
    assert one.goal_threshold == (0.25,)  # which is wider than where goals are
    above = about(judge=lambda a, g: (a >= g - 0.25).all(-1))
    assert estimates.settings(above, played).goal_threshold == (0.25,)  # the nearer way


# -- Warnings


def warned(random: Played, about_=None, everything=None) -> str:
    about_ = about_ or about()
    everything = everything or random
    settings = estimates.settings(about_, everything)
    return "\n".join(cautions.warnings(about_, random, everything, settings, None))


def test_nothing_is_said_of_a_task_that_can_be_learnt():
    played = walk(np.stack([RAMP, RAMP[::-1]] * 2, axis=1), asked=[[1.0], [5.0], [9.0]])
    assert warned(played) == ""


@pytest.mark.parametrize(
    ("played", "said"),
    [
        (walk(np.stack([RAMP] * 2, axis=1), asked=[[50.0], [90.0]]),
         "hindsight teaches nothing"),
        (walk(np.stack([RAMP] * 2, axis=1), asked=[[0.0], [90.0]]),
         r"end goals range from"),
        (walk(np.stack([RAMP] * 2, axis=1), success=True), "100% of random episodes succeed"),
        (walk(np.stack([RAMP] * 2, axis=1), failed=True), "end in failure, after 100 steps"),
        (walk(np.stack([RAMP] * 2, axis=1))._replace(held=np.array([True, False])),
         "50% of episodes begin at their goal"),
        (walk(np.stack([RAMP] * 2, axis=1))._replace(
            cut=np.array([True, False]), steps=np.array([40, 100])), "50% of episodes diverge"),
        (walk(np.stack([np.full(101, 5.0)] * 2 + [RAMP], axis=1)), "did not change in 67%"),
    ],
)  # fmt: skip
def test_what_will_not_learn_is_said(played, said):
    assert said in warned(played)


def test_a_scale_ten_times_off_is_said():
    task = tasks.unfitted("pendulum_climb")
    played = estimates.random_episodes(task.env_of, task.about, episodes=8)
    settings = estimates.settings(task.about, played)
    wrong = fitted.of_task(
        tasks.find("pendulum_climb"),
        settings,
        name="a",
        word="a",
    ).spec
    parts = {**wrong.observation, "angular_velocity": (0.01,)}
    bad = tasks.TaskSpec(
        title="a", control_timestep=0.1, max_steps=300, goal_space=wrong.goal_space,
        subgoal_space=wrong.subgoal_space, observation=parts, action_bounds=wrong.action_bounds,
    )  # fmt: skip
    lines = list(cautions.warnings(task.about, played, played, settings, bad))
    assert any("angular_velocity is divided by 0.01" in line for line in lines), lines


def test_an_offset_of_the_tasks_own_is_reckoned_with():
    task = tasks.unfitted("pendulum_climb")
    played = estimates.random_episodes(task.env_of, task.about, episodes=8)
    far = played._replace(observation=played.observation + [0.0, 0.0, 500.0])
    settings = estimates.settings(task.about, far)

    def lines(offset):
        own = dataclasses.replace(task.own, offset=offset)
        said = cautions.warnings(task.about, far, far, settings, own)
        return [line for line in said if "is divided by" in line]

    assert lines((0.0, 0.0, 500.0)) == []
    for wrong in ((), (0.0, 0.0, 5.0)):
        (line,) = lines(wrong)
        assert "angular_velocity is divided by 10, but episodes suggest 5" in line


def test_a_toy_that_is_easy_and_one_that_fails():
    def lines(**habits):
        world = World("toy", lambda: toys.Point(**habits), Options(), max_steps=40)
        played = estimates.random_episodes(world.adapter, world.about())
        settings = estimates.settings(world.about(), played)
        return "\n".join(cautions.warnings(world.about(), played, played, settings, None))

    assert "end in failure" in lines(fails_above=0.5)
    assert "end in failure" not in lines()


def test_episodes_of_different_lengths_are_joined():
    world = World("toy", lambda: toys.Point(truncates_at=11), Options(), max_steps=40)
    adapter = world.adapter(2)
    about = world.about()._replace(max_steps=40)
    act = estimates.random_actions(about, 2, 0)
    adapter.max_steps = 20
    long = estimates.play(adapter, about.judge, act, np.arange(2), test=False)
    adapter.max_steps = 12
    short = estimates.play(adapter, about.judge, act, np.arange(2), test=True)
    both = estimates.joined([long, short])
    assert both.observation.shape[:2] == (21, 4) and both.test.tolist() == [False] * 2 + [True] * 2
    np.testing.assert_array_equal(both.alive()[:13, 2:], short.alive())
    assert not both.alive()[13:, 2:].any()
    for field in ("observation", "achieved_goal", "achieved_subgoal"):
        own = getattr(both, field)
        np.testing.assert_array_equal(own[:13, 2:], getattr(short, field))
        np.testing.assert_array_equal(own[:, :2], getattr(long, field))
