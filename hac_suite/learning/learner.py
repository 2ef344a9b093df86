"""What a level learns with, seen from outside: the interface that DDPG, TD3 and others have."""

from abc import abstractmethod
from typing import ClassVar, Protocol

import torch

from hac_suite.config import Config
from hac_suite.learning.networks import StackedMLP
from hac_suite.types import LevelSpec


class Learner(Protocol):
    """Learns one level of the hierarchy for a population of S seeds.

    `hac_suite.training.population` has one learner a level, and uses it so:

        learner = make(spec, config, generators, device)   # a generator for each seed
        parts = [(a, b, learner.of_seeds(a, b)) for a, b in edges]
        while training:
            run episodes with learner.actor, and store their transitions as rows
            for a, b, part in parts:
                for rows in replay.batches(indices[:, a:b], a):   # [b - a, B, width]
                    part.update(rows)
            stop each seed whose learner.parameters() are no longer finite
            at a test period:
                run episodes with learner.tested_actor
                results.csv gets learner.diagnose(rows)       # rows [S, B, width]
            at a checkpoint, for each seed:
                save learner.tensors(index)   # to resume: what was saved is copied into them

    What keeps seeds independent and resuming exact:

    - No operation mixes seeds: each has its row in every tensor, and gets the same bits in any
      population. `StackedMLP` and `Adam` are made for this.
    - All state that an update changes is in `tensors`. Random numbers come only from the seed's own
      generator at the start and from its count of updates: see `td3.smoothing_noise`.
    - Memory stays where it is: `of_seeds` and `tensors` give views of it.

    Attributes:
        actor: the networks that act in training. As for all actors here, their output goes through
            a tanh.
        tested_actor: the networks that test periods use and that policies contain.
        on_gpu: whether `update` can be captured as a CUDA graph: the same operations each time, and
            none of them on the CPU. Other learners are refused on a GPU.
        in_bf16: whether it learns with the networks of `config.precision`. Other learners are
            refused with `precision="bf16"`.
    """

    actor: StackedMLP
    tested_actor: StackedMLP
    on_gpu: ClassVar[bool] = False
    in_bf16: ClassVar[bool] = False

    @abstractmethod
    def __init__(
        self,
        spec: LevelSpec,
        config: Config,
        generators: list[torch.Generator],
        device: torch.device | str = "cpu",
    ):
        """`generators`: one for each seed, on the CPU: the only source of randomness."""

    @abstractmethod
    def of_seeds(self, start: int, stop: int) -> "Learner":
        """The learner of seeds start, ..., stop - 1: it updates their rows of the same memory."""

    @abstractmethod
    def update(self, rows: torch.Tensor) -> None:
        """Learns from rows [S, B, width], as `replay.RowLayout` lays them out (overwritten)."""

    @abstractmethod
    def tensors(self, index: int) -> dict[str, torch.Tensor]:
        """Views of one seed's learnt state, by name; `index` is its row, from 0 to S - 1."""

    @abstractmethod
    def parameters(self) -> list[torch.Tensor]:
        """Trained weights, [S, P] each; a seed with a weight that is not finite is stopped."""

    @abstractmethod
    def updates(self) -> torch.Tensor:
        """How many updates each seed has had: [S]."""

    @abstractmethod
    def diagnose(self, rows: torch.Tensor) -> dict[str, list[float]]:
        """Diagnostics of each seed for results.csv, from rows [S, B, width] (overwritten).

        Returns:
            q_mean, q_min: mean and least Q of the policy's outputs.
            q_at_bound: share of it at the least value that the critic can have.
            saturation: share of the actor's outputs beyond 0.99.
            A name that is left out is an empty column.
        """
