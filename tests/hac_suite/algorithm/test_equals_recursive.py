"""The array engine and the recursive transcription store the same transitions.

Both read the same draws, actors and starts, so everything is compared bit for bit.
"""

import dataclasses
from collections import Counter

import numpy as np
import pytest

from hac_suite.algorithm import exploration, hierarchy, transitions
from hac_suite.algorithm.record import BY_EPISODE, Outcome
from hac_suite.config import PAPER, PRESETS
from hac_suite.types import level_specs
from tests.cases import some_slow
from tests.hac_suite.recursive_hac import Draws, RecursiveHac, Transition, first_row
from tests.hac_suite.tiny_envs import PointEnv

SEEDS, EPISODES = 3, 40  # two leading axes of a round, flattened to N environments
MAX_STEPS = 17
DIVERGE_AT = {5: 0, 21: 3, 38: 6, 60: 9, 77: 16, 101: 12}
KINDS = {"regular": transitions.REGULAR, "penalty": transitions.PENALTY}
KINDS["hindsight"] = transitions.HINDSIGHT

# By number of levels: some that run out of attempts, some that run out of steps.
HORIZONS = {
    1: [(9,), (MAX_STEPS,), (MAX_STEPS + 1,)],
    2: [(3, 4), (5, 9)],
    3: [(2, 2, 3), (3, 3, 3), (6, 2, 9)],
    4: [(2, 2, 2, 1), (2, 2, 2, 3), (3, 2, 1, 9)],
}
# More levels than the suite's agents have take long.
LEVELS = some_slow(HORIZONS, 4)
PRESET_CASES = {
    "subgoal achieved",
    "subgoal missed",
    "subgoal tested and achieved",
    "subgoal tested, missed and penalised",
    "tested subgoal cut short by a higher goal",
    "tested subgoal cut short by the step limit",
    "end goal achieved",
    "end goal cut short by the step limit",
    "top level out of attempts",
    "diverged",
}
_ALL_HELD = "segment without hindsight goals, as all held at its start"


class CountingHac(RecursiveHac):
    """Says which cases came up, so that no comparison passes for want of them."""

    def __init__(self, *args):
        super().__init__(*args)
        self.cases: Counter[str] = Counter()
        self.made = [0] * len(self.horizons)  # attempts at the present goal
        self.states = []
        self.outcomes = []  # (step, level, Outcome, who cut it short) of every proposed subgoal

    def act(self, action):
        super().act(action)
        self.states.append(self.state)

    def pursue(self, level, goal, under_test):
        self.made[level] = 0
        used_up = super().pursue(level, goal, under_test)
        if self.state.diverged:
            self.cases["diverged"] += 1
        elif level == self.top and self.state.failed:
            self.cases["failed"] += 1
        elif level == self.top:
            if self.achieved(level):
                self.cases["end goal achieved"] += 1
            elif used_up:
                self.cases["top level out of attempts"] += 1
            else:
                self.cases["end goal cut short by the step limit"] += 1
        return used_up

    def process_transition(self, level, before, proposal, tested, finished):
        self.made[level] += 1
        if level > 0:
            self._count_subgoal(level, tested, finished)
            self.outcomes.append((self.t, level, *self._outcome(level, finished)))
        return super().process_transition(level, before, proposal, tested, finished)

    def _outcome(self, level, finished):
        if self.achieved(level - 1):
            return Outcome.ACHIEVED, BY_EPISODE
        if finished:
            return Outcome.MISSED, BY_EPISODE
        above = [j for j in range(level, self.top + 1) if self.achieved(j)]
        return Outcome.CUT_SHORT, above[0] if above else BY_EPISODE

    def _count_subgoal(self, level, tested, finished):
        achieved = self.achieved(level - 1)
        if not tested:
            self.cases["subgoal achieved" if achieved else "subgoal missed"] += 1
        elif achieved:
            self.cases["subgoal tested and achieved"] += 1
        elif finished:
            self.cases["subgoal tested, missed and penalised"] += 1
        else:
            above = any(self.achieved(j) for j in range(level, self.top + 1))
            cutter = "a higher goal" if above else "the step limit"
            self.cases[f"tested subgoal cut short by {cutter}"] += 1
            if self.made[level - 1] == self.horizons[level - 1]:
                self.cases["tested subgoal cut short in the last attempt at it"] += 1

    def replay_in_hindsight(self, level, segment):
        stored = len(self.stored)
        super().replay_in_hindsight(level, segment)
        if len(self.stored) == stored:
            self.cases[_ALL_HELD] += 1


def fold(x):
    """A triangle wave of period 4 into [-1, 1]; unlike tanh the same bits whatever the shape."""
    return np.abs(x % 4.0 - 2.0) - 1.0


