"""Others' environments in our engine: goals and episodes, every habit in a toy of its own."""

import random

import gymnasium
import mujoco
import numpy as np
import pytest

import hac_suite
import tasks
from hac_suite.algorithm import exploration, transitions
from hac_suite.types import level_specs
from tasks.worlds import copies
from tests.tasks.worlds import toys
from tests.tasks.worlds.playing import SEEDS, played, towards_goal, world

# -- Goals


def test_the_environment_judges_by_its_own_shape_and_not_by_our_box():
    env = world()
    inside, corner = np.array([[0.09, 0.0]]), np.array([[0.09, 0.09]])
    goal = np.zeros((1, 2))
    assert env.goal_space.achieved(inside, goal).tolist() == [True]
    assert env.goal_space.achieved(corner, goal).tolist() == [False]
    np.testing.assert_allclose(env.goal_space.threshold, toys.RADIUS, rtol=1e-3)
    box = (np.abs(corner - goal) <= env.goal_space.threshold).all()
    assert box  # which is the difference
    many = np.zeros((3, 4, 2))
    assert env.goal_space.achieved(many, many).shape == (3, 4)
    many[0, 0] = np.nan
    assert env.goal_space.achieved(many, many).sum() == 11


@pytest.mark.parametrize("terminates", [False, True])
def test_an_episode_ends_at_the_goal_whether_the_environment_ends_it_or_not(terminates):
    env = world(terminates=terminates)
    views = []
    run = played(env, towards_goal(env), test=True, on_step=views.append)
    assert run.success.all() and not run.diverged.any()
    assert len(set(run.steps)) > 1 and run.steps.max() < 30
    for i in range(6):
        at = views[run.steps[i]].env_step
        before = views[run.steps[i] - 1].env_step
        far = [np.linalg.norm(s.achieved_goal[i] - s.desired_goal[i]) for s in (before, at)]
        assert far[0] > toys.RADIUS >= far[1]


def test_an_end_goal_that_moves_is_pursued_and_judged_where_it_is():
    env = world(goal_speed=0.01, with_test_options={"goal": [0.1, -0.2]})
    views = []
    run = played(env, towards_goal(env), test=True, on_step=views.append)
    assert run.success.all()
    start, end = views[0].env_step, views[run.steps[0]].env_step
    np.testing.assert_allclose(end.desired_goal[0], start.desired_goal[0] + 0.01 * run.steps[0])
    assert np.linalg.norm(end.achieved_goal[0] - end.desired_goal[0]) <= toys.RADIUS


def test_an_end_goal_can_be_moved_where_the_environment_keeps_it_in_goal(monkeypatch):
    env = world()
    env.reset(SEEDS[: env.num_envs])
    wanted = np.array([0.3, -0.4])
    seen = env.move_goal(1, wanted)
    np.testing.assert_array_equal(seen.desired_goal[1], wanted)
    assert not np.array_equal(seen.desired_goal[0], wanted)
    seen = env.step(np.zeros((env.num_envs, 2)))
    np.testing.assert_array_equal(seen.desired_goal[1], wanted)
    assert env.simulation(0) is None  # MuJoCo has no part in it
    for copy in env._env._copies:
        monkeypatch.setattr(copy.env.unwrapped, "goal", "north")
    with pytest.raises(ValueError, match="it does not store its goal in an array"):
        env.move_goal(0, wanted)


def test_an_episode_that_has_ended_goes_on_to_a_goal_that_is_moved():
    env = world(1, terminates=True, truncates_at=20)
    (act,) = towards_goal(env)
    state = env.reset(SEEDS[:1])
    while not env.goal_space.achieved(state.achieved_goal, state.desired_goal)[0]:
        state = env.step(act(state.observation, state.desired_goal))
    for _ in range(25):  # the environment's own limit is passed as well
        state = env.step(act(state.observation, state.desired_goal))
    there = state.achieved_goal[0]
    wanted = np.where(there > 0, there - 0.5, there + 0.5)
    state = env.move_goal(0, wanted)
    for _ in range(15):
        state = env.step(act(state.observation, state.desired_goal))
    assert env.goal_space.achieved(state.achieved_goal, wanted[None]).all()
    assert not state.diverged[0] and not state.failed[0]


@pytest.mark.parametrize(
    ("reward", "problem"),
    [
        ("dense", "gives [0-9]+ different rewards.*reward_type.*--goal_threshold"),
        ("info", "compute_reward.*KeyError.*an empty info.*--goal_threshold"),
        ("always", "is 0.0 for all of 384 pairs.*--goal_threshold"),
    ],
)
def test_a_reward_that_does_not_say_what_is_achieved_is_refused(reward, problem):
    with pytest.raises(ValueError, match=problem):
        world(reward=reward)
    boxed = world(reward=reward, with_goal_threshold=0.2)
    apart = np.array([[0.19, -0.19], [0.21, 0.0]])
    assert boxed.goal_space.achieved(apart, np.zeros((2, 2))).tolist() == [True, False]


