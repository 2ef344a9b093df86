"""Others' environments in our engine: observations, actions, copies, pictures and training."""

import numpy as np
import pytest

import hac_suite
import tasks
from hac_suite.types import level_specs
from tasks.worlds import estimates
from tasks.worlds.copies import Options
from tasks.worlds.making import NoFrames
from tasks.worlds.world import World
from tests.tasks.worlds import toys
from tests.tasks.worlds.playing import SEEDS, world

# -- Observations and actions


def test_observations_of_dictionaries_and_single_precision_become_flat_and_double():
    env = tasks.from_gymnasium(toys.Nested, 3, max_steps=20)
    state = env.reset(SEEDS[:3])
    assert state.observation.shape == (3, 2 + 3 + 2)  # Discrete(3) is one of three
    assert {part.dtype for part in state[:4]} == {np.dtype(np.float64)}
    assert env.goal_space.dim == 2 and env.spec.observation_dim == 7
    np.testing.assert_array_equal(
        env.goal_space.achieved(state.desired_goal, state.desired_goal), [True] * 3
    )


def test_an_agent_is_told_where_it_is():
    blind, seeing = world(told_where=False), world()
    assert [blind.spec.observation_dim, seeing.spec.observation_dim] == [4, 4]
    state = blind.reset(SEEDS)
    np.testing.assert_array_equal(state.observation[:, 2:], state.achieved_goal)
    assert blind.spec.observation_names[2:] == ("achieved_goal[0]", "achieved_goal[1]")


def test_actions_span_the_environments_own_range():
    env = world()
    np.testing.assert_array_equal(env.action_low, [-2, -2])
    np.testing.assert_array_equal(env.action_high, [2, 2])


def test_an_environment_without_goals_takes_a_projection_of_its_state():
    kwargs = {"goal": "obs[0:1]", "goal_threshold": 0.05}
    env = tasks.from_gymnasium(toys.Plain, 6, max_steps=20, **kwargs)
    state = env.reset(SEEDS)
    assert len(np.unique(state.desired_goal)) == 6
    inside = (state.desired_goal >= env.goal_space.low) & (
        state.desired_goal <= env.goal_space.high
    )
    assert inside.all() and -2.5 < env.goal_space.low[0] < -0.8
    np.testing.assert_array_equal(state.desired_goal, env.reset(SEEDS).desired_goal)
    np.testing.assert_array_equal(state.achieved_goal, state.observation[:, :1])
    always = tasks.from_gymnasium(
        toys.Plain, 2, max_steps=20, goal="obs[0,2]=0.5,3", subgoal="obs[0]", goal_threshold=0.1
    )
    state = always.reset(SEEDS[:2])
    np.testing.assert_array_equal(state.desired_goal, [[0.5, 3.0]] * 2)
    assert always.subgoal_space.names == ("obs[0]",)
    assert always.goal_space.low[1] < 3 < always.goal_space.high[1]


def test_goals_of_an_environment_without_any_are_points_reached_whatever_the_start():
    seeds = np.arange(64)
    env = tasks.from_gymnasium(toys.Plain, 64, max_steps=20, goal="obs[0]", goal_threshold=0.01)
    state = env.reset(seeds)
    # The environment draws its start from the same seed.
    start, goal = state.achieved_goal[:, 0], state.desired_goal[:, 0]
    assert abs(np.corrcoef(start, goal)[0, 1]) < 0.3
    pendulum = tasks.from_gymnasium("Pendulum-v1", 64, goal="obs[0:2]", goal_threshold=0.1)
    goals = pendulum.reset(seeds).desired_goal  # cosine and sine of an angle
    np.testing.assert_allclose(np.linalg.norm(goals, axis=1), 1, rtol=1e-6)
    assert len(np.unique(goals, axis=0)) > 32
    np.testing.assert_array_equal(goals, pendulum.copies(64).reset(seeds).desired_goal)


def test_goals_that_nobody_judges_are_judged_by_a_threshold():
    env = tasks.from_gymnasium(
        lambda: toys.OddGoals("unjudged"), max_steps=20, goal_threshold=(0.1, 0.3)
    )
    near = np.array([[0.09, 0.29], [0.0, 0.31]])
    assert env.goal_space.achieved(near, np.zeros((2, 2))).tolist() == [True, False]


def test_goals_that_are_not_known_yet_end_no_episode_of_which_spaces_are_estimated():
    options = Options(goal="obs[0]", threshold=(0.9,))  # it begins within 0.9 of 0
    world = World("plain", toys.Plain, options, max_steps=20)
    played = estimates.random_episodes(world.adapter, world.about())
    assert (played.steps == 20).all()
    assert 0.2 < played.held.mean() < 0.9 and played.success.mean() >= played.held.mean()