def make_actors(env, horizons, seed):
    """Arbitrary deterministic actors, nonlinear in all that they see."""
    rng = np.random.default_rng(seed)

    def make(level):
        weights = rng.normal(
            0.0, 1.5, (level.observation_dim + level.goal_space.dim + 1, level.action_dim)
        )

        def actor(observation, goal):
            total = np.broadcast_to(weights[-1], (*observation.shape[:-1], level.action_dim))
            seen = np.concatenate([observation, goal], axis=-1)
            for column in range(seen.shape[-1]):  # Added up in one order, whatever the shape.
                total = total + seen[..., column : column + 1] * weights[column]
            return fold(total)

        return actor

    return [make(level) for level in level_specs(env, horizons)]


def make_round(config, horizons, seed, **world):
    """Environments, actors, draws and episode seeds of one round."""
    env = PointEnv(SEEDS * EPISODES, max_steps=MAX_STEPS, diverge_at=DIVERGE_AT, **world)
    generators = [np.random.default_rng([seed, s]) for s in range(SEEDS)]
    config = dataclasses.replace(config, episodes_per_period=EPISODES, episodes_per_round=EPISODES)
    draws = exploration.draw_round(generators, level_specs(env, horizons), config, MAX_STEPS)
    episode_seeds = np.random.default_rng(seed).integers(2**32, size=env.num_envs)
    return env, make_actors(env, horizons, seed), draws, episode_seeds


def one_environment(n, **world):
    """Environment n of a round, alone."""
    diverge_at = {0: DIVERGE_AT[n]} if n in DIVERGE_AT else {}
    return PointEnv(1, max_steps=MAX_STEPS, diverge_at=diverge_at, **world)


def of_environment(draws, n):
    return Draws(*([by_level[n] for by_level in drawn] for drawn in draws))


def array_transitions(config, horizons, seed, **world):
    """What the engine stores, per level."""
    env, actors, draws, episode_seeds = make_round(config, horizons, seed, **world)
    recorded = hierarchy.collect(env, actors, config, horizons, draws, episode_seeds)
    spaces = env.goal_space, env.subgoal_space
    return transitions.build(recorded, config, horizons, draws.hindsight, *spaces)


def recursive_transitions(config, horizons, seed, **world):
    """What the transcription stores, per environment, and the cases that came up."""
    env, actors, draws, episode_seeds = make_round(config, horizons, seed, **world)
    stored, cases = [], Counter()
    for n in range(env.num_envs):
        alone, its_draws = one_environment(n, **world), of_environment(draws, n)
        agent = CountingHac(alone, actors, config, horizons, its_draws)
        stored.append(agent.episode(int(episode_seeds[n])))
        cases += agent.cases
    return stored, cases


def as_rows(stored: list[Transition]) -> np.ndarray:
    """One row per transition: observation, action, reward, next observation, goal, discount."""
    return np.array([np.hstack(transition[2:]) for transition in stored])


def sorted_rows(rows: np.ndarray) -> np.ndarray:
    return rows[np.lexsort(rows.T)] if len(rows) else rows


def assert_same(built, stored):
    """Every level, environment and kind; in order, but for the order of a segment's picks."""
    for level, of_level in enumerate(built):
        fields = [f if f.ndim == 2 else f[:, None] for f in of_level[2:]]
        rows = np.concatenate(fields, axis=1)
        for n, mine in enumerate(stored):
            for kind, code in KINDS.items():
                actual = rows[(of_level.env == n) & (of_level.kind == code)]
                expected = as_rows([t for t in mine if t.level == level and t.kind == kind])
                if kind == "hindsight":
                    actual, expected = sorted_rows(actual), sorted_rows(expected)
                message = f"level {level}, environment {n}, {kind}"
                assert len(actual) == len(expected), message
                if len(actual):
                    np.testing.assert_array_equal(actual, expected, message)


def expected_cases(levels, config):
    """The cases that must come up with so many levels."""
    cases = set(PRESET_CASES)
    if config.drop_held_hindsight:
        cases.add(_ALL_HELD)
    if levels == 1:
        return {case for case in cases if "subgoal" not in case}
    if levels > 2:
        cases.add("tested subgoal cut short in the last attempt at it")
    return cases


@pytest.mark.parametrize("levels", LEVELS)
@pytest.mark.parametrize("preset", some_slow(PRESETS, "release_2018", "release_2020"))
def test_the_engine_stores_what_the_algorithms_say(preset, levels):
    cases = Counter()
    for seed, horizons in enumerate(HORIZONS[levels]):
        built = array_transitions(PRESETS[preset], horizons, seed)
        stored, came_up = recursive_transitions(PRESETS[preset], horizons, seed)
        assert_same(built, stored)
        cases += came_up
    assert expected_cases(levels, PRESETS[preset]) - set(cases) == set(), cases


SWITCHES = {
    "penalise_cut_short": True,
    "hindsight_actions": False,
    "hindsight_goals": 0,
    "hindsight_relabels": "segment",
    "hindsight_pick_last": True,
    "drop_held_hindsight": False,
    "test_draw": "each_level",
    "tested_subgoal_noise_free": False,
    "continue_after_goal": True,
    "random_action_rate": 0.7,
    "random_subgoal_rate": 0.7,
    "subgoal_test_rate": 0.9,
    "action_noise": 0.5,
    "subgoal_noise": 0.5,
    "discount": 0.5,
}


