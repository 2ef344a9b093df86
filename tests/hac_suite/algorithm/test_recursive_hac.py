"""The recursive transcription against episodes short enough to follow by hand."""

import dataclasses

import numpy as np
import pytest

from hac_suite.config import PAPER, Config
from tasks.goal_space import GoalSpace
from tests.hac_suite.recursive_hac import Draws, RecursiveHac
from tests.hac_suite.tiny_envs import Step

GAMMA = PAPER.discount
NEVER, ALWAYS = 1.0, 0.0  # draws that no rate, or any rate above zero, exceeds
# One thing at a time: the tests of hindsight goals switch these on.
PLAIN = dataclasses.replace(PAPER, hindsight_goals=0)


class Corridor:
    """A place x on a line, moved by the action; the end goal and the subgoals are places."""

    observation_dim = 1
    action_low, action_high = np.array([-1.0]), np.array([1.0])
    goal_space = GoalSpace(("x",), ("m",), np.array([-9.0]), np.array([9.0]), np.array([0.25]))
    subgoal_space = GoalSpace(("x",), ("m",), np.array([-20.0]), np.array([20.0]), np.array([0.25]))

    def __init__(self, goal: float, max_steps: int = 20, diverge_at: int | None = None):
        self.max_steps, self._goal, self._diverge_at = max_steps, goal, diverge_at

    def reset(self, seeds):
        self._x, self._t = 0.0, 0
        return self._view(diverged=False)

    def step(self, actions):
        diverged = self._t == self._diverge_at
        self._x += 0.0 if diverged else float(actions[0, 0])
        self._t += 1
        return self._view(diverged)

    def _view(self, diverged):
        x = np.array([[self._x]])
        return Step(x, x.copy(), x.copy(), np.array([[self._goal]]), np.array([diverged]))


def walk(observation, goal):
    """Level 0: a step of one towards the goal."""
    return np.clip(goal - observation, -1.0, 1.0)


def stride(length):
    """A level above: a subgoal `length` further right, in the units of the subgoal space."""
    return lambda observation, goal: (observation + length) / 20.0


def draws(levels=2, *, random_actions=(), tests=(), picks=()):
    """No noise, test or pick but at the given (level, step), and picks by (level, last step)."""
    steps, most = 20, max([len(pick) for _, _, pick in picks], default=0)
    explore, test = np.full((levels, steps), NEVER), np.full((levels, steps), NEVER)
    for level, step in random_actions:
        explore[level, step] = ALWAYS
    for level, step in tests:
        test[level, step] = ALWAYS
    hindsight = np.zeros((levels, steps, most))
    for level, step, pick in picks:
        hindsight[level, step, : len(pick)] = pick
    normal, uniform = np.zeros((levels, steps, 1)), np.full((levels, steps, 1), -0.2)
    return Draws(normal, uniform, explore, test, hindsight)


def run(env, strides, horizons, chance=None, config: Config = PLAIN):
    """What an agent that strides as given stores; see `shown` for how it is written."""
    actors = [walk, *(stride(length) for length in strides)]
    agent = RecursiveHac(env, actors, config, horizons, chance or draws(len(actors)))
    return agent.episode(seed=0)


def shown(stored, level, kind="regular"):
    """(x, action or subgoal in natural units, reward, next x, goal, discount) of each one."""
    unit = 1.0 if level == 0 else 20.0
    return [
        tuple(
            round(float(v), 9)
            for v in (
                *(t.observation[0], unit * t.action[0], t.reward),
                *(t.next_observation[0], t.goal[0], t.discount),
            )
        )
        for t in stored
        if t.level == level and t.kind == kind
    ]


def test_achieved_subgoals_are_stored_as_proposed():
    stored = run(Corridor(goal=4), strides=[2], horizons=[3, 3])
    assert shown(stored, 0) == [
        (0, 1, -1, 1, 2, GAMMA),
        (1, 1, 0, 2, 2, 0),
        (2, 1, -1, 3, 4, GAMMA),
        (3, 1, 0, 4, 4, 0),
    ]
    assert shown(stored, 1) == [(0, 2, -1, 2, 4, GAMMA), (2, 4, 0, 4, 4, 0)]
    assert len(stored) == 6


