"""Scales, bounds, thresholds and T estimated from episodes that were played."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from tasks.worlds import judging
from tasks.worlds.settings import Settings

EPISODES = 32
_COPIES = 4
_MORE_GOALS = 16  # resets of all copies from either kind of start, for their end goals
_MOST_STEPS = 20_000
_HOLDS = (1, 3, 10, 30)  # steps for which an episode keeps an action
_TAIL = 0.005  # share of what was seen that may lie beyond each bound
_WIDER = 0.1  # bounds are wider than what was seen, by this share on each side
_CENTRED = 0.2  # an offset below this share of the range is none
_LEAST_SCALE = 1e-3
_FARTHEST = 10.0  # no number that was seen comes out beyond it
_LAYERS = (1, 2)
_TIMES = ("observation", "achieved_goal", "achieved_subgoal")  # fields of Played by time


class About(NamedTuple):
    """What is known of a task without playing it."""

    title: str
    max_steps: int
    control_timestep: float
    action_low: np.ndarray  # [A]
    action_high: np.ndarray  # [A]
    goal_names: tuple[str, ...]
    subgoal_names: tuple[str, ...]
    judge: judging.Judge
    fixed_goal: np.ndarray | None = None  # [G] the only end goal there is
    draws_goals: bool = True  # episodes say their end goals; else they are points once reached
    threshold: np.ndarray | None = None  # [G] what achieves end goals, where somebody said it


class Played(NamedTuple):
    """E episodes of at most T steps, by time; entries after an episode's end are its last ones."""

    observation: np.ndarray  # [T + 1, E, D]
    achieved_goal: np.ndarray  # [T + 1, E, G]
    achieved_subgoal: np.ndarray  # [T + 1, E, H]
    asked: np.ndarray  # [K, G] end goals that episodes began with, also such as were not played
    steps: np.ndarray  # int [E]
    success: np.ndarray  # bool [E]: the end goal was achieved after a step
    held: np.ndarray  # bool [E]: it was achieved at the start
    failed: np.ndarray  # bool [E]: the environment ended the episode in failure
    cut: np.ndarray  # bool [E]: it diverged, or the environment cut it short
    test: np.ndarray  # bool [E]: it began from a test start

    def alive(self) -> np.ndarray:
        """bool [T + 1, E]: the entries within episodes."""
        return np.arange(len(self.observation))[:, None] <= self.steps


Ends = tuple[np.ndarray, np.ndarray]


class Observed(NamedTuple):
    """Of the numbers of an observation that are an achieved goal's; NaN for others: [D] each."""

    low: np.ndarray  # where end goals are
    high: np.ndarray
    width: np.ndarray  # half the width of an end goal: less does not matter


Act = Callable[[int, Any], np.ndarray]  # time, what the environments show -> actions [N, A]