@pytest.mark.parametrize("dropped", [True, False])
@pytest.mark.parametrize("goals", some_slow((1, 2, 4), 1, 4))
@pytest.mark.parametrize("levels", LEVELS)
def test_hindsight_for_each_transition_means_the_same_to_both(levels, goals, dropped):
    config = dataclasses.replace(
        PAPER, hindsight_relabels="future", hindsight_goals=goals, drop_held_hindsight=dropped
    )
    horizons = HORIZONS[levels][-1]
    built = array_transitions(config, horizons, seed=8)
    assert_same(built, recursive_transitions(config, horizons, seed=8)[0])
    (whole,) = array_transitions(dataclasses.replace(config, drop_held_hindsight=False), (99,), 8)
    regular, hindsight = (
        (whole.kind == KINDS[kind]) & ~np.isin(whole.env, list(DIVERGE_AT))
        for kind in ("regular", "hindsight")
    )
    assert hindsight.sum() == goals * regular.sum() > 0


@pytest.mark.parametrize("switch", SWITCHES)
@pytest.mark.parametrize("horizons", some_slow([[6, 2, 9], [2, 2, 3]], [2, 2, 3]))
def test_each_switch_alone_means_the_same_to_both(switch, horizons):
    config = dataclasses.replace(PAPER, **{switch: SWITCHES[switch]})
    built = array_transitions(config, horizons, seed=7)
    assert_same(built, recursive_transitions(config, horizons, seed=7)[0])


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("levels", LEVELS)
def test_failing_and_moving_goals_mean_the_same_to_both(levels, preset):
    world = {"fail_beyond": 0.55, "drift": 0.03}
    config, horizons = PRESETS[preset], HORIZONS[levels][-1]
    built = array_transitions(config, horizons, 5, **world)
    stored, cases = recursive_transitions(config, horizons, 5, **world)
    assert_same(built, stored)
    assert cases["failed"] > 10 and cases["end goal achieved"] > 10
    for level, t_i in zip(built, horizons, strict=True):
        final = (level.kind == transitions.REGULAR) & (level.reward == -t_i) & (level.discount == 0)
        assert final.sum() >= cases["failed"]  # T_i of 1 has more of them
        assert (level.discount[final] == 0).all()


def assert_same_test_episodes(config, horizons, seed):
    """Returns which of the episodes, all free of noise, achieved the end goal."""
    env, actors, draws, episode_seeds = make_round(config, horizons, seed)
    seen, outcomes = [], []
    run = hierarchy.collect(
        *(env, actors, config, horizons, None, episode_seeds),
        test=True,
        on_step=lambda view: (
            seen.append(view.env_step.observation),
            outcomes.append((np.array(view.outcomes), np.array(view.cut_by))),
        ),
    )
    allowed = (*horizons[:-1], MAX_STEPS) if config.test_until_horizon else horizons
    for n in range(env.num_envs):
        alone = one_environment(n)
        agent = CountingHac(alone, actors, config, allowed, of_environment(draws, n))
        agent.t, agent.state = 0, first_row(alone.reset(episode_seeds[n : n + 1], test=True))
        agent.pursue(agent.top, agent.state.desired_goal, under_test=True)
        assert run.steps[n] == agent.t
        assert run.diverged[n] == agent.state.diverged
        assert run.success[n] == (agent.achieved(agent.top) and not agent.state.diverged)
        if not agent.state.diverged:
            told = Counter((level, outcome) for _, level, outcome, _ in agent.outcomes)
            for level in range(1, len(horizons)):
                for outcome in (Outcome.ACHIEVED, Outcome.MISSED, Outcome.CUT_SHORT):
                    assert run.outcomes[level, n, outcome] == told[level, outcome]
            emitted = [
                (step, level, outcome[level - 1, n], cut_by[level - 1, n])
                for step, (outcome, cut_by) in enumerate(outcomes[1 : agent.t + 1], start=1)
                for level in range(1, len(horizons))
                if outcome[level - 1, n] != Outcome.OPEN
            ]
            assert [
                (*told[:3], told[3] if told[2] == Outcome.CUT_SHORT else BY_EPISODE)
                for told in emitted
            ] == sorted(agent.outcomes)
        visited = [step[n] for step in seen[1 : agent.t + 1]]
        np.testing.assert_array_equal(visited, [state.observation for state in agent.states])
    return run.success


@pytest.mark.parametrize("levels", some_slow(HORIZONS, 3, 4))
@pytest.mark.parametrize("until_horizon", [True, False])
def test_a_test_episode_is_a_subgoal_test_from_top_to_bottom(levels, until_horizon):
    config = dataclasses.replace(PAPER, test_until_horizon=until_horizon)
    success = [
        assert_same_test_episodes(config, horizons, seed)
        for seed, horizons in enumerate(HORIZONS[levels])
    ]
    assert np.any(success) and not np.all(success)
