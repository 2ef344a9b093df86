"""A stepped episode is the one that `run_episodes` plays; moving its goal begins another."""

import numpy as np
import pytest

import hac_suite
import tasks
from launch.folder import policies
from launch.pictures.stage import Stage
from launch.viewing.episode import Episode
from launch.viewing.goal_handle import GoalHandle
from launch.viewing.player import KEPT, Player

CASES = [("pick_place", 2), ("ur5_reacher", 1), ("cartpole_swingup", 2), ("pendulum_balance", 0)]


def policy_of(task: str, layers: int) -> hac_suite.Policy:
    (found,) = (p for p in policies.published(task) if p.subgoal_layers == layers)
    return hac_suite.Policy.load(found.path)


@pytest.fixture(params=CASES, ids=str)
def case(request):
    task, layers = request.param
    env = tasks.load_vector(task, 1)
    yield env, policy_of(task, layers)
    env.close()


def test_a_stepped_episode_is_what_run_episodes_plays(case):
    env, policy = case
    views: list = []
    other = tasks.load_vector(policy.metadata["task"], 1)
    stats = hac_suite.run_episodes(
        other,
        policy,
        np.array([4]),
        on_step=lambda view: views.append(
            ([s[0].copy() for s in view.subgoals], [int(o[0]) for o in view.outcomes])
        ),
    )
    episode = Episode(env, policy, 4)
    for k, goal in enumerate(views[0][0]):
        np.testing.assert_array_equal(episode.subgoals[k], goal)
    for pursued, outcomes in views[1 : int(stats.steps[0]) + 1]:
        for ours, theirs in zip(episode.subgoals, pursued, strict=True):
            np.testing.assert_array_equal(ours, theirs)
        episode.advance()
        ended = {end.level: int(end.outcome) for end in episode.ended}
        assert ended == {k: outcome for k, outcome in enumerate(outcomes, 1) if outcome}
    assert episode.over and episode.step == stats.steps[0]
    assert episode.succeeded == stats.success[0]
    episode.advance()
    assert episode.step == stats.steps[0]  # nothing goes on after the end


def test_why_a_subgoal_was_cut_short_is_said():
    env = tasks.load_vector("pick_place", 1)
    player = Player(Episode(env, policy_of("pick_place", 2), 0), 0.015)
    said = set()
    while not player.episode.over:
        player.step()
        said |= {str(ended) for ended in player.episode.ended}
    assert player.episode.succeeded
    assert "level 2's subgoal: cut short (the end goal was achieved)" in said
    assert "level 1's subgoal: achieved" in said


def test_a_moved_goal_begins_an_episode_from_where_things_are():
    env = tasks.load_vector("pick_place", 1)
    policy = policy_of("pick_place", 2)
    episode = Episode(env, policy, 0)
    for _ in range(30):
        episode.advance()
    before, subgoals = env.simulation(0)[1].qpos, episode.subgoals
    episode.move_goal(np.array([0.3, 0.4]))
    np.testing.assert_array_equal(env.simulation(0)[1].qpos, before)
    assert (episode.step, episode.over) == (0, False)
    np.testing.assert_array_equal(episode.goal, [0.3, 0.4])
    # The top level has answered at once: it proposes what it would for this state and goal.
    specs = hac_suite.types.level_specs(env, policy.horizons)
    seen = env.move_goal(0, episode.goal)
    output = policy.actors(specs)[2](seen.observation, episode.goal[None])
    expected = env.subgoal_space.denormalise(output.astype(np.float64))[0]
    np.testing.assert_array_equal(episode.subgoals[1], expected)
    assert np.abs(episode.subgoals[1] - subgoals[1]).max() > 1e-3
    while not episode.over:
        episode.advance()
    assert episode.succeeded  # and it gets there


def test_a_goal_out_of_bounds_is_brought_within():
    env = tasks.load_vector("pick_place", 1)
    episode = Episode(env, policy_of("pick_place", 0), 0)
    episode.move_goal(np.array([9.0, -9.0]))
    np.testing.assert_array_equal(episode.goal, [env.goal_space.high[0], env.goal_space.low[1]])


