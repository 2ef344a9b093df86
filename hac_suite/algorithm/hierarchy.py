"""The level state machine: Algorithm 1 over N environments in lock step, by masks.

Level 0 acts; level i > 0 proposes subgoals for level i - 1. Nothing here learns: it records
episodes, and `transitions` turns the record into what the replay buffers hold.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from hac_suite.algorithm import exploration
from hac_suite.algorithm.record import BY_EPISODE, Outcome, Round
from hac_suite.config import Config
from hac_suite.types import Actor, EnvStep, Spaces, VectorEnv, failed


class StepView(NamedTuple):
    """What `on_step` receives, before step 0 and after every step.

    The lists hold live arrays, which the next step overwrites: copy what you keep.
    """

    step: int
    active: np.ndarray  # bool [N]
    subgoals: list[np.ndarray]  # per level below the top [N, H]: what that level pursues
    attempts: list[np.ndarray]  # per level int [N]: attempts made at the current goal
    outcomes: list[np.ndarray]  # per level below the top int [N]: the Outcome of what it pursues
    cut_by: list[np.ndarray]  # likewise: the level whose goal cut it short, or BY_EPISODE
    env_step: EnvStep


class Hierarchy:
    """Levels' goals, attempts and tests of N environments within one round.

    `run` steps the environments itself. A caller that steps them elsewhere calls what `run` calls:
    `begin`, then `choose` and `follow` alternately.
    """

    def __init__(
        self,
        spaces: Spaces,
        num_envs: int,
        actors: Sequence[Actor],
        config: Config,
        horizons: tuple[int, ...],
        draws: exploration.Draws | None,
    ):
        """`draws` None means a test period: no noise, no subgoal tests, nothing recorded."""
        if len(actors) != len(horizons):
            raise ValueError(f"{len(actors)} actors for {len(horizons)} horizons.")
        self._actors, self._config = actors, config
        self._horizons, self._draws = horizons, draws
        self._top = len(horizons) - 1
        self._held_to_attempts = draws is not None or not config.test_until_horizon
        n, levels = num_envs, range(len(horizons))
        sub = spaces.subgoal_space
        self._centre = (np.asarray(spaces.action_high) + spaces.action_low) / 2
        self._half_range = (np.asarray(spaces.action_high) - spaces.action_low) / 2
        widths = [len(self._centre)] + [sub.dim] * self._top
        self._spaces = [sub] * self._top + [spaces.goal_space]
        self.goal = [np.zeros((n, space.dim)) for space in self._spaces]
        self.attempts = [np.zeros(n, np.int64) for _ in levels]
        self._output = [np.zeros((n, width)) for width in widths]
        self._start = [np.zeros(n, np.int64) for _ in levels]
        self._tested = [np.zeros(n, bool) for _ in levels]
        self._outcome = [np.zeros(n, np.int8) for _ in levels]  # of what each level proposed
        self._cut_by = [np.full(n, BY_EPISODE) for _ in levels]
        self._must_propose = [np.ones(n, bool) for _ in levels]
        self._active = np.ones(n, bool)

    def run(
        self,
        env: VectorEnv,
        episode_seeds: np.ndarray,
        *,
        test: bool = False,
        on_step: Callable[[StepView], None] | None = None,
    ) -> Round:
        """Runs an episode in every environment (Algorithm 1, its innermost loops)."""
        max_steps = env.max_steps
        state = env.reset(episode_seeds, test=test)
        self.begin(state, max_steps)
        for time in range(max_steps):
            actions = self.choose(state.observation, time)
            if on_step and time == 0:
                on_step(self.view(0, state))
            state = env.step(actions, self._active)
            self.follow(time, state, last=time + 1 == max_steps)
            if on_step:
                on_step(self.view(time + 1, state))
            if not self._active.any():
                break
        return self._round

    def begin(self, state: EnvStep, max_steps: int) -> None:
        """Takes the end goals of episodes of at most `max_steps` steps that begin in `state`."""
        self.goal[self._top] = state.desired_goal.copy()
        self._active = ~state.diverged
        recorded = 0 if self._draws is None else max_steps
        self._round = Round.empty(recorded, state, self._output, self.goal)

    def choose(self, observation: np.ndarray, time: int) -> np.ndarray:
        """The actions [N, A] in natural units after `time` earlier ones, given what is observed."""
        self._propose(observation, time)
        self._act(observation, time)
        return self._centre + self._half_range * self._output[0]

    def follow(self, time: int, state: EnvStep, *, last: bool) -> None:
        """Processes the state after the actions of `time`; `last`: `max_steps` is reached.

        An end goal that has moved is pursued and tested at its new place.
        """
        self.goal[self._top][self._active] = state.desired_goal[self._active]
        reached = self._reached(state)
        self._count(reached[self._top], state)
        self._finish(time, state, reached, last)

    @property
    def succeeded(self) -> np.ndarray:
        """bool [N]: the end goal has been achieved in this episode."""
        return self._round.success

    def _count(self, succeeded: np.ndarray, state: EnvStep) -> None:
        outcome = self._round
        outcome.steps[self._active] += 1
        outcome.diverged[:] = state.diverged
        outcome.success[:] = (outcome.success | succeeded) & ~outcome.diverged

    def _propose(self, observation: np.ndarray, time: int) -> None:
        """Levels whose attempt is over propose the next subgoal, from the top down."""
        inherited = np.zeros(len(observation), bool)
        for level in range(self._top, 0, -1):
            needed = self._must_propose[level] & self._active
            if needed.any():
                self._propose_at(level, needed, observation, inherited, time)
            inherited = self._tested[level]

    def _propose_at(
        self,
        level: int,
        needed: np.ndarray,
        observation: np.ndarray,
        inherited: np.ndarray,
        time: int,
    ) -> None:
        output = self._actors[level](observation, self.goal[level]).astype(np.float64)
        tested = inherited
        if self._draws is not None:
            if level == self._top or self._config.test_draw == "each_level":
                rate = self._config.subgoal_test_rate
                tested = inherited | (self._draws.test[level][:, time] < rate)
            quiet = tested if self._config.tested_subgoal_noise_free else inherited
            noisy = exploration.explore(output, self._draws, level, time, self._config)
            output = np.where(quiet[:, None], output, noisy)
        self._output[level][needed] = output[needed]
        self._tested[level] = np.where(needed, tested, self._tested[level])
        self._start[level][needed] = time
        self.goal[level - 1][needed] = self._spaces[level - 1].denormalise(output[needed])
        self.attempts[level - 1][needed] = 0
        self._must_propose[level][needed] = False
        self._must_propose[level - 1][needed] = True

    def _act(self, observation: np.ndarray, time: int) -> None:
        output = self._actors[0](observation, self.goal[0]).astype(np.float64)
        if self._draws is not None:
            # No level is above the flat agent's, so nothing of its is ever under test.
            quiet = self._tested[1] if self._top else np.zeros(len(output), bool)
            noisy = exploration.explore(output, self._draws, 0, time, self._config)
            output = np.where(quiet[:, None], output, noisy)
        self._output[0] = output
        self._start[0][:] = time

    def _reached(self, state: EnvStep) -> list[np.ndarray]:
        """Per level bool [N]: the goal it pursues holds now, in an environment still running."""
        running = self._active & ~state.diverged & ~failed(state)
        return [
            space.achieved(self._achieved(level, state), goal) & running
            for level, (space, goal) in enumerate(zip(self._spaces, self.goal, strict=True))
        ]

    def _achieved(self, level: int, state: EnvStep) -> np.ndarray:
        return state.achieved_goal if level == self._top else state.achieved_subgoal

    def _finish(self, time: int, state: EnvStep, reached: list[np.ndarray], last: bool) -> None:
        """Completes attempts and segments, from the bottom up, and ends episodes."""
        completed = self._active & ~state.diverged
        lost = completed & failed(state)
        reached_here_or_above = list(np.logical_or.accumulate(reached[::-1]))[::-1]
        exhausted = np.zeros_like(completed)
        for level in range(self._top + 1):
            self.attempts[level] += completed
            used_all = completed & (self.attempts[level] >= self._horizons[level])
            gives_up = used_all if self._held_to_attempts or level < self._top else last & used_all
            ends = completed & (reached_here_or_above[level] | gives_up | lost | last)
            if level:
                self._judge(level, completed, exhausted, reached, state)
            if self._draws is not None:
                self._round.levels[level].write(
                    time,
                    done=completed,
                    start=self._start[level],
                    output=self._output[level],
                    goal=self.goal[level],
                    reached=reached[level],
                    outcome=self._outcome[level],
                    tested=self._tested[level],
                    segment_end=ends,
                    failed=lost,
                )
            # A last attempt that was cut short leaves open what it would have come to.
            exhausted = used_all & (self._outcome[level] != Outcome.CUT_SHORT)
            self._must_propose[level] = completed
            completed = ends
        self._end_episodes(state, reached[self._top], gives_up, last)
        if self._draws is not None:
            self._round.write_state(time + 1, state)

    def _judge(
        self,
        level: int,
        completed: np.ndarray,
        exhausted: np.ndarray,
        reached: list[np.ndarray],
        state: EnvStep,
    ) -> None:
        """Outcomes of the subgoals that `level` proposed, and which level cut them short."""
        outcome = np.where(exhausted, Outcome.MISSED, Outcome.CUT_SHORT)
        outcome = np.where(reached[level - 1], Outcome.ACHIEVED, outcome)
        lost = self._active & state.diverged
        self._outcome[level][:] = np.where(
            completed, outcome, np.where(lost, Outcome.CUT_SHORT, Outcome.OPEN)
        )
        if self._draws is None:
            for each in (Outcome.ACHIEVED, Outcome.MISSED, Outcome.CUT_SHORT):
                self._round.outcomes[level, :, each] += self._outcome[level] == each
        self._cut_by[level][:] = BY_EPISODE
        for above in range(self._top, level - 1, -1):  # the lowest of them decides
            self._cut_by[level][reached[above]] = above

    def _end_episodes(
        self, state: EnvStep, succeeded: np.ndarray, gives_up: np.ndarray, last: bool
    ) -> None:
        over = state.diverged | failed(state) | gives_up | last
        if self._config.continue_after_goal and self._draws is not None:
            over = np.where(succeeded, last, over)
            self.attempts[self._top][succeeded] = 0
        else:
            over = over | succeeded
        self._active = self._active & ~over

    def view(self, step: int, state: EnvStep) -> StepView:
        """What `on_step` receives after `step` actions, which led to `state`."""
        return StepView(
            step=step,
            active=self._active,
            subgoals=self.goal[: self._top],
            attempts=self.attempts,
            outcomes=self._outcome[1:],
            cut_by=self._cut_by[1:],
            env_step=state,
        )


def collect(
    env: VectorEnv,
    actors: Sequence[Actor],
    config: Config,
    horizons: tuple[int, ...],
    draws: exploration.Draws | None,
    episode_seeds: np.ndarray,
    *,
    test: bool = False,
    on_step: Callable[[StepView], None] | None = None,
) -> Round:
    """Runs one episode in every environment.

    Args:
        env: N environments.
        actors: one per level, lowest first; natural observations and goals to outputs in [-1, 1].
        horizons: (T_0, ..., T_n).
        draws: the round's noise and tests; None for a test period, which is noise-free and keeps
            no record.
        episode_seeds: int [N].
        test: whether episodes start from the test distribution.
        on_step: called before the first action and after each one.
    """
    hierarchy = Hierarchy(env, env.num_envs, actors, config, horizons, draws)
    return hierarchy.run(env, episode_seeds, test=test, on_step=on_step)
