"""What a training tells while it runs, and the object that it tells it to."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

from hac_suite.state import SeedState


class Progress(NamedTuple):
    """Where a training stands after a round of episodes."""

    train_episodes: int  # per seed
    success_rate: float  # of the last test period, mean over seeds


class Boundary(NamedTuple):
    """A moment between rounds, at which a training can be saved and gone on with later."""

    train_episodes: int  # per seed
    tested: bool  # a test period has just ended, and its result been taken
    states: Callable[[], Iterator[SeedState]]  # of each seed, to be used before this returns
    last: bool = False  # the training ends here; from its states a longer one can go on


class LostSeed(NamedTuple):
    """A seed that has stopped: a weight of its networks is no longer a number."""

    seed: int
    level: int  # the lowest with such a weight
    updates: int  # of that level, when it was found
    train_episodes: int

    def __str__(self) -> str:
        return (
            f"a weight of level {self.level} was not finite after {self.updates} updates "
            f"({self.train_episodes} training episodes)"
        )


class Callback:
    """What `train` calls between rounds; nothing happens but what a subclass says.

        class Printing(hac_suite.Callback):
            def on_progress(self, progress):
                print(progress.train_episodes, progress.success_rate)

        for result in hac_suite.train(..., callback=Printing()):
            ...

    What a method raises ends the training.
    """

    def on_progress(self, progress: Progress) -> None:
        """After each round of episodes and updates."""

    def on_boundary(self, boundary: Boundary) -> None:
        """After each round and each test period, whose result has been taken."""

    def on_lost(self, lost: LostSeed) -> None:
        """For a seed whose weights are no longer finite, which stops it."""