@pytest.mark.parametrize(
    ("make", "options", "problem"),
    [
        (toys.Plain, {}, r"no.*dictionary of observation.*--goal='obs\[0:2\]'"),
        (toys.Plain, {"goal": "obs[0:1]"}, "needs --goal_threshold"),
        (toys.Plain, {"goal": "obs[2:5]", "goal_threshold": 1}, "there are 3"),
        (toys.Plain, {"goal": "x", "goal_threshold": 1}, r"as in obs\[0:2\]"),
        (toys.Plain, {"goal": "obs[0:2]=1", "goal_threshold": 1},
         "2 elements are chosen, but the values are 1"),
        (toys.Point, {"goal": "obs[0:1]"}, "it has goals of its own"),
        (toys.Point, {"goal_threshold": (0.1, 0.1, 0.1)}, "give one, or 2"),
        (toys.Point, {"goal_threshold": (0.1, 0.0)}, "numbers above 0"),
        (toys.Point, {"max_steps": -3}, "max_steps is -3; it takes a count"),
        (toys.Point, {"args": {"speed": 1}}, r"args={'speed': 1} are only for an id.*partial"),
        (toys.Point(), {}, "Point: this is one environment.*give a function"),
        (lambda: toys.OddGoals("unjudged"), {}, "no compute_reward.*--goal_threshold"),
        (toys.OldApi, {}, r"its reset\(\) failed: .*no tuple.*observation, info"),
        (toys.Point, {"train_options": {"goal": "north"}},
         r"its reset\(options={'goal': 'north'}\) \(.*toys.py, line \d+\) failed: ValueError"),
        (toys.Point, {"test_options": {"goal": "north"}}, r"its reset\(.*failed: ValueError"),
        (lambda: toys.OddGoals("dict"), {}, "achieved_goal is a dictionary of place; .*Box"),
        (lambda: toys.OddGoals("less"), {}, "achieved_goal has 1 numbers, but .* declares 2"),
        (lambda: toys.OddGoals("more"), {}, r"achieved_goal has the shape \(3,\).*\(2,\)"),
        (lambda: toys.Plain(size=12_000), {"goal": "obs[0]", "goal_threshold": 1},
         "12000 numbers, as images do"),
        (lambda: toys.Plain("discrete"), {"goal": "obs[0]", "goal_threshold": 1},
         r"actions are Discrete\(3\).*discrete actions are not supported"),
        (lambda: toys.Plain("unbounded"), {"goal": "obs[0]", "goal_threshold": 1},
         "no bounds.*RescaleAction"),
    ],
)  # fmt: skip
def test_what_cannot_be_trained_on_is_refused_in_one_line(make, options, problem):
    with pytest.raises(ValueError, match=problem) as refused:
        tasks.from_gymnasium(make, **{"max_steps": 20, **options})
    assert "\n" not in str(refused.value)


# -- Copies, pictures, training


def test_training_and_tests_share_their_copies():
    toys.Point.made = 0
    env = world(4)
    training, test = env.copies(4), env.copies(10)
    assert toys.Point.made == 10
    actions = np.zeros((4, 2))
    training.reset(SEEDS[:4])
    training.step(actions)
    test.reset(np.arange(10))
    with pytest.raises(RuntimeError, match=r"the same copies.*from_gymnasium"):
        training.step(actions)
    training.reset(SEEDS[:4])
    training.step(actions)


def test_pictures_are_the_environments_own_framed():
    env = world(2, start=(0.0, 0.0))
    env.reset(SEEDS[:2])
    picture = env.render(1, width=80, height=60)
    assert picture.shape == (60, 80, 3) and picture.dtype == np.uint8
    assert not picture[:10].any() and not picture[-10:].any()  # twice as wide as high
    assert picture[30, :42].all() and not picture[30, 44:].any()
    env.show_subgoals(0, [np.zeros(2)])
    with pytest.raises(NoFrames, match="renders no frames"):
        plain = tasks.from_gymnasium(toys.Plain, 1, max_steps=5, goal="obs[0]", goal_threshold=1)
        plain.reset(SEEDS[:1])
        plain.render(0)

    class NeedsMore(toys.Plain):
        def render(self):
            raise ImportError("no module named pygame")

    needs = tasks.from_gymnasium(NeedsMore, 1, max_steps=5, goal="obs[0]", goal_threshold=1)
    needs.reset(SEEDS[:1])
    with pytest.raises(NoFrames, match=r"its render\(\) failed: ImportError: no module"):
        needs.render(0)


def test_observations_far_from_zero_are_centred():
    env = tasks.from_gymnasium(toys.Plain, 2, max_steps=30, goal="obs[0]", goal_threshold=0.1)
    state = env.reset(SEEDS[:2])
    (level,) = level_specs(env, (30,))
    assert env.observation_offset[0] == 0.0  # it lies about 0
    assert (state.observation[:, 1] == 5).all()
    np.testing.assert_allclose(level.scaled(state.observation)[:, 1], 0.0, atol=1e-9)
    steps = np.array([[0.0, 5.0, 0.0], [0.0, 5.0, 30.0]])
    np.testing.assert_allclose(level.scaled(steps)[:, 2], [-1, 1], atol=0.2)


@pytest.mark.slow
def test_agents_are_trained_and_the_way_they_are_grouped_changes_nothing():
    env = world(terminates=True)
    config = hac_suite.Config(episodes_per_period=8, test_episodes=3, hidden_sizes=(16,))

    def rates(seeds):
        results = hac_suite.train(
            env.copies, config, seeds, subgoal_layers=1, horizons=(6, 6), periods=1
        )
        rows = [row for result in results for row in result.rows]
        return {(r["seed"], r["period"]): (r["success_rate"], r["train_steps"]) for r in rows}

    assert rates([0, 1]) == {**rates([1]), **rates([0])}


def test_a_policy_acts_with_the_spec_as_in_tests():
    env = world(told_where=False)
    config = hac_suite.Config(episodes_per_period=4, test_episodes=2, hidden_sizes=(16,))
    *_, result = hac_suite.train(
        env.copies, config, [0], subgoal_layers=1, horizons=(6, 6), periods=1
    )
    policy, views = result.policies[0], []
    hac_suite.run_episodes(env.copies(1), policy, np.array([3]), on_step=views.append)
    policy.reset(env.spec)
    alone = env.copies(1)
    state = alone.reset(np.array([3]), test=True)
    for view in views[1:6]:
        action = policy.act(state.observation[0], state.desired_goal[0], state.achieved_subgoal[0])
        state = alone.step(action[None])
        np.testing.assert_array_equal(state.observation, view.env_step.observation)
