"""What was done in how long, counted where it is done and not read off a configuration."""

import dataclasses
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from tasks.vector import VectorEnv


class Work(NamedTuple):
    """A piece of work. Seconds are of one process; what is left of them is bookkeeping."""

    seconds: float
    updates: int  # gradient steps of one seed's actor and critic at one level
    env_steps: int
    update_seconds: float  # drawing batches and learning from them
    physics_seconds: float  # resets and steps of environments
    acting_seconds: float = 0.0  # forward passes of actors, where they were timed

    @property
    def bookkeeping_seconds(self) -> float:
        return self.seconds - self.update_seconds - self.physics_seconds - self.acting_seconds


def total(pieces: Sequence[Work]) -> Work:
    """All pieces together; their seconds add up, also where they were done side by side."""
    return Work(*(sum(column) for column in zip(*pieces, strict=True)))


class Meter:
    """Adds up the seconds spent in functions, and counts."""

    def __init__(self) -> None:
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self.updates = 0
        self.env_steps = 0

    def timed(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, its seconds added to a part's."""
        clock, seconds = time.perf_counter, self._seconds

        def call(*args: Any, **kwargs: Any) -> Any:
            start = clock()
            try:
                return function(*args, **kwargs)
            finally:
                seconds[part] += clock() - start

        return call

    def watch(self, env: Any) -> Any:
        """Has a vectorised environment's resets and steps timed, and its steps counted."""
        step = env.step

        def counted(actions: Any, mask: Any = None) -> Any:
            self.env_steps += env.num_envs if mask is None else int(mask.sum())
            return step(actions, mask)

        env.step = self.timed("physics", counted)
        env.reset = self.timed("physics", env.reset)
        return env

    def measure(self, work: Callable[[], Any]) -> Work:
        """Does the work; only what happens meanwhile counts."""
        self._seconds.clear()
        self.updates = self.env_steps = 0
        start = time.perf_counter()
        work()
        seconds = time.perf_counter() - start
        parts = (self._seconds[part] for part in ("updates", "physics", "acting"))
        return Work(seconds, self.updates, self.env_steps, *parts)


def whole_horizon(env: VectorEnv) -> VectorEnv:
    """Puts all goals out of reach: every episode and every segment runs its whole length."""
    for name in ("goal_space", "subgoal_space"):
        space = getattr(env, name)
        unreachable = [1e-300] * space.dim  # nothing but the goal itself, to the last bit
        setattr(env, name, dataclasses.replace(space, threshold=unreachable))
    return env