def test_a_missed_subgoal_becomes_the_hindsight_action_until_attempts_run_out():
    stored = run(Corridor(goal=6), strides=[3], horizons=[2, 2])
    assert shown(stored, 0)[1] == (1, 1, -1, 2, 3, GAMMA)
    assert shown(stored, 1) == [(0, 2, -1, 2, 6, GAMMA), (2, 4, -1, 4, 6, GAMMA)]
    assert len(stored) == 6  # T_1 = 2 subgoals of T_0 = 2 actions each: no end goal


def test_without_hindsight_actions_the_missed_proposal_is_stored():
    config = dataclasses.replace(PLAIN, hindsight_actions=False)
    stored = run(Corridor(goal=6), strides=[3], horizons=[2, 2], config=config)
    assert shown(stored, 1) == [(0, 3, -1, 2, 6, GAMMA), (2, 5, -1, 4, 6, GAMMA)]


def test_a_tested_and_missed_subgoal_costs_all_attempts_of_the_level_that_proposed_it():
    stored = run(Corridor(goal=6), strides=[3], horizons=[2, 4], chance=draws(tests=[(1, 2)]))
    assert shown(stored, 1, "penalty") == [(2, 5, -4, 4, 6, 0)]
    assert shown(stored, 1)[1] == (2, 4, -1, 4, 6, GAMMA)  # besides the hindsight action


def test_a_tested_and_achieved_subgoal_is_not_penalised():
    stored = run(Corridor(goal=4), strides=[2], horizons=[2, 2], chance=draws(tests=[(1, 0)]))
    assert shown(stored, 1, "penalty") == []


@pytest.mark.parametrize(
    ("env", "reward", "discount"),
    [(Corridor(goal=1), 0, 0), (Corridor(goal=9, max_steps=1), -1, GAMMA)],
    ids=["end goal", "step limit"],
)
def test_an_attempt_cut_short_is_no_evidence_against_its_subgoal(env, reward, discount):
    chance, goal = draws(tests=[(1, 0)]), env.reset([0]).desired_goal[0, 0]
    stored = run(env, strides=[3], horizons=[2, 2], chance=chance)
    assert shown(stored, 0) == [(0, 1, -1, 1, 3, GAMMA)]
    assert shown(stored, 1) == [(0, 1, reward, 1, goal, discount)]
    assert shown(stored, 1, "penalty") == []

    ablation = dataclasses.replace(PLAIN, penalise_cut_short=True)
    stored = run(env, strides=[3], horizons=[2, 2], chance=chance, config=ablation)
    assert shown(stored, 1, "penalty") == [(0, 3, -2, 1, goal, 0)]


def test_all_attempts_used_is_a_failure_also_when_the_end_goal_comes_with_the_last():
    chance = draws(tests=[(1, 0)])
    stored = run(Corridor(goal=2), strides=[3], horizons=[2, 2], chance=chance)
    assert shown(stored, 1) == [(0, 2, 0, 2, 2, 0)]
    assert shown(stored, 1, "penalty") == [(0, 3, -2, 2, 2, 0)]


def test_the_goal_of_any_level_above_ends_a_segment():
    # Level 2 wants x = 1, level 1 therefore 3 and level 0 again 3: x = 1 stops none of the two
    # below but the end goal does, and level 2 has achieved it with a subgoal of 1 in hindsight.
    stored = run(Corridor(goal=1), strides=[3, 3], horizons=[2, 2, 2])
    assert shown(stored, 0) == [(0, 1, -1, 1, 3, GAMMA)]
    assert shown(stored, 1) == [(0, 1, -1, 1, 3, GAMMA)]
    assert shown(stored, 2) == [(0, 1, 0, 1, 1, 0)]

    # The goal of level 1 (x = 2) is reached on the way to that of level 0 (x = 3): both stop, and
    # level 2 goes on from x = 2.
    stored = run(Corridor(goal=9), strides=[3, 2], horizons=[3, 2, 2])
    assert shown(stored, 0)[:3] == [
        (0, 1, -1, 1, 3, GAMMA),
        (1, 1, -1, 2, 3, GAMMA),
        (2, 1, -1, 3, 5, GAMMA),
    ]
    assert shown(stored, 1) == [(0, 2, 0, 2, 2, 0), (2, 4, 0, 4, 4, 0)]
    assert shown(stored, 2) == [(0, 2, -1, 2, 9, GAMMA), (2, 4, -1, 4, 9, GAMMA)]


