"""Algorithms 1 and 2 of the Hierarchical Actor-Critic paper, recursively, for one environment.

Read this to learn HAC. `hac_suite` does the same for many environments at once, with masks on
arrays; `test_equals_recursive.py` holds the two to the same transitions.

A hierarchy has levels 0 to n. Level 0 outputs actions, level i > 0 outputs subgoals for level
i - 1. A level makes *attempts* at a goal, at most T_i; its attempts at one goal are a *segment*:

    level 2   one segment: up to T_2 attempts at the end goal, each a subgoal for level 1
    level 1   for each of these a segment: up to T_1 attempts at it, each a subgoal for level 0
    level 0   for each of those a segment: up to T_0 attempts at it, each an action

What a level outputs is its *proposal*, in normalised units: [-1, 1] from bound to bound.
Observations and goals are in natural units.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from hac_suite.config import Config
from hac_suite.types import failed

Actor = Callable[[np.ndarray, np.ndarray], np.ndarray]  # pi_i: (observation, goal) -> proposal


class Draws(NamedTuple):
    """All chance in an episode of at most H steps, by level i and by primitive step t."""

    normal: Sequence[np.ndarray]  # [H, A_i] standard Gaussian: noise of what is proposed at t
    uniform: Sequence[np.ndarray]  # [H, A_i] in [-1, 1]: a random proposal at t
    explore: Sequence[np.ndarray]  # [H] in [0, 1): is that random proposal taken?
    test: Sequence[np.ndarray]  # [H] in [0, 1): is what is proposed at t a subgoal test?
    hindsight: Sequence[np.ndarray]  # [H, K] in [0, 1): picks for what was completed by step t


class State(NamedTuple):
    """The state s as the agent sees it, with its projections f(s) onto both goal spaces."""

    observation: np.ndarray
    achieved_goal: np.ndarray
    achieved_subgoal: np.ndarray
    desired_goal: np.ndarray
    diverged: bool  # the simulation blew up on the way here
    failed: bool = False  # the environment ended the episode here, and not at its goal


class Attempt(NamedTuple):
    """A finished attempt, waiting in its segment for hindsight goals (TBD in Algorithm 2)."""

    before: State
    action: np.ndarray  # one that did lead to `after`: the proposal or the hindsight action
    after: State
    time: int  # the primitive step that completed it


class Transition(NamedTuple):
    """An entry of the replay buffer R_i of level i."""

    level: int
    kind: str  # "regular", "penalty" or "hindsight"
    observation: np.ndarray
    action: np.ndarray
    reward: float
    next_observation: np.ndarray
    goal: np.ndarray
    discount: float  # gamma_g, by which the value of the next state counts


class RecursiveHac:
    """A training episode. `horizons[i]` is T_i; `env` is a vectorised environment of size one."""

    def __init__(self, env, actors: list[Actor], config: Config, horizons: list[int], draws: Draws):
        self.env, self.actors, self.config = env, actors, config
        self.horizons, self.draws = horizons, draws
        self.top = len(actors) - 1
        self.goals = [np.empty(0)] * len(actors)  # the goal that each level pursues now
        self.stored: list[Transition] = []  # R_0, ..., R_n in order of arrival

    # -- Algorithm 1: who proposes what, and for how long --------------------------------------

    def episode(self, seed: int) -> list[Transition]:
        """Samples the end goal G and s_0, and has the top level pursue G."""
        self.t = 0  # primitive steps so far
        self.state = first_row(self.env.reset(np.array([seed])))
        self.pursue(self.top, self.state.desired_goal, under_test=False)
        # In the release of 2018 the achieved end goal is not the end: the top level starts over.
        while self.config.continue_after_goal and self.achieved(self.top) and not self.is_over():
            self.pursue(self.top, self.state.desired_goal, under_test=False)
        return self.stored

    def pursue(self, level: int, goal: np.ndarray, under_test: bool) -> bool:
        """One segment of `level`: the loop `for t_i = 1 to T_i do`.

        Returns whether all T_i attempts were made, none of them cut short. Only then is a missed
        goal a failure of those who pursued it (Section 3.2).
        """
        self.goals[level] = goal
        segment: list[Attempt] = []
        for _ in range(self.horizons[level]):
            before = self.state
            proposal, tested = self.propose(level, self.goals[level], under_test)
            if level == 0:
                self.act(proposal)
                finished = True
            else:
                subgoal = self.env.subgoal_space.denormalise(proposal)
                used_up = self.pursue(level - 1, subgoal, tested)
                finished = used_up or self.achieved(level - 1)  # or else cut short
            if self.state.diverged:
                return False  # What came of this attempt is unknown; the segment is forgotten.
            segment.append(self.process_transition(level, before, proposal, tested, finished))
            if self.must_stop(level):
                break
        self.replay_in_hindsight(level, segment)
        return finished and len(segment) == self.horizons[level]

    def must_stop(self, level: int) -> bool:
        """`if g_i, ..., G achieved`: by the goal of this level, or of any above it.

        Level 0 asks after every primitive action, and each level above on the way back up.
        """
        return self.is_over() or any(self.achieved(j) for j in range(level, self.top + 1))

    def is_over(self) -> bool:
        """Whether the episode ends here, whatever was achieved."""
        return self.t == self.env.max_steps or self.state.diverged or self.state.failed

    def act(self, action: np.ndarray) -> None:
        """Takes a primitive step."""
        middle = 0.5 * (self.env.action_high + self.env.action_low)
        half_range = 0.5 * (self.env.action_high - self.env.action_low)
        self.state = first_row(self.env.step((middle + half_range * action)[None]))
        self.t += 1
        self.goals[self.top] = self.state.desired_goal  # it may have moved

    def achieved(self, level: int) -> bool:
        """Whether the state achieves the goal that `level` pursues."""
        return self.holds(level, self.goals[level], self.state)

    # -- Proposals: exploration and subgoal testing (Section 3.2) ------------------------------

    def propose(self, level: int, goal: np.ndarray, under_test: bool) -> tuple[np.ndarray, bool]:
        """The next proposal of a level, and whether it and all that follows from it is a test.

        A test is free of noise: a subgoal missed because of noise would say nothing about it.
        """
        may_draw = self.config.test_draw == "each_level" or level == self.top
        starts_test = (
            level > 0  # a test is of a subgoal
            and not under_test
            and may_draw
            and self.draws.test[level][self.t] < self.config.subgoal_test_rate
        )
        proposal = self.actors[level](self.state.observation, goal)
        # The releases draw after they have added noise, so that what is tested may be noisy.
        if not (under_test or (starts_test and self.config.tested_subgoal_noise_free)):
            proposal = self.explore(level, proposal)
        return proposal, under_test or starts_test

    def explore(self, level: int, proposal: np.ndarray) -> np.ndarray:
        """Gaussian noise, or now and then something random instead."""
        rate = self.config.random_subgoal_rate if level else self.config.random_action_rate
        sigma = self.config.subgoal_noise if level else self.config.action_noise
        if self.draws.explore[level][self.t] < rate:
            return self.draws.uniform[level][self.t]
        return np.clip(proposal + sigma * self.draws.normal[level][self.t], -1.0, 1.0)

    # -- Algorithm 2: what is stored -----------------------------------------------------------

    def process_transition(
        self, level: int, before: State, proposal: np.ndarray, tested: bool, finished: bool
    ) -> Attempt:
        """ProcessTrans. Returns the copy with the goal and the reward to be decided."""
        goal, after = self.goals[level], self.state
        missed = level > 0 and not self.achieved(level - 1)
        action = proposal
        if missed and self.config.hindsight_actions:
            # Had the level proposed what came about, it would have been right.
            action = self.env.subgoal_space.normalise(after.achieved_subgoal)
        attempt = Attempt(before, action, after, self.t - 1)
        self.store(level, "regular", attempt, goal)
        if missed and tested and (finished or self.config.penalise_cut_short):
            self.store(level, "penalty", attempt._replace(action=proposal), goal)
        return attempt

    def replay_in_hindsight(self, level: int, segment: list[Attempt]) -> None:
        """Perform HER: goals become what was reached at picked attempts (Section 3.3)."""
        if self.config.hindsight_relabels == "future":
            relabelled = self.picks_of_each(level, segment)
        else:
            relabelled = self.picks_of_segment(level, segment)
        for position, pick in relabelled:
            goal = self.project(level, segment[pick].after)
            if self.config.drop_held_hindsight and self.holds(level, goal, segment[0].before):
                continue  # What held from the start was not brought about.
            self.store(level, "hindsight", segment[position], goal)

    def picks_of_segment(self, level: int, segment: list[Attempt]) -> list[tuple[int, int]]:
        """A few attempts of the segment; each relabels itself and all before it, or all."""
        picks = [int(u * len(segment)) for u in self.chance(level, segment[-1])] if segment else []
        if self.config.hindsight_pick_last and picks:
            picks[-1] = len(segment) - 1
        whole = self.config.hindsight_relabels == "segment"
        return [
            (position, pick)
            for pick in sorted(set(picks))
            for position in range(len(segment) if whole else pick + 1)
        ]

    def picks_of_each(self, level: int, segment: list[Attempt]) -> list[tuple[int, int]]:
        """For each attempt a few at or after it: what the release of HER calls `future`."""
        return [
            (position, position + int(u * (len(segment) - position)))
            for position, attempt in enumerate(segment)
            for u in self.chance(level, attempt)
        ]

    def chance(self, level: int, attempt: Attempt) -> np.ndarray:
        """The draws that belong to an attempt."""
        return self.draws.hindsight[level][attempt.time][: self.config.hindsight_goals]

    def store(self, level: int, kind: str, attempt: Attempt, goal: np.ndarray) -> None:
        """Adds (s, a, r, s', g) to R_i: r is 0 and nothing follows if s' achieves g, else r is -1.

        That an episode reached its step limit does not matter here: the value of s' counts.
        """
        reward, discount = -1.0, self.config.discount
        if kind == "penalty":
            # -T_i for good: the value of a subgoal out of reach owes nothing to where it led.
            reward, discount = float(-self.horizons[level]), 0.0
        elif self.holds(level, goal, attempt.after):
            reward, discount = 0.0, 0.0
        elif attempt.after.failed:
            # Nothing follows, and -1 would be better than to live on: the worst return there is.
            reward, discount = float(-self.horizons[level]), 0.0
        s, next_s = attempt.before.observation, attempt.after.observation
        self.stored.append(
            Transition(level, kind, s, attempt.action, reward, next_s, goal, discount)
        )

    # -- Goals: the end goal for the top level, subgoals below ---------------------------------

    def project(self, level: int, state: State) -> np.ndarray:
        """f(s): the goal of this level that the state achieves."""
        return state.achieved_goal if level == self.top else state.achieved_subgoal

    def holds(self, level: int, goal: np.ndarray, state: State) -> bool:
        """Whether the state achieves a goal of this level, within its threshold.

        Nothing is achieved by failing.
        """
        space = self.env.goal_space if level == self.top else self.env.subgoal_space
        return not state.failed and bool(space.achieved(self.project(level, state), goal))


def first_row(step) -> State:
    """The only environment's part of what `env.reset` or `env.step` returned."""
    return State(
        step.observation[0],
        step.achieved_goal[0],
        step.achieved_subgoal[0],
        step.desired_goal[0],
        bool(step.diverged[0]),
        bool(failed(step)[0]),
    )
