"""Warnings from episodes: properties of a task that keep an agent from learning."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from tasks.task_spec import TaskSpec
from tasks.worlds.estimates import About, Played, carried
from tasks.worlds.settings import Settings

_SOME = 0.05  # a share above which it is said
_GOALS = 64  # end goals that states are held against
_NEAR = 10  # thresholds

_HELD = (
    "{share:.0%} of episodes begin at their goal, so success says little; move starts and goals "
    "apart, or make the threshold smaller"
)
_NO_OVERLAP = (
    "no episode comes near any end goal (within ten thresholds), so hindsight teaches nothing "
    "about end goals; begin some training episodes near goals, or move goals to where episodes "
    "reach"
)
_NOT_REACHED = (
    "end goals range from {low:.3g} to {high:.3g} in {name}, but episodes reached only "
    "{least:.3g} to {most:.3g}: {share:.0%} of it"
)
_STILL = (
    "the achieved goal did not change in {share:.0%} of episodes, so a subgoal in that space does "
    "not tell the agent what to do; add what the agent moves itself to the subgoal space{how}"
)
_FAILED = "{share:.0%} of random episodes end in failure, after {steps:.0f} steps (median)"
_CUT = "{share:.0%} of episodes diverge or are cut short by the environment"
_STANDING = (
    "the subgoal threshold in {name} is {threshold:.3g}, but T_0 = {steps} steps change it by "
    "only {far:.3g}: standing still would achieve subgoals"
)
_TOO_FINE = (
    "one step changes {name} by {one:.3g}, but the subgoal threshold is {threshold:.3g}: steps "
    "would jump over subgoals"
)
_SCALE = (
    "observation {name} is divided by {scale:.3g}, but episodes suggest {found:.3g}: a factor of "
    "{ratio:.0f}"
)
_EASY = (
    "{share:.0%} of random episodes succeed: there is little to learn; make the threshold smaller, "
    "or move goals farther away"
)
_OTHER_THRESHOLD = (
    "the subgoal threshold in {name} is {threshold:.3g}, but episodes suggest {found:.3g}: a "
    "factor of {ratio:.0f}"
)
_ANYWHERE = (
    "every subgoal threshold is at least half the range of subgoals, so nearly every subgoal is "
    "achieved at once"
)


class Shares(NamedTuple):
    """Shares of episodes."""

    succeeded: float
    held_at_start: float
    failed: float
    cut: float


def shares(played: Played) -> Shares:
    """How many of the episodes succeeded, began at the goal, failed, or were cut short."""
    return Shares(*(float(flag.mean()) for flag in (played.success, played.held, played.failed,
                                                    played.cut)))  # fmt: skip


def warnings(
    about: About, random: Played, everything: Played, settings: Settings, own: TaskSpec | None
) -> Iterator[str]:
    """A line for each thing that will make learning slow or impossible.

    Args:
      random: episodes of random actions.
      everything: these, and those of an agent that has learnt a little.
      own: spaces chosen by hand for the task, to compare with the episodes.
    """
    found = shares(random)
    if found.held_at_start > _SOME:
        yield _HELD.format(share=found.held_at_start)
    if found.succeeded > 0.5:
        yield _EASY.format(share=found.succeeded)
    if found.failed > _SOME:
        steps = float(np.median(random.steps[random.failed]))
        yield _FAILED.format(share=found.failed, steps=steps)
    cut = (random.cut & (random.steps + 1 < settings.max_steps)).mean()
    if cut > _SOME:
        yield _CUT.format(share=cut)
    if not overlap(about, everything, settings):
        yield _NO_OVERLAP
    yield from _unreached(about, everything, settings)
    yield from _still(about, everything)
    yield from _subgoals(about, everything, settings)
    if own is not None:
        yield from _scales(own, settings)
        yield from _thresholds(own, settings)


def of_settings(settings: Settings) -> Iterator[str]:
    """The same of numbers that somebody may have edited, without an episode."""
    width = np.subtract(settings.subgoal_high, settings.subgoal_low)
    if (np.array(settings.subgoal_threshold) >= width / 2).all():
        yield _ANYWHERE


def overlap(about: About, played: Played, settings: Settings) -> bool:
    """Whether some state of some episode comes near some end goal, to a few thresholds."""
    return nearest(about, played, settings) <= _NEAR


def nearest(about: About, played: Played, settings: Settings) -> float:
    """How near some state of some episode comes to some end goal, in thresholds."""
    reached = played.achieved_goal[played.alive()]
    asked = played.asked[-_GOALS:] if about.fixed_goal is None else about.fixed_goal[None]
    away = np.abs(reached[:, None] - asked[None]) / np.array(settings.goal_threshold)
    return float(away.max(axis=-1).min())


def _unreached(about: About, played: Played, settings: Settings) -> Iterator[str]:
    """Dimensions of the goal space in which less than half of what is asked for was reached."""
    reached = played.achieved_goal[played.alive()]
    least, most = reached.min(axis=0), reached.max(axis=0)
    for i, name in enumerate(about.goal_names):
        low, high = settings.goal_low[i], settings.goal_high[i]
        if settings.goal_threshold[i] >= high - low:
            continue  # every place there will do
        share = (min(high, most[i]) - max(low, least[i])) / (high - low)
        if share < 0.5:
            yield _NOT_REACHED.format(
                name=name, low=low, high=high, least=least[i], most=most[i], share=max(0.0, share)
            )


def _still(about: About, played: Played) -> Iterator[str]:
    """Achieved goals that hardly ever move, as those of things that must first be touched."""
    moved = np.ptp(played.achieved_goal, axis=0)  # [E, G]
    width = np.ptp(played.achieved_goal, axis=(0, 1))
    still = (moved <= 0.02 * width).all(axis=1).mean()
    alike = np.array_equal(played.achieved_goal, played.achieved_subgoal)
    if still > 0.5 and alike:
        how = ", as in --subgoal=obs[0:6]" if about.goal_names[0].startswith("goal[") else ""
        yield _STILL.format(share=still, how=how)


def _subgoals(about: About, played: Played, settings: Settings) -> Iterator[str]:
    steps = settings.horizons[1][0] if 1 in settings.horizons else 1
    far, one = carried(played, steps, 0.75), carried(played, 1, 0.75)
    for i, name in enumerate(about.subgoal_names):
        threshold = settings.subgoal_threshold[i]
        width = settings.subgoal_high[i] - settings.subgoal_low[i]
        if threshold > far[i] > 0.05 * width:
            yield _STANDING.format(name=name, threshold=threshold, steps=steps, far=far[i])
        if threshold < 0.25 * one[i]:
            yield _TOO_FINE.format(name=name, threshold=threshold, one=one[i])


def _scales(own: TaskSpec, settings: Settings) -> Iterator[str]:
    """Numbers of the observation whose scale is ten times off, or that lie far from the offset."""
    offset = 0.0 if own.observation_offset is None else own.observation_offset
    largest = np.abs(np.subtract(settings.observation_offset, offset)) + settings.observation_scale
    for name, scale, found in zip(
        own.observation_names, own.observation_scale, largest, strict=True
    ):
        ratio = max(scale / found, found / scale)
        if ratio >= 10:
            yield _SCALE.format(name=name, scale=scale, found=found, ratio=ratio)


def _thresholds(own: TaskSpec, settings: Settings) -> Iterator[str]:
    """Subgoal thresholds that are ten times off."""
    space = own.subgoal_space
    for name, near, found in zip(
        space.names, space.threshold, settings.subgoal_threshold, strict=True
    ):
        ratio = max(near / found, found / near)
        if ratio >= 10:
            yield _OTHER_THRESHOLD.format(name=name, threshold=near, found=found, ratio=ratio)