def test_attempts_left_are_the_horizons_less_those_made():
    env = tasks.load_vector("pick_place", 1)
    policy = policy_of("pick_place", 2)
    episode = Episode(env, policy, 0)
    assert [(s.made, s.allowed) for s in episode.statuses()] == [(0, 7), (0, 7), (0, None)]
    episode.advance()
    assert episode.statuses()[0].made == 1
    values = [status.value for status in episode.statuses()]
    assert max(values) <= 0  # Q in units of attempts


@pytest.mark.parametrize("task", tasks.ALL)
def test_a_dragged_marker_gives_the_goal_that_puts_it_there(task):
    env = tasks.load_vector(task, 1)
    start = env.reset(np.array([0]), test=True).desired_goal[0]
    stage = Stage(env)
    handle = GoalHandle(env, stage, start)
    assert handle.axes == ((True, True, True) if task == "ur5_reacher" else (True, False, True))
    rng = np.random.default_rng(0)
    for _ in range(5):
        wanted = rng.uniform(env.goal_space.low, env.goal_space.high)
        env.move_goal(0, wanted)
        place = handle.place()
        found = handle.goal_at(place, start)
        np.testing.assert_allclose(handle.place(), place, atol=1e-5)
        bodies = ("tip", "rod", "effector")  # what the goals' markers stand for
        names = [name.rpartition("_") for name in env.goal_space.names]
        shown = [i for i, (body, _, axis) in enumerate(names) if body in bodies and axis in "xyz"]
        np.testing.assert_allclose(found[shown], wanted[shown], atol=1e-5)
        hidden = [i for i in range(env.goal_space.dim) if i not in shown]
        np.testing.assert_array_equal(found[hidden], start[hidden])  # no marker shows them


def test_a_marker_dragged_too_far_stays_within_bounds():
    env = tasks.load_vector("pick_place", 1)
    start = env.reset(np.array([0]), test=True).desired_goal[0]
    handle = GoalHandle(env, Stage(env), start)
    found = handle.goal_at(np.array([5.0, 3.0, 0.4]), start)
    np.testing.assert_allclose(found, [env.goal_space.high[0], 0.4], atol=1e-5)


class Clockwork:
    """An episode of so many steps in which nothing happens."""

    def __init__(self, steps: int):
        self.step, self.steps, self.ended = 0, steps, []

    @property
    def over(self) -> bool:
        return self.step == self.steps

    def advance(self) -> None:
        self.step += 1


def test_steps_are_due_at_the_chosen_pace():
    player = Player(Clockwork(100), 0.02, speed=0.5)
    assert not player.tick(9.0) and player.episode.step == 0  # it is not playing yet
    player.play(10.0)
    assert player.tick(10.0) and player.episode.step == 1
    assert not player.tick(10.03)
    assert player.seconds_to_wait(10.03, most=1.0) == pytest.approx(0.01)
    assert player.tick(10.041) and player.episode.step == 2
    player.speed = 4.0
    player.tick(10.081)
    player.tick(10.0901)
    assert player.episode.step == 5
    player.pause()
    assert not player.tick(99.0) and player.seconds_to_wait(99.0, most=0.5) == 0.5


def test_a_page_that_fell_behind_does_not_catch_up():
    player = Player(Clockwork(1000), 0.01, speed=1.0)
    player.play(0.0)
    player.tick(100.0)
    assert player.episode.step == 20
    assert not player.tick(100.0 - 1e-9)


def test_no_step_is_due_after_the_end():
    player = Player(Clockwork(3), 0.01, speed=1.0)
    player.play(0.0)
    player.tick(1.0)
    assert player.episode.step == 3 and not player.running and not player.tick(2.0)


def test_the_latest_endings_are_kept_and_all_are_counted():
    env = tasks.load_vector("pick_place", 1)
    episode = Episode(env, policy_of("pick_place", 2), 0)
    player = Player(episode, 0.015)
    total = 0
    while not episode.over:
        player.step()
        total += len(episode.ended)
    assert len(player.recent) == KEPT < total
    assert sum(sum(tally.values()) for tally in player.counts.values()) == total
    assert player.recent[0].step == episode.step
    player.move_goal(np.array([0.3, 0.4]))
    assert not player.recent and not player.counts