@pytest.mark.parametrize("reward", ["scalar", "column"])
def test_a_reward_of_another_form_judges_alike(reward):
    env, batched = world(reward=reward), world()
    near = np.random.default_rng(0).uniform(-0.1, 0.1, (50, 2))
    judged = env.goal_space.achieved(near, np.zeros_like(near))
    np.testing.assert_array_equal(judged, batched.goal_space.achieved(near, np.zeros_like(near)))
    assert 0 < judged.sum() < 50


def test_goals_of_whole_numbers_are_achieved_by_the_nearest_one():
    env = tasks.from_gymnasium(toys.Cells, 2, max_steps=20)
    goal = np.array([[3.0, 4.0]])
    cells = goal + np.array([[0.4, -0.4], [0.6, 0.0], [0.0, -0.6]])
    assert env.goal_space.achieved(cells, goal).tolist() == [True, False, False]
    np.testing.assert_allclose(env.goal_space.threshold, 0.5, rtol=1e-3)
    np.testing.assert_allclose(env.subgoal_space.threshold, 0.5, rtol=0.1)


# -- Episodes


def test_a_seed_decides_an_episode():
    env, other = world(), world(2)
    first, again = env.reset(SEEDS), other.reset(SEEDS[[3, 3]])
    assert len(np.unique(first.desired_goal, axis=0)) == 6
    for name in ("observation", "desired_goal"):
        np.testing.assert_array_equal(getattr(again, name), getattr(first, name)[[3, 3]])


def test_an_environment_that_draws_from_the_global_generators_is_seeded_and_said_so():
    env = world(draws="global")
    assert "global random generators" in env.notes[0]
    np.random.seed(7)
    random.seed(7)
    before = np.random.get_state()[1].copy(), random.getstate()
    actions = np.full((6, 2), 0.5)
    runs = [
        [env.reset(SEEDS).observation, *(env.step(actions).observation for _ in range(4))]
        for _ in range(2)
    ]
    np.testing.assert_array_equal(*runs)
    assert (runs[0][0][0] != runs[0][0][1]).any()
    np.testing.assert_array_equal(np.random.get_state()[1], before[0])
    assert random.getstate() == before[1]


def test_what_no_seed_determines_is_refused():
    with pytest.raises(ValueError, match=r"does not determine the start and goal.*np_random"):
        world(draws="system")


def test_copies_that_are_not_independent_are_refused():
    with pytest.raises(ValueError, match=r"Shared: copies of it are not independent.*instance"):
        tasks.from_gymnasium(toys.Shared, max_steps=20)


def test_what_is_left_of_another_episode_is_not_taken_for_a_global_generator():
    with pytest.raises(ValueError, match=r"does not determine .*reset all that the last episode"):
        tasks.from_gymnasium(toys.Remembers, max_steps=20)


def test_an_environment_without_a_time_limit_asks_for_one():
    with pytest.raises(ValueError, match=r"no time limit.*--max_steps"):
        tasks.from_gymnasium(toys.Point)
    assert world(steps=12).max_steps == 12
    limited = tasks.from_gymnasium(lambda: gymnasium.wrappers.TimeLimit(toys.Point(), 9))
    assert limited.max_steps == 9


def test_a_time_limit_within_the_environment_is_found():
    assert world(truncates_at=11).max_steps == 11
    assert world(truncates_at=11, speed=0.8, fails_above=0.9).max_steps == 11  # some end before


def test_failing_ends_the_episode_and_is_learnt_from():
    env = world(fails_above=0.5, start=(0.0, 0.0), speed=1.0)
    right = [lambda observation, goal: np.tile([1.0, 0.0], (len(observation), 1))]
    config = hac_suite.Config(episodes_per_period=6, episodes_per_round=6, action_noise=0.0,
                              random_action_rate=0.0)  # fmt: skip
    draws = exploration.draw_round([np.random.default_rng(0)], level_specs(env, (30,)), config, 30)
    run = played(env, right, config=config, draws=draws)
    failed = ~run.success
    assert failed.any() and not run.diverged.any() and (run.steps[failed] < 5).all()
    (level,) = transitions.build(
        run, config, (30,), draws.hindsight, env.goal_space, env.subgoal_space
    )
    last = (level.next_observation[:, 0] > 0.5) & np.isin(level.env, np.flatnonzero(failed))
    assert last.sum() >= failed.sum()
    assert (level.reward[last] == -30).all() and (level.discount[last] == 0).all()
    alive = (level.next_observation[:, 0] <= 0.5) & (level.discount > 0)
    assert alive.any() and (level.reward[alive] == -1).all()


