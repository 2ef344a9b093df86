"""A test episode that is stepped interactively; its end goal can be moved."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

import hac_suite
from hac_suite.algorithm.hierarchy import Hierarchy
from hac_suite.algorithm.record import BY_EPISODE
from hac_suite.types import level_specs
from launch.asking import settings
from launch.pictures.stage import Watched
from launch.pictures.subgoal_log import WORDS


class Ended(NamedTuple):
    """A subgoal that has just come to its end."""

    step: int
    level: int  # that proposed it
    outcome: hac_suite.Outcome
    why: str  # it was cut short; "" where it was not

    def __str__(self) -> str:
        said = f"level {self.level}'s subgoal: {WORDS[self.outcome]}"
        return f"{said} ({self.why})" if self.why else said


class LevelStatus(NamedTuple):
    """Where a level stands."""

    level: int
    made: int  # attempts at its goal
    allowed: int | None  # T_i; None where tests do not hold it to that
    value: float | None  # Q of what it does now; None: the policy's file has no critic


class Episode:
    """What `hac_suite.run_episodes` plays in one go, one step at a time.

    Attributes:
      step: actions taken since the start, or since the goal was last moved.
      over: whether the goal was achieved, or the steps are used up.
      succeeded: whether the goal was achieved.
      ended: the subgoals that ended with the last step, the lowest level's first.
    """

    def __init__(self, env: Watched, policy: hac_suite.Policy, seed: int):
        """Begins the test episode of a seed; `env` holds one environment."""
        self._env, self._policy = env, policy
        self._config = settings.to_config(policy.metadata["config"])
        self._specs = level_specs(env, policy.horizons)
        self._actors = policy.actors(self._specs)
        self._state = env.reset(np.array([seed]), test=True)
        self._begin()

    def _begin(self) -> None:
        """A hierarchy without any past pursues the goal from the present state."""
        self._hierarchy = Hierarchy(
            self._env, 1, self._actors, self._config, self._policy.horizons, None
        )
        self._hierarchy.begin(self._state, self._env.max_steps)
        self.step, self.over, self.succeeded = 0, bool(self._state.diverged[0]), False
        self.ended: list[Ended] = []
        self._action = self._hierarchy.choose(self._state.observation, 0)
        self._show()

    def _show(self) -> None:
        subgoals: list[np.ndarray | None] = [goal[0] for goal in self._hierarchy.goal[:-1]]
        self._env.show_subgoals(0, [] if self.over else subgoals)

    @property
    def goal(self) -> np.ndarray:
        """The end goal [G]."""
        return self._state.desired_goal[0]

    @property
    def subgoals(self) -> list[np.ndarray]:
        """What each level below the top pursues, [H] each."""
        return [goal[0].copy() for goal in self._hierarchy.goal[:-1]]

    def advance(self) -> None:
        """Takes one action, and lets levels whose attempt is over propose anew."""
        if self.over:
            return
        self._state = self._env.step(self._action)
        self._hierarchy.follow(self.step, self._state, last=self.step + 1 == self._env.max_steps)
        self.step += 1
        seen = self._hierarchy.view(self.step, self._state)
        self.ended = self._ends(seen)
        self.over = not seen.active[0]
        self.succeeded = bool(self._hierarchy.succeeded[0])
        if not self.over:
            self._action = self._hierarchy.choose(self._state.observation, self.step)
        self._show()

    def _ends(self, seen: hac_suite.StepView) -> list[Ended]:
        found = []
        for level, (outcomes, cut_by) in enumerate(zip(seen.outcomes, seen.cut_by, strict=True), 1):
            outcome = hac_suite.Outcome(int(outcomes[0]))
            if outcome != hac_suite.Outcome.OPEN:
                cut = outcome == hac_suite.Outcome.CUT_SHORT
                why = self._by_what(int(cut_by[0])) if cut else ""
                found.append(Ended(self.step, level, outcome, why))
        return found

    def _by_what(self, level: int) -> str:
        if level == BY_EPISODE:
            return "the episode ended"
        top = level == len(self._policy.horizons) - 1
        goal = "the end goal" if top else f"level {level + 1}'s subgoal"
        return f"{goal} was achieved"

    def move_goal(self, goal: Sequence[float] | np.ndarray) -> None:
        """Asks for another end goal [G], within its bounds: a new episode from where things are."""
        space = self._env.goal_space
        self._state = self._env.move_goal(0, np.clip(goal, space.low, space.high))
        self._begin()

    def statuses(self) -> list[LevelStatus]:
        """Per level, the lowest first."""
        top = len(self._policy.horizons) - 1
        values = hac_suite.q_values(
            self._policy,
            self._specs,
            self._config,
            self._state.observation,
            self._hierarchy.goal,
        )
        return [
            LevelStatus(
                level,
                int(self._hierarchy.attempts[level][0]),
                None if level == top and self._config.test_until_horizon else allowed,
                float(values[level][0]) if values else None,
            )
            for level, allowed in enumerate(self._policy.horizons)
        ]
