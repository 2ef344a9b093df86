"""The columns of a run folder's results.csv and figure.csv."""

KEY = ("task", "subgoal_layers", "seed", "period")
"""A row of results.csv is one test period (0: untrained) of one seed of one agent."""

CORE_COLUMNS = (
    *KEY,
    "train_episodes",
    "train_steps",
    "test_episodes",
    "success_rate",
    "mean_steps_to_goal",
    "wall_seconds",
    "diverged_episodes",
)

LATER_COLUMNS = ("core_seconds",)
"""Columns that results of earlier versions lack: a seed's share of the CPU time of its process."""

CLOCKS = ("wall_seconds", "core_seconds")
"""What may differ between two trainings of one seed by one command; nothing else does."""

WHOLE_NUMBERS = ("subgoal_layers", "seed", "period", "train_episodes", "test_episodes")
"""Columns that are never empty and hold integers of at least 0."""

LEVEL_FIELDS = (
    "proposed",
    "achieved",
    "tested",
    "penalised",
    "q_mean",
    "q_min",
    "q_at_bound",
    "saturation",
    "replay_fill",
    "success",
    "test_achieved",
    "test_missed",
)
"""Per level: attempts per training episode since the last test period (`proposed`); the shares of
these attempts whose subgoal was `achieved`, `tested` or `penalised` (empty at level 0, which
proposes actions); the learner's state on replayed transitions; the share of the level's own goals
that it reached in training (`success`); the shares of its subgoals in noise-free tests that were
`test_achieved` or `test_missed`, the rest having been cut short."""

SHARES = ("achieved", "tested", "penalised", "success", "test_achieved", "test_missed")
"""Level fields that are shares of counts, hence from 0 to 1."""

MAX_LEVELS = 3
"""Levels that always have columns; they are empty where an agent lacks the level."""


def level_column(level: int, field: str) -> str:
    """Name of a per-level diagnostic, e.g. ``level1_q_mean``; level 0 is the one that acts."""
    return f"level{level}_{field}"


RESULTS_COLUMNS = (*CORE_COLUMNS, *LATER_COLUMNS) + tuple(
    level_column(level, field) for level in range(MAX_LEVELS) for field in LEVEL_FIELDS
)

FIGURE_COLUMNS = ("task", "subgoal_layers", "period", "train_episodes", "n", "mean", "low", "high")
"""figure.csv: mean success rate and its 95% interval over the `n` seeds that have the period."""
