"""Replay buffers of one level for many seeds, laid out so that a gathered batch needs no assembly.

A row is  [action | observation | goal | 1 | next action | next observation | goal | 1 | reward |
discount].  `row[:A+O+G+1]` is the critic's input, `row[A:A+O+G+1]` the actor's, and the same holds
one block further for the next state, whose action the learner fills in. Observations are scaled,
goals and actions normalised to [-1, 1].
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import torch
from torch.nn import functional

from hac_suite.algorithm.transitions import Transitions
from hac_suite.learning.networks import ALIGNED
from hac_suite.state import copy_into
from hac_suite.types import LevelSpec


class RowLayout(NamedTuple):
    """Where a row's parts lie."""

    action_dim: int
    block: int  # width of [action | observation | goal | 1]

    @classmethod
    def of(cls, spec: LevelSpec) -> "RowLayout":
        return cls(
            spec.action_dim, spec.action_dim + spec.observation_dim + spec.goal_space.dim + 1
        )

    @property
    def width(self) -> int:
        return 2 * self.block + 2

    def pack(self, transitions: Transitions, spec: LevelSpec) -> np.ndarray:
        """Transitions in natural units -> float32 rows [M, width]."""
        rows = np.zeros((len(transitions.reward), self.width), np.float32)
        a, o = self.action_dim, spec.observation_dim
        goal = spec.goal_space.normalise(transitions.goal)
        rows[:, :a] = transitions.action
        for start, observation in (
            (a, transitions.observation),
            (self.block + a, transitions.next_observation),
        ):
            rows[:, start : start + o] = spec.scaled(observation)
            rows[:, start + o : start + o + goal.shape[1]] = goal
            rows[:, start + o + goal.shape[1]] = 1
        rows[:, -2] = transitions.reward
        rows[:, -1] = transitions.discount
        return rows


class Replay:
    """Rings of rows, one per seed; the oldest rows are overwritten first."""

    def __init__(
        self,
        seeds: int,
        capacity: int,
        layout: RowLayout,
        device: torch.device | str = "cpu",
    ):
        self.layout = layout
        self.capacity = capacity
        # Zeros, since a seed without a transition yet (all diverged) learns from a blank row; and
        # numpy's, whose pages take memory only once they are written.
        rows = np.zeros((seeds, capacity, layout.width), np.float32)
        self.rows = torch.from_numpy(rows).to(device)
        self.added = np.zeros(seeds, np.int64)

    @property
    def sizes(self) -> np.ndarray:
        """Rows held, per seed [S]."""
        return np.minimum(self.added, self.capacity)

    def add(self, seed: int, rows: np.ndarray) -> None:
        """Appends rows [M, width] to one seed's ring; only the last `capacity` are kept."""
        kept = rows[-self.capacity :]
        start = (self.added[seed] + len(rows) - len(kept)) % self.capacity
        first = min(len(kept), self.capacity - start)
        ring = self.rows[seed]
        source = torch.from_numpy(np.ascontiguousarray(kept))
        ring[start : start + first] = source[:first]
        ring[: len(kept) - first] = source[first:]
        self.added[seed] += len(rows)

    def held(self, seed: int) -> torch.Tensor:
        """A view of the rows that a seed's ring holds, in the order of the ring."""
        return self.rows[seed, : self.sizes[seed]]

    def restore(self, seed: int, held: torch.Tensor, added: int) -> None:
        """Makes a ring what it was when it gave `held` and `added`.

        Raises:
            ValueError: such a ring holds another number of rows.
        """
        self.added[seed] = added
        copy_into({"replay": self.held(seed)}, {"replay": held})

    def sample_indices(
        self, generators: list[np.random.Generator], updates: int, batch: int
    ) -> torch.Tensor:
        """Uniform rows with replacement for a round: int64 [updates, S, batch] into each ring."""
        drawn = [
            generator.integers(0, max(size, 1), (updates, batch))
            for generator, size in zip(generators, self.sizes, strict=True)
        ]
        return torch.from_numpy(np.stack(drawn, axis=1)).to(self.rows.device)

    def batches(self, indices: torch.Tensor, start: int = 0) -> Iterator[torch.Tensor]:
        """Each update's rows [S', B, width] of seeds start, start + 1, ..., in one buffer.

        Args:
            indices: [updates, S', B] of these seeds.
        """
        _, seeds, batch = indices.shape
        table = self.rows[start : start + seeds].view(-1, self.layout.width)
        # Filled up so that every seed's rows begin alike aligned; see networks.ALIGNED.
        filled = functional.pad(indices, (0, -batch % ALIGNED))
        flat = filled + torch.arange(seeds, device=table.device)[:, None] * self.capacity
        # Memory fresh from the system costs several times what the copy does: one buffer for all.
        buffer = table.new_empty(flat[0].numel(), self.layout.width)
        for chosen in flat:
            torch.index_select(table, 0, chosen.view(-1), out=buffer)
            yield buffer.view(seeds, -1, self.layout.width)[:, :batch]