def test_a_test_of_the_top_level_tests_the_subgoals_below():
    stored = run(Corridor(goal=9), [3, 9], [1, 2, 3], draws(3, tests=[(2, 2)]))
    assert shown(stored, 1, "penalty") == [(2, 5, -2, 3, 11, 0), (3, 6, -2, 4, 11, 0)]
    assert shown(stored, 2, "penalty") == [(2, 11, -3, 4, 9, 0)]


def test_a_last_attempt_cut_short_clears_the_levels_above():
    # At the step limit of 3, level 1 makes its second and last attempt, but half of it only: its
    # own subgoal is no failure, and so neither is that of level 2.
    chance = draws(3, tests=[(2, 0)])
    stored = run(Corridor(goal=9, max_steps=3), [3, 9], [2, 2, 2], chance)
    assert shown(stored, 1, "penalty") == [(0, 3, -2, 2, 9, 0)]
    assert shown(stored, 2, "penalty") == []
    stored = run(Corridor(goal=9, max_steps=4), [3, 9], [2, 2, 2], chance)
    assert shown(stored, 2, "penalty") == [(0, 9, -2, 4, 9, 0)]


def proposals(config, chance, levels, steps=2):
    """Each action (level 0) or penalised subgoal, of levels that do what they like at random."""
    strides, horizons = [3] * (levels - 1), [1] * (levels - 1) + [steps]
    env = Corridor(goal=9, max_steps=steps)
    stored = run(env, strides, horizons, chance, config)
    return [a for _, a, *_ in shown(stored, 0)], [a for _, a, *_ in shown(stored, 1, "penalty")]


def test_a_test_is_free_of_noise_and_what_is_no_test_is_not():
    # What is random is -0.2 of the way to the bound: a subgoal at x = -4.
    chance = draws(2, random_actions=[(0, 0), (0, 1), (1, 0), (1, 1)], tests=[(1, 1)])
    assert proposals(PLAIN, chance, 2) == ([-0.2, 1], [2.8])
    # In the releases the subgoal that is tested may itself be random; the action below is not.
    noisy = dataclasses.replace(PLAIN, tested_subgoal_noise_free=False)
    assert proposals(noisy, chance, 2) == ([-0.2, -1], [-4])


def test_noise_is_gaussian_scaled_by_level_and_clipped():
    config = dataclasses.replace(PLAIN, action_noise=0.5, subgoal_noise=0.25)
    chance = draws(2)
    chance.normal[1][0] = -0.125  # moves the subgoal from 3 by 0.25 * -0.125 * 20 to 2.375
    chance.normal[0][0] = -1.5  # and the action from 1 by 0.5 * -1.5 to 0.25
    chance.normal[0][1] = 7.0
    stored = run(Corridor(goal=9), [3], [2, 1], chance, config)
    assert shown(stored, 0) == [
        (0, 0.25, -1, 0.25, 2.375, GAMMA),
        (0.25, 1, -1, 1.25, 2.375, GAMMA),
    ]


def test_who_draws_the_test():
    # Level 1 of 3 may start a test of its own only in the releases.
    chance = draws(3, tests=[(1, 0)])
    each_level = dataclasses.replace(PLAIN, test_draw="each_level")
    assert shown(run(Corridor(9), [3, 9], [1, 1, 2], chance), 1, "penalty") == []
    stored = run(Corridor(9), [3, 9], [1, 1, 2], chance, each_level)
    assert shown(stored, 1, "penalty") == [(0, 3, -1, 1, 9, 0)]
    assert shown(stored, 2, "penalty") == []  # Its subgoal was not under test.


def hindsight(level, picks, strides=(5,), horizons=(3, 1), **changes):
    """The hindsight transitions of one segment, x = 0, 1, 2, 3, with the given picks."""
    config = dataclasses.replace(PLAIN, hindsight_goals=len(picks), **changes)
    chance = draws(len(strides) + 1, picks=[(level, 2, picks)])
    stored = run(Corridor(goal=9, max_steps=3), strides, horizons, chance, config)
    return shown(stored, level, "hindsight")


def test_a_hindsight_goal_relabels_its_transition_and_those_before():
    first = [(0, 1, 0, 1, 1, 0)]
    second = [(0, 1, -1, 1, 2, GAMMA), (1, 1, 0, 2, 2, 0)]
    third = [(0, 1, -1, 1, 3, GAMMA), (1, 1, -1, 2, 3, GAMMA), (2, 1, 0, 3, 3, 0)]
    assert hindsight(0, (0.3, 0.4, 0.9)) == first + second + third
    assert hindsight(0, (0.4, 0.5, 0.6)) == second  # the same pick thrice
    assert hindsight(0, (0.0, 0.1, 0.2), hindsight_pick_last=True) == first + third
    assert hindsight(0, ()) == []


