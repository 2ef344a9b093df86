"""The record of a round of episodes, which `transitions` turns into experience."""

import enum
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hac_suite.types import EnvStep


class Outcome(enum.IntEnum):
    """The outcome of a subgoal that a level proposed (Section 3.2)."""

    OPEN = 0  # it is still pursued
    ACHIEVED = 1
    MISSED = 2  # the level below used all of its T_i attempts, none of them cut short
    CUT_SHORT = 3  # a goal above was achieved, or the episode ended, while attempts were left


BY_EPISODE = -1
"""Who cut an attempt short, where it was no goal: the end of the episode."""


class LevelRecord(NamedTuple):
    """What one level did, by the time [H, N, ...] of the primitive action that completed it.

    Entries count only where `done`.
    """

    done: np.ndarray  # bool: an attempt was completed
    start: np.ndarray  # int: the time its output was chosen
    output: np.ndarray  # [H, N, A]: that output, in [-1, 1]
    goal: np.ndarray  # [H, N, G]: what the level pursued
    reached: np.ndarray  # bool: the level's own goal was achieved
    outcome: np.ndarray  # int: an Outcome, of the proposed subgoal (levels > 0)
    tested: np.ndarray  # bool: it was a subgoal test, its own or a higher level's
    segment_end: np.ndarray  # bool: the level's goal was given up or achieved here
    failed: np.ndarray  # bool: the environment ended the episode here, in failure

    @classmethod
    def empty(cls, max_steps: int, output: np.ndarray, goal: np.ndarray) -> "LevelRecord":
        """Room for `max_steps` steps of a level with outputs [N, A] and goals [N, G]."""

        def flags() -> np.ndarray:
            return np.zeros((max_steps, len(output)), bool)

        return cls(
            done=flags(),
            start=np.zeros((max_steps, len(output)), np.int64),
            output=np.zeros((max_steps, *output.shape)),
            goal=np.zeros((max_steps, *goal.shape)),
            reached=flags(),
            outcome=np.zeros((max_steps, len(output)), np.int8),
            tested=flags(),
            segment_end=flags(),
            failed=flags(),
        )

    def write(self, time: int, **entries: np.ndarray) -> None:
        """Sets the entries of one step."""
        for name, value in entries.items():
            getattr(self, name)[time] = value


class Round(NamedTuple):
    """One episode of each of N environments."""

    observation: np.ndarray  # [steps + 1, N, D]
    achieved_goal: np.ndarray  # [steps + 1, N, G]
    achieved_subgoal: np.ndarray  # [steps + 1, N, H]
    levels: list[LevelRecord]
    success: np.ndarray  # bool [N]: the end goal was achieved
    steps: np.ndarray  # int [N]: primitive actions taken
    diverged: np.ndarray  # bool [N]
    # int [levels, N, 4]: how many of each level's subgoals came to each Outcome; in tests only,
    # where nothing else is recorded.
    outcomes: np.ndarray

    @classmethod
    def empty(
        cls,
        max_steps: int,
        state: EnvStep,
        outputs: Sequence[np.ndarray],
        goals: Sequence[np.ndarray],
    ) -> "Round":
        """Room for `max_steps` steps that begin in `state`; 0 keeps the outcome alone."""
        n = len(state.diverged)
        levels = zip(outputs, goals, strict=True)
        made = cls(
            observation=np.zeros((max_steps + 1, *state.observation.shape)),
            achieved_goal=np.zeros((max_steps + 1, *state.achieved_goal.shape)),
            achieved_subgoal=np.zeros((max_steps + 1, *state.achieved_subgoal.shape)),
            levels=[LevelRecord.empty(max_steps, output, goal) for output, goal in levels],
            success=np.zeros(n, bool),
            steps=np.zeros(n, np.int64),
            diverged=np.zeros(n, bool),
            outcomes=np.zeros((len(goals), n, len(Outcome)), np.int64),
        )
        made.write_state(0, state)
        return made

    def write_state(self, time: int, state: EnvStep) -> None:
        """Records the state after `time` actions."""
        self.observation[time] = state.observation
        self.achieved_goal[time] = state.achieved_goal
        self.achieved_subgoal[time] = state.achieved_subgoal
