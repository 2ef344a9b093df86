"""Counts over the training episodes between two test periods."""

from typing import Any

import numpy as np

from hac_suite.algorithm.record import Outcome, Round
from hac_suite.algorithm.transitions import penalised
from hac_suite.config import Config


class Tally:
    """Sums over training episodes since the last test period, per seed."""

    def __init__(self, seeds: int, levels: int):
        self.episodes = 0
        self.diverged = np.zeros(seeds, np.int64)
        # Per level: [attempts, subgoals achieved, tested, penalised, segments, segments reached].
        self.counts = np.zeros((levels, 6, seeds))

    def add(self, run: Round, config: Config) -> None:
        per_seed = (len(self.diverged), config.episodes_per_round)
        self.episodes += config.episodes_per_round
        self.diverged += run.diverged.reshape(per_seed).sum(1)
        for level, record in enumerate(run.levels):
            flags = (
                record.done,
                record.outcome == Outcome.ACHIEVED,
                record.done & record.tested,
                penalised(record, config),
                record.segment_end,
                record.segment_end & record.reached,
            )
            for row, flag in enumerate(flags):
                self.counts[level, row] += flag.sum(0).reshape(per_seed).sum(1)

    def columns(self, level: int, seed: int) -> dict[str, float]:
        """Attempts an episode, and rates; only levels that propose subgoals have those of them."""
        attempts, hit, tested, penalties, segments, reached = self.counts[level, :, seed]
        proposes = {
            "achieved": _ratio(hit, attempts),
            "tested": _ratio(tested, attempts),
            "penalised": _ratio(penalties, attempts),
        }
        return {
            "proposed": _ratio(attempts, self.episodes),
            **(proposes if level else dict.fromkeys(proposes, np.nan)),
            "success": _ratio(reached, segments),
        }

    def state(self, seed: int) -> dict[str, Any]:
        """One seed's sums, in JSON's types."""
        return {
            "episodes": self.episodes,
            "diverged": int(self.diverged[seed]),
            "counts": self.counts[..., seed].tolist(),
        }

    def restore(self, seed: int, state: dict[str, Any]) -> None:
        """Takes over what `state` gave; every seed of a tally has seen as many episodes."""
        self.episodes = state["episodes"]
        self.diverged[seed] = state["diverged"]
        self.counts[..., seed] = state["counts"]


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else np.nan
