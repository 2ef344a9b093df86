"""Hierarchical Actor-Critic for populations of seeds."""

from hac_suite.algorithm.hierarchy import StepView
from hac_suite.algorithm.record import Outcome
from hac_suite.config import PRESETS, Config, completed, horizons
from hac_suite.policy import Policy
from hac_suite.state import SeedState
from hac_suite.training.callback import Boundary, Callback, LostSeed, Progress
from hac_suite.training.evaluation import EpisodeStats, run_episodes
from hac_suite.training.loop import DIAGNOSTICS, PeriodResult, train
from hac_suite.types import EnvStep, GoalSpace, Spaces, VectorEnv
from hac_suite.values import q_values

__all__ = [
    "DIAGNOSTICS",
    "PRESETS",
    "Boundary",
    "Callback",
    "Config",
    "EnvStep",
    "EpisodeStats",
    "GoalSpace",
    "LostSeed",
    "Outcome",
    "PeriodResult",
    "Policy",
    "Progress",
    "SeedState",
    "Spaces",
    "StepView",
    "VectorEnv",
    "completed",
    "horizons",
    "q_values",
    "run_episodes",
    "train",
]
