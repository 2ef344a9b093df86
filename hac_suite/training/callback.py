"""Callbacks of a training, and the progress that it reports to them."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

from hac_suite.state import SeedState


class Progress(NamedTuple):
    """Where a training stands after a round of episodes."""

    train_episodes: int  # per seed
    success_rate: float  # of the last test period, mean over seeds


class Boundary(NamedTuple):
    """A moment between rounds, at which a training can be saved to resume later."""

    train_episodes: int  # per seed
    tested: bool  # a test period has just ended, and its result been taken
    states: Callable[[], Iterator[SeedState]]  # of each seed, to be used before this returns
    last: bool = False  # the training ends here; from its states a longer one can go on


class LostSeed(NamedTuple):
    """A seed that has stopped: a weight of its networks, or what it saw, is not a number."""

    seed: int
    level: int  # the lowest with such a number
    updates: int  # of that level, when it was found
    train_episodes: int

    def __str__(self) -> str:
        return (
            f"a weight or a transition of level {self.level} was not finite after "
            f"{self.updates} updates "
            f"({self.train_episodes} training episodes)"
        )


class Callback:
    """Called by `train` between rounds. Subclass it; the methods here do nothing.

        class Printing(hac_suite.Callback):
            def on_progress(self, progress):
                print(progress.train_episodes, progress.success_rate)

        for result in hac_suite.train(..., callback=Printing()):
            ...

    An exception in a method ends the training.
    """

    def on_progress(self, progress: Progress) -> None:
        """After each round of episodes and updates."""

    def on_boundary(self, boundary: Boundary) -> None:
        """After each round, and after each test period once its result is consumed."""

    def on_lost(self, lost: LostSeed) -> None:
        """When a seed stops because a weight or a transition is not finite."""