def random_actions(about: About, num_envs: int, seed: int) -> Act:
    """Uniform actions; each environment keeps one for so many steps as its place says.

    Not for more than a twentieth of an episode: what pushes one way all the time sees only walls.
    """
    rng = np.random.default_rng(seed)
    holds = np.resize(np.minimum(_HOLDS, max(1, about.max_steps // 20)), num_envs)
    low, high = about.action_low, about.action_high
    actions = np.zeros((num_envs, len(low)))

    def act(time: int, state: Any) -> np.ndarray:
        del state
        due = time % holds == 0
        drawn = rng.uniform(low, high, actions.shape)
        actions[due] = drawn[due]
        return actions.copy()

    return act


def play(env: Any, judge: judging.Judge, act: Act, seeds: np.ndarray, *, test: bool) -> Played:
    """One episode in each environment, to the goal if it comes to that."""
    state, max_steps = env.reset(seeds, test=test), env.max_steps
    shown = [state]
    goal = state.desired_goal.copy()
    held = judge(state.achieved_goal, goal)
    running = ~state.diverged
    steps, success = np.zeros(len(seeds), np.int64), np.zeros(len(seeds), bool)
    failed, cut = np.zeros(len(seeds), bool), state.diverged.copy()
    for time in range(max_steps):
        if not running.any():
            break
        state = env.step(act(time, state), running)
        shown.append(state)
        lost = getattr(state, "failed", np.zeros(len(seeds), bool))
        steps += running & ~state.diverged
        success |= running & ~state.diverged & judge(state.achieved_goal, state.desired_goal)
        failed |= running & lost
        cut |= running & state.diverged
        running &= ~state.diverged & ~lost & ~success
    shown += [state] * (max_steps + 1 - len(shown))
    return Played(
        **{field: np.stack([getattr(each, field) for each in shown]) for field in _TIMES},
        asked=goal,
        steps=steps,
        success=success,
        held=held,
        failed=failed,
        cut=cut,
        test=np.full(len(seeds), test),
    )


def joined(parts: Sequence[Played]) -> Played:
    """All the episodes of several parts; the shorter ones stay where they end."""
    longest = max(len(part.observation) for part in parts)
    fields: dict[str, np.ndarray] = {}
    for name in Played._fields:
        found = [getattr(part, name) for part in parts]
        if name in _TIMES:
            fields[name] = np.concatenate([_as_long(own, longest) for own in found], axis=1)
        else:
            fields[name] = np.concatenate(found)
    return Played(**fields)


def _as_long(entries: np.ndarray, longest: int) -> np.ndarray:
    """Entries by time, the last one repeated until there are so many."""
    return np.pad(entries, [(0, longest - len(entries)), (0, 0), (0, 0)], mode="edge")


def random_episodes(
    env_of: Callable[[int], Any], about: About, episodes: int = EPISODES, seed: int = 0
) -> Played:
    """Random episodes from training and test starts by turns; the seed decides them.

    They are fewer where they are long.
    """
    most = max(8, _MOST_STEPS // about.max_steps)
    rounds = max(2, min(episodes, most) // _COPIES)
    env, parts = env_of(_COPIES), []
    judge = about.judge if about.draws_goals else _no_goals
    rng = np.random.default_rng(seed)
    for test in (False, True) * (rounds // 2):
        act = random_actions(about, _COPIES, int(rng.integers(2**32)))
        seeds = rng.integers(2**32, size=_COPIES)
        parts.append(play(env, judge, act, seeds, test=test))
    asked = [
        env.reset(rng.integers(2**32, size=_COPIES), test=test).desired_goal
        for test in (False, True) * _MORE_GOALS
    ]
    played = joined(parts)
    if not about.draws_goals:
        return _given_goals(about, played, rng)
    return played._replace(asked=np.concatenate([played.asked, *asked]))


def _no_goals(achieved: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """The judge where it is not known yet where end goals may be."""
    del goal
    return np.zeros(achieved.shape[:-1], bool)


def reached(played: Played, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Points [K, G] of the goal space, within bounds, that episodes came to."""
    points = played.achieved_goal[1:][played.alive()[1:]]
    return points[((low <= points) & (points <= high)).all(axis=-1)]


def _given_goals(about: About, played: Played, rng: np.random.Generator) -> Played:
    """Episodes played without end goals, as if each had had a point that one of them came to."""
    points = reached(played, *_goal_bounds(about, played))
    goals = rng.choice(points, played.achieved_goal.shape[1])  # [E, G]
    there = about.judge(played.achieved_goal, goals) & played.alive()  # [T + 1, E]
    return played._replace(asked=goals, held=there[0], success=there[1:].any(axis=0))


def settings(about: About, played: Played) -> Settings:
    """What a task needs to be trained on, from episodes that were played on it."""
    max_steps = _max_steps(about, played)
    low, high = _goal_bounds(about, played)
    shared = _shared(played)
    sub_low, sub_high = _subgoal_bounds(about, played, shared)
    width = sub_high - sub_low
    horizons = {layers: attempts(played, max_steps, layers, width) for layers in _LAYERS}
    farthest = np.full(len(low), _FARTHEST * (high - low).max())
    if about.threshold is None:
        goal_widths = judging.half_widths(about.judge, _some(about, played), farthest)
        goal_widths = np.maximum(goal_widths, 1e-4 * (high - low))
    else:
        goal_widths = about.threshold
    observed = _observed_goals(about, played, goal_widths)
    offset, scale = scales(played.observation[played.alive()], observed)
    near = subgoal_threshold(
        played, horizons[1][0], width, np.where(shared >= 0, goal_widths[shared], np.nan)
    )
    return Settings(
        max_steps=max_steps,
        observation_offset=_list(offset),
        observation_scale=_list(scale),
        goal_low=_list(low),
        goal_high=_list(high),
        goal_threshold=_list(goal_widths),
        subgoal_low=_list(sub_low),
        subgoal_high=_list(sub_high),
        subgoal_threshold=_list(near),
        horizons=horizons,
    )


def scales(observation: np.ndarray, goals: Observed | None = None) -> Ends:
    """What to subtract from observations [K, D], and to divide by, to come out about [-1, 1].

    Numbers that lie about 0 keep it: their offset is 0. One that stood still comes out as 0, and
    keeps its unit, for it may move after all.

    Args:
      goals: what is known of numbers that are also the achieved goal's.
    """
    low, high = np.quantile(observation, [_TAIL, 1 - _TAIL], axis=0)
    if goals is not None:
        low, high = np.fmin(low, goals.low), np.fmax(high, goals.high)
    middle, half = (low + high) / 2, (high - low) / 2
    largest = np.maximum(np.abs(low), np.abs(high))
    off_centre = np.abs(middle) > _CENTRED * half
    offset = _rounded(np.where(off_centre, middle, 0.0))
    scale = np.where(off_centre, half, largest) * (1 + _WIDER)
    # What is seldom seen, such as a touch, is beyond the ends, but not far beyond.
    scale = np.maximum(scale, np.abs(observation - offset).max(axis=0) / _FARTHEST)
    scale = np.where(np.ptp(observation, axis=0) == 0, 1.0, np.maximum(scale, _LEAST_SCALE))
    if goals is not None:
        scale = np.fmax(scale, goals.width)
    return offset, _rounded(scale, up=True)


def _observed_goals(about: About, played: Played, widths: np.ndarray) -> Observed:
    """For numbers of the observation that are the achieved goal's, where end goals are.

    An agent that learns to go there will see them there.

    Args:
      widths: [G] half the widths of end goals.
    """
    known = Observed(*np.full((3, played.observation.shape[-1]), np.nan))
    for i, asked in enumerate(_asked(about, played).T):
        same = (played.observation == played.achieved_goal[..., i, None]).all(axis=(0, 1))
        known.low[same], known.high[same] = np.quantile(asked, [_TAIL, 1 - _TAIL])
        known.width[same] = widths[i]
    return known


def bounds(*groups: np.ndarray) -> Ends:
    """Bounds of what was seen, groups [K, G]; a little wider, never without width or infinite."""
    each = [np.quantile(group, [_TAIL, 1 - _TAIL], axis=0) for group in groups]
    low, high = (np.stack(ends) for ends in zip(*each, strict=True))
    low, high = low.min(axis=0), high.max(axis=0)
    size = np.maximum(1.0, np.abs(low))
    still = high - low <= 1e-9 * size
    margin = np.maximum(_WIDER * (high - low), np.where(still, 1e-3 * size, 1e-3))
    width = high - low + 2 * margin
    step = 10.0 ** (np.floor(np.log10(width)) - 2)  # three digits of the width
    return np.floor((low - margin) / step) * step, np.ceil((high + margin) / step) * step


def carried(played: Played, steps: int, quantile: float) -> np.ndarray:
    """How far so many steps carry in each dimension of the subgoal space, [H].

    At an episode's best moments (0.9), and of the episodes that quantile: some may stand still.
    """
    steps = min(steps, len(played.observation) - 1)
    there, alive = played.achieved_subgoal, played.alive()[steps:]
    far = np.where(alive[..., None], np.abs(there[steps:] - there[:-steps]), np.nan)
    far = far[:, alive.any(axis=0)]
    if not far.size:
        return np.zeros(there.shape[-1])
    return np.quantile(np.nanquantile(far, 0.9, axis=0), quantile, axis=0)


def attempts(played: Played, max_steps: int, layers: int, width: np.ndarray) -> tuple[int, ...]:
    """T for so many subgoal layers: equal ones, with a longer T_0 where equal ones go nowhere.

    T_0 steps are to carry a twentieth of the subgoal space's width, in what moves most.
    """
    levels = layers + 1
    first = equal = max(1, round(max_steps ** (1 / levels)))
    while (
        first < min(max_steps // 4, 3 * equal)
        and (carried(played, first, 0.5) / width).max() < 0.05
    ):
        first += max(1, first // 8)
    rest = math.ceil(max_steps / first)
    each = max(1, math.ceil(rest ** (1 / layers)))
    if each > 1 and each ** (layers - 1) * (each - 1) >= rest:
        return (first, *(each,) * (layers - 1), each - 1)
    return (first, *(each,) * layers)


def subgoal_threshold(
    played: Played, steps: int, width: np.ndarray, goal_widths: np.ndarray
) -> np.ndarray:
    """How near to a subgoal counts as achieved, [H].

    In dimensions that the goal space has as well, what achieves a goal there; elsewhere a fifth of
    how far T_0 steps carry, within some hundredths of the space. In all of them less than half the
    way of T_0 steps, or standing still would do; and at least half the way of one, or it would be
    jumped over. A dimension in which every place achieves the goal stays one.

    Args:
      goal_widths: [H] half the width of an end goal; NaN in dimensions that are no goal's.
    """
    far, one = carried(played, steps, 0.75), carried(played, 1, 0.75)
    near = np.clip(0.2 * far, 0.025 * width, 0.08 * width)
    near = np.where(np.isnan(goal_widths), near, goal_widths)
    moves = far > 0.05 * width  # what seldom moves says nothing of how far it can
    near = np.where(moves, np.minimum(near, 0.5 * far), near)
    near = np.clip(near, 0.5 * one, width / 4)
    anywhere = goal_widths >= width
    if not anywhere.all():
        near = np.where(anywhere, goal_widths, near)
    return _rounded(near, up=True)


def _asked(about: About, played: Played) -> np.ndarray:
    """End goals [K, G] that are asked for; points reached, where goals are drawn from these."""
    if about.fixed_goal is not None:
        return about.fixed_goal[None]
    return played.asked if about.draws_goals else played.achieved_goal[played.alive()]


def _some(about: About, played: Played) -> np.ndarray:
    """A few end goals, to try what achieves them."""
    return _asked(about, played)[-64:]


def _goal_bounds(about: About, played: Played) -> Ends:
    """Where end goals are asked for; in dimensions in which all are alike, what is reached too."""
    asked = bounds(_asked(about, played))
    both = bounds(_asked(about, played), played.achieved_goal[played.alive()])
    narrow = asked[1] - asked[0] < 0.05 * (both[1] - both[0])
    return np.where(narrow, both[0], asked[0]), np.where(narrow, both[1], asked[1])


def _subgoal_bounds(about: About, played: Played, shared: np.ndarray) -> Ends:
    """Where episodes came, and where end goals are asked for in dimensions that are shared."""
    reached = played.achieved_subgoal[played.alive()]
    asked = _asked(about, played)[:, shared]
    return bounds(reached, np.where(shared >= 0, asked, np.median(reached, axis=0)))


def _shared(played: Played) -> np.ndarray:
    """For each dimension of the subgoal space the same one of the goal space, or -1: int [H]."""
    same = (played.achieved_subgoal[..., None] == played.achieved_goal[..., None, :]).all((0, 1))
    return np.where(same.any(axis=1), same.argmax(axis=1), -1)


def _max_steps(about: About, played: Played) -> int:
    """The limit that is said, or the one at which the environment cuts its episodes short."""
    steps = played.steps[played.cut] + 1
    ended = played.success | played.failed
    own = len(set(steps)) == 1 and (played.cut | ended).all()
    return int(steps[0]) if own and (played.steps[ended] <= steps[0]).all() else about.max_steps


def _rounded(values: np.ndarray, *, up: bool = False) -> np.ndarray:
    """To three digits."""
    step = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(values), 1e-12))) - 2)
    whole = np.ceil(values / step - 1e-6) if up else np.round(values / step)
    return whole * step


def _list(values: np.ndarray) -> tuple[float, ...]:
    # What binary fractions leave behind the digits that count is cut off.
    return tuple(float(f"{value:.6g}") for value in values)
