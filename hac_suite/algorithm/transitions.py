"""Algorithm 2 and hindsight goals: turns a round's record into each level's transitions."""

from typing import NamedTuple

import numpy as np

from hac_suite.algorithm.record import LevelRecord, Outcome, Round
from hac_suite.config import Config
from hac_suite.types import GoalSpace

REGULAR, PENALTY, HINDSIGHT = 0, 1, 2


class Transitions(NamedTuple):
    """M transitions of one level, in natural units but for the action."""

    env: np.ndarray  # int [M]: the environment it happened in
    kind: np.ndarray  # int [M]: REGULAR, PENALTY or HINDSIGHT
    observation: np.ndarray  # [M, D]
    action: np.ndarray  # [M, A] in [-1, 1] (a hindsight action may lie beyond)
    reward: np.ndarray  # [M]
    next_observation: np.ndarray  # [M, D]
    goal: np.ndarray  # [M, G]
    discount: np.ndarray  # [M]: gamma_g, 0 where the goal was achieved


class _Terms(NamedTuple):
    """What a level's transitions are worth."""

    discount: float  # gamma, where something follows
    attempts: int  # T_i


class _Attempts(NamedTuple):
    """The completed attempts of one level, in order of environment, then time."""

    env: np.ndarray
    time: np.ndarray
    start: np.ndarray
    action: np.ndarray  # achieved, or the hindsight action
    goal: np.ndarray
    reached: np.ndarray
    failed: np.ndarray  # the environment ended the episode with it, in failure


def build(
    recorded: Round,
    config: Config,
    horizons: tuple[int, ...],
    hindsight_draws: list[np.ndarray],
    goal_space: GoalSpace,
    subgoal_space: GoalSpace,
) -> list[Transitions]:
    """The transitions of every level, lowest first (Algorithm 2 and Section 3.3).

    Args:
        hindsight_draws: per level [N, H, K] in [0, 1).

    Within a level they come as regular, penalty, hindsight; each by environment, then time.
    """
    top = len(horizons) - 1
    built = []
    for level, record in enumerate(recorded.levels):
        attempts = _attempts(recorded, record, level, config, subgoal_space)
        terms = _Terms(config.discount, horizons[level])
        parts = [_regular(recorded, attempts, terms)]
        if level:
            parts.append(_penalties(recorded, record, attempts, terms, config))
        if config.hindsight_goals:
            achieved = recorded.achieved_goal if level == top else recorded.achieved_subgoal
            space = goal_space if level == top else subgoal_space
            draws = hindsight_draws[level]
            own = (achieved, space, draws, terms, config)
            parts.append(_hindsight(recorded, record, attempts, *own))
        built.append(Transitions(*map(np.concatenate, zip(*parts, strict=True))))
    return built


def penalised(record: LevelRecord, config: Config) -> np.ndarray:
    """bool [H, N]: attempts of a subgoal level that failed their test (Section 3.2).

    An attempt that was cut short does not show that its subgoal was out of reach.
    """
    failed = record.outcome == Outcome.MISSED
    if config.penalise_cut_short:
        failed = failed | (record.outcome == Outcome.CUT_SHORT)
    return failed & record.tested


def _attempts(
    recorded: Round, record: LevelRecord, level: int, config: Config, space: GoalSpace
) -> _Attempts:
    env, time = np.nonzero(record.done.T)
    action = record.output[time, env]
    if level and config.hindsight_actions:
        hit = record.outcome[time, env] == Outcome.ACHIEVED
        achieved = space.normalise(recorded.achieved_subgoal[time + 1, env])
        action = np.where(hit[:, None], action, achieved)
    return _Attempts(
        env=env,
        time=time,
        start=record.start[time, env],
        action=action,
        goal=record.goal[time, env],
        reached=record.reached[time, env],
        failed=record.failed[time, env],
    )


def _regular(recorded: Round, attempts: _Attempts, terms: _Terms) -> Transitions:
    """Did the attempt, as achieved, achieve the level's goal?"""
    return _transitions(recorded, attempts, REGULAR, attempts.goal, attempts.reached, terms)


def _transitions(
    recorded: Round,
    attempts: _Attempts,
    kind: int,
    goal: np.ndarray,
    reached: np.ndarray,
    terms: _Terms,
) -> Transitions:
    """The reward is 0 (and the discount 0) where the goal is achieved, else -1.

    After a failure the discount is 0 too. A reward of -1 would then make failing better than going
    on, so the reward is -T_i, the worst of T_i attempts, as for a penalty.
    """
    missed = np.where(attempts.failed, -float(terms.attempts), -1.0)
    return Transitions(
        env=attempts.env,
        kind=np.full(len(attempts.env), kind),
        observation=recorded.observation[attempts.start, attempts.env],
        action=attempts.action,
        reward=np.where(reached, 0.0, missed),
        next_observation=recorded.observation[attempts.time + 1, attempts.env],
        goal=goal,
        discount=np.where(reached | attempts.failed, 0.0, terms.discount),
    )