def test_what_ends_at_the_goal_is_no_failure():
    env = world(terminates=True)
    run = played(env, towards_goal(env), test=True)
    assert run.success.all()
    assert not env.step(np.zeros((6, 2))).failed.any()


def test_numbers_that_are_not_finite_are_a_divergence_and_keep_the_last_that_were():
    env = world(nan_at=3)
    env.reset(SEEDS)
    before = [env.step(np.full((6, 2), 0.1)) for _ in range(2)][-1]
    after = env.step(np.full((6, 2), 0.1))
    assert after.diverged.all() and not after.failed.any()
    np.testing.assert_array_equal(after.observation, before.observation)
    assert not env.reset(SEEDS).diverged.any()


def test_a_simulation_that_mujoco_begins_anew_has_diverged():
    class Blown(toys.Point):
        """Its physics blows up in the fourth step; MuJoCo then resets it and goes on."""

        def __init__(self):
            super().__init__()
            xml = (
                "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"
            )
            self.model = mujoco.MjModel.from_xml_string(xml)
            self.data = mujoco.MjData(self.model)

        def reset(self, **options):
            mujoco.mj_resetData(self.model, self.data)
            return super().reset(**options)

        def step(self, action):
            if self.steps == 3 and self.np_random.bit_generator.seed_seq.entropy == 5:
                self.data.qvel[0] = np.inf
            mujoco.mj_step(self.model, self.data)
            return super().step(action)

    env = tasks.from_gymnasium(Blown, 2, max_steps=9)
    env.reset(np.array([4, 5]))
    steps = [env.step(np.zeros((2, 2))) for _ in range(4)]
    assert [step.diverged.tolist() for step in steps[2:]] == [[False, False], [False, True]]
    assert np.isfinite(steps[-1].observation).all()
    assert not env.reset(np.array([4, 6])).diverged.any()


def test_options_of_resets_make_the_test_starts():
    env = world(with_test_options={"goal": [0.25, 0.5]})
    np.testing.assert_array_equal(env.reset(SEEDS, test=True).desired_goal, [[0.25, 0.5]] * 6)
    assert len(np.unique(env.reset(SEEDS).desired_goal, axis=0)) == 6
    both = world(with_train_options={"goal": [0.0, 0.0]})
    np.testing.assert_array_equal(both.reset(SEEDS).desired_goal, np.zeros((6, 2)))


def test_only_masked_environments_are_reset_and_stepped():
    env = world()
    env.reset(SEEDS)
    mask = np.arange(6) < 2
    stepped = env.step(np.full((6, 2), 2.0), mask)
    moved = (stepped.achieved_goal != env.reset(SEEDS, mask=~mask).achieved_goal).any(axis=1)
    assert not moved.any()  # those not stepped are where they begin
    again = env.reset(SEEDS)
    assert (again.achieved_goal[mask] != stepped.achieved_goal[mask]).any()


def test_closing_one_leaves_another_that_shares_its_copies_in_play():
    class Closes(toys.Point):
        """Like MuJoCo's environments, it does not work once it is closed."""

        closed = False

        def close(self):
            self.closed = True

        def step(self, action):
            assert not self.closed
            return super().step(action)

    env = tasks.from_gymnasium(Closes, 4, max_steps=30)
    test, more = env.copies(4), env.copies(6)
    started = env.reset(np.arange(4))
    test.close()
    more.close()
    stepped = env.step(np.ones((4, 2)))
    assert (stepped.achieved_goal != started.achieved_goal).all()
    env.close()
    again = env.reset(np.arange(4))  # in copies made anew
    np.testing.assert_array_equal(again.observation, started.observation)
    np.testing.assert_array_equal(env.step(np.ones((4, 2))).observation, stepped.observation)


def test_a_bad_action_and_an_error_in_the_environment_are_named():
    env = world()
    env.reset(SEEDS)
    bad = np.zeros((6, 2))
    bad[4, 1] = np.nan
    with pytest.raises(ValueError, match="environment 4: actions must be finite"):
        env.step(bad)

    class Broken(toys.Point):
        def step(self, action):
            if self.steps == 8:
                raise KeyError("battery")
            return super().step(action)

    broken = tasks.from_gymnasium(Broken, 2, max_steps=8)
    broken.reset(SEEDS[:2])
    for _ in range(8):
        broken.step(np.zeros((2, 2)))
    with pytest.raises(
        copies.EnvFailed, match=r"step\(\) \(.*test_world.py, line \d+\) failed: KeyError"
    ):
        broken.step(np.zeros((2, 2)))
