"""Times the steps of an episode at the chosen speed."""

import numpy as np

from launch.viewing.episode import Ended, Episode

SPEEDS = {"1/10": 0.1, "1/4": 0.25, "1/2": 0.5, "1": 1.0, "2": 2.0, "4": 4.0}
"""Times real time, by what a person chooses."""

_MOST_STEPS = 20  # in a tick: a page that fell behind does not try to catch up
KEPT = 8  # endings of subgoals


class Player:
    """An episode, and whether and how fast it goes on.

    Attributes:
      episode: what is played.
      playing: whether steps become due; none does once the episode is over.
      speed: times real time.
      recent: the latest endings of subgoals, the newest first.
      counts: per level that proposes, how often its subgoals came to each outcome.
    """

    def __init__(self, episode: Episode, control_timestep: float, *, speed: float = 0.5):
        self._timestep = control_timestep
        self.speed = speed
        self.playing = False
        self._due = 0.0
        self.begin(episode)

    def begin(self, episode: Episode) -> None:
        """Takes another episode; nothing of the one before is kept."""
        self.episode = episode
        self.recent: list[Ended] = []
        self.counts: dict[int, dict[int, int]] = {}

    def move_goal(self, goal: np.ndarray) -> None:
        """Asks for another end goal [G], from where things are."""
        self.episode.move_goal(goal)
        self.begin(self.episode)

    def play(self, now: float) -> None:
        """From now on steps become due; `now` is any clock's time in seconds."""
        self.playing, self._due = True, now

    def pause(self) -> None:
        """No step becomes due."""
        self.playing = False

    def step(self) -> None:
        """Takes one step, whether or not it is due."""
        before = self.episode.step
        self.episode.advance()
        if self.episode.step == before:
            return
        for ended in self.episode.ended:
            tally = self.counts.setdefault(ended.level, {})
            tally[ended.outcome] = tally.get(ended.outcome, 0) + 1
        self.recent = [*reversed(self.episode.ended), *self.recent][:KEPT]

    def tick(self, now: float) -> bool:
        """Takes the steps that are due; returns whether there were any."""
        taken = 0
        while self.running and self._due <= now and taken < _MOST_STEPS:
            self.step()
            taken += 1
            self._due += self._timestep / self.speed
        if taken == _MOST_STEPS or self.episode.over:
            self._due = max(self._due, now)
        return taken > 0

    @property
    def running(self) -> bool:
        """Whether a step becomes due."""
        return self.playing and not self.episode.over

    def seconds_to_wait(self, now: float, most: float) -> float:
        """Until the next step is due, at most `most`."""
        return min(most, max(self._due - now, 0.0)) if self.running else most