def _penalties(
    recorded: Round, record: LevelRecord, attempts: _Attempts, terms: _Terms, config: Config
) -> Transitions:
    """The proposed subgoal itself, with reward -T_i and discount 0, where it failed its test."""
    failed = penalised(record, config)[attempts.time, attempts.env]
    failures = _Attempts(*(field[failed] for field in attempts))
    failures = failures._replace(action=record.output[failures.time, failures.env])
    final = np.ones(len(failures.env), bool)
    penalties = _transitions(recorded, failures, PENALTY, failures.goal, final, terms)
    return penalties._replace(reward=np.full(len(failures.env), -float(terms.attempts)))


def _hindsight(
    recorded: Round,
    record: LevelRecord,
    attempts: _Attempts,
    achieved: np.ndarray,
    space: GoalSpace,
    draws: np.ndarray,
    terms: _Terms,
    config: Config,
) -> Transitions:
    """Copies of each segment under goals that were achieved within it."""
    ends = np.flatnonzero(record.segment_end[attempts.time, attempts.env])
    first = _segment_starts(ends, attempts.env)
    by_transition = config.hindsight_relabels == "future"
    find = _copies_of_each if by_transition else _copies_of_segments
    at, start, picked = find(attempts, first, ends, draws, config)
    goal = achieved[attempts.time[picked] + 1, attempts.env[picked]]
    if config.drop_held_hindsight:
        before = achieved[attempts.start[start], attempts.env[start]]
        new = ~space.achieved(before, goal)
        at, goal = at[new], goal[new]
    copies = _Attempts(*(field[at] for field in attempts))
    reached = space.achieved(achieved[copies.time + 1, copies.env], goal) & ~copies.failed
    return _transitions(recorded, copies, HINDSIGHT, goal, reached, terms)


_Copies = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Indices of attempts, one a copy: the copied one, its segment's first, the picked one."""


def _copies_of_segments(
    attempts: _Attempts, first: np.ndarray, ends: np.ndarray, draws: np.ndarray, config: Config
) -> _Copies:
    """K picks for each segment (Section 3.3): a picked state's goal relabels many transitions.

    Worked example: attempts of a segment at positions 0..4 (length 5), draws .3 and .7: picks 1
    and 3; copies are made of positions 0..1 under the goal achieved at 1, and of 0..3 under the
    goal achieved at 3.
    """
    picks = _picks(draws[attempts.env[ends], attempts.time[ends]], ends - first + 1, config)
    segment, column = np.nonzero(_first_of_each(picks))
    start, picked = first[segment], first[segment] + picks[segment, column]
    until = picked if config.hindsight_relabels == "preceding" else ends[segment]
    at, of = _ranges(start, until + 1)
    return at, start[of], picked[of]


def _copies_of_each(
    attempts: _Attempts, first: np.ndarray, ends: np.ndarray, draws: np.ndarray, config: Config
) -> _Copies:
    """K picks for each transition, from what came at or after it in its segment (HER's `future`).

    Worked example: a segment at positions 0..4, the transition at 2, draws .1 and .7: 3 positions
    are left, so the picks are 2 and 4.
    """
    at, of = _ranges(first, ends + 1)
    chance = draws[attempts.env[at], attempts.time[at]]  # [transitions, K]
    ahead = np.floor(chance * (ends[of] - at + 1)[:, None]).astype(np.int64)
    repeated = np.repeat(at, config.hindsight_goals)
    return repeated, np.repeat(first[of], config.hindsight_goals), repeated + ahead.ravel()


def _segment_starts(ends: np.ndarray, env: np.ndarray) -> np.ndarray:
    """Index of the first attempt of each segment that ends at `ends`.

    A segment begins after the previous one of its environment; attempts left open by a divergence
    are the last of theirs, and belong to none.
    """
    starts_of_env = np.searchsorted(env, env[ends])
    previous = np.concatenate([[-1], ends[:-1]]) if len(ends) else ends
    return np.maximum(starts_of_env, previous + 1)


def _picks(draws: np.ndarray, length: np.ndarray, config: Config) -> np.ndarray:
    """Positions within segments [segments, K]."""
    picks = np.floor(draws * length[:, None]).astype(np.int64)
    if config.hindsight_pick_last:
        picks[:, -1] = length - 1
    return picks


def _first_of_each(picks: np.ndarray) -> np.ndarray:
    """bool [segments, K]: False where an earlier column holds the same pick."""
    same = picks[:, :, None] == picks[:, None, :]
    return ~np.tril(same, k=-1).any(axis=2)


def _ranges(first: np.ndarray, stop: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Concatenated ranges first[k]..stop[k]-1, and the k each index came from."""
    lengths = stop - first
    of = np.repeat(np.arange(len(first)), lengths)
    offsets = np.concatenate([[0], np.cumsum(lengths)[:-1]]) if len(first) else lengths
    return np.arange(len(of)) - offsets[of] + first[of], of