def test_a_hindsight_goal_may_relabel_the_whole_segment():
    assert hindsight(0, (0.4,), hindsight_relabels="segment") == [
        (0, 1, -1, 1, 2, GAMMA),
        (1, 1, 0, 2, 2, 0),
        (2, 1, -1, 3, 2, GAMMA),
    ]


def test_hindsight_goals_of_a_subgoal_level_use_what_was_achieved():
    # Three missed subgoals, each after one action: the actions are those of hindsight.
    assert hindsight(1, (0.4,), horizons=(1, 3)) == [
        (0, 1, -1, 1, 2, GAMMA),
        (1, 2, 0, 2, 2, 0),
    ]


def test_penalties_have_no_hindsight_copy():
    config = dataclasses.replace(PLAIN, hindsight_goals=1)
    chance = draws(2, tests=[(1, 0)], picks=[(1, 1, (0.9,))])
    stored = run(Corridor(goal=9, max_steps=2), [5], [2, 1], chance, config)
    assert shown(stored, 1, "penalty") == [(0, 5, -1, 2, 9, 0)]
    assert shown(stored, 1, "hindsight") == [(0, 2, 0, 2, 2, 0)]


def test_a_hindsight_goal_that_held_at_the_start_is_dropped():
    # One action from x = 0 to 0.1, within the threshold of 0.25.
    chance = draws(2, picks=[(0, 0, (0.5,)), (1, 0, (0.5,))])
    for drop, kept in ((True, 0), (False, 1)):
        config = dataclasses.replace(PLAIN, hindsight_goals=1, drop_held_hindsight=drop)
        stored = run(Corridor(goal=9), [0.1], [3, 1], chance, config)
        assert len(shown(stored, 0, "hindsight")) == kept
        assert len(shown(stored, 1, "hindsight")) == kept


def test_a_diverged_step_takes_the_open_attempts_and_segments_with_it():
    config = dataclasses.replace(PLAIN, hindsight_goals=1)
    picks = [(0, 1, (0.9,)), (0, 3, (0.9,)), (1, 3, (0.9,))]
    stored = run(Corridor(9, diverge_at=3), [2], [2, 3], draws(2, picks=picks), config)
    assert shown(stored, 0) == [
        (0, 1, -1, 1, 2, GAMMA),
        (1, 1, 0, 2, 2, 0),
        (2, 1, -1, 3, 4, GAMMA),
    ]
    assert shown(stored, 1) == [(0, 2, -1, 2, 9, GAMMA)]
    assert shown(stored, 0, "hindsight") == [(0, 1, -1, 1, 2, GAMMA), (1, 1, 0, 2, 2, 0)]
    assert shown(stored, 1, "hindsight") == []


def test_an_episode_may_go_on_after_the_end_goal_with_fresh_attempts():
    onward = dataclasses.replace(PLAIN, continue_after_goal=True)
    stored = run(Corridor(goal=2), [1], [1, 3], config=onward)
    # The goal with the second of three attempts, and then three more without.
    assert shown(stored, 1) == [
        (0, 1, -1, 1, 2, GAMMA),
        (1, 2, 0, 2, 2, 0),
        (2, 3, -1, 3, 2, GAMMA),
        (3, 4, -1, 4, 2, GAMMA),
        (4, 5, -1, 5, 2, GAMMA),
    ]
    assert len(shown(run(Corridor(goal=2), [1], [1, 3]), 1)) == 2
    stored = run(Corridor(goal=2, max_steps=3), [1], [1, 3], config=onward)
    assert len(shown(stored, 1)) == 3


def test_without_subgoal_layers_it_is_ddpg_with_hindsight():
    config = dataclasses.replace(PLAIN, hindsight_goals=1)
    chance = draws(1, tests=[(0, 0)], picks=[(0, 2, (0.4,))])
    stored = run(Corridor(goal=9, max_steps=3), [], [20], chance, config)
    assert shown(stored, 0) == [(x, 1, -1, x + 1, 9, GAMMA) for x in range(3)]
    assert shown(stored, 0, "hindsight") == [(0, 1, -1, 1, 2, GAMMA), (1, 1, 0, 2, 2, 0)]
    assert len(stored) == 5
