"""All hyperparameters with their sources, and the presets."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, Literal, get_args

from hac_suite.learning import learners

# Sources: "text" is the preprint; R18 and R20 are the authors' releases of July 2018 and May 2020;
# "ours" was measured on this project's tasks.

PrecisionName = Literal["fp32", "bf16"]


class _Part:
    """Base of a config's parts: checks of fields."""

    def _require(self, name: str, holds: bool, wanted: str) -> None:
        if not holds:
            raise ValueError(f"{name} is {getattr(self, name)!r}; it must be {wanted}.")

    def _require_shares(self, *names: str) -> None:
        for name in names:
            self._require(name, 0 <= getattr(self, name) <= 1, "between 0 and 1")

    def _require_amounts(self, *names: str) -> None:
        for name in names:
            self._require(name, 0 <= getattr(self, name) < math.inf, "zero or more")

    def _require_counts(self, *names: str) -> None:
        for name in names:
            self._require(name, getattr(self, name) >= 1, "at least 1")
        self._require_whole(*names)

    def _require_whole(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            self._require(name, int(value) == value, "a whole number")

    def _require_one_of(self, name: str, *words: str) -> None:
        self._require(name, getattr(self, name) in words, "one of " + ", ".join(words))


@dataclasses.dataclass(frozen=True)
class HierarchyConfig(_Part):
    """How the levels work together: the algorithm of the paper."""

    # -- Subgoal testing (Section 3.2)
    subgoal_test_rate: float = 0.3  # lambda; R20 0.3, R18 0.2
    test_draw: Literal["top", "each_level"] = "top"  # text: one a top-level attempt (Alg. 1)
    tested_subgoal_noise_free: bool = True  # text; in R18 and R20 the tested subgoal may be noisy
    penalise_cut_short: bool = False  # ours: only a lower level that used all T_i has failed

    # -- Hindsight (Section 3.3)
    hindsight_actions: bool = True  # text; False stores the proposed subgoal even when missed
    hindsight_goals: int = 3  # "a few"; R18 and R20 take 3; 0 switches hindsight goals off
    # What they are picked for: each segment, whose `preceding` (text) or all (`segment`, R20)
    # transitions a picked state relabels; or each transition, which is relabelled by states of its
    # `future` in the segment (HER, Andrychowicz et al. 2017, k = 4).
    hindsight_relabels: Literal["preceding", "segment", "future"] = "preceding"
    hindsight_pick_last: bool = False  # R18, R20: the segment's last state is always picked
    drop_held_hindsight: bool = True  # ours: a goal that held before the segment teaches nothing

    # -- Exploration
    random_action_rate: float = 0.2  # level 0; R18, R20; the text's Gaussian alone fails
    random_subgoal_rate: float = 0.2  # the levels above; R18, R20
    action_noise: float = 0.1  # standard deviation at level 0; R18, R20
    subgoal_noise: float = 0.1  # at the levels above; R18 0.1, R20 0.03-0.1

    def _check_hierarchy(self) -> None:
        self._require_shares("subgoal_test_rate", "random_action_rate", "random_subgoal_rate")
        self._require_amounts("action_noise", "subgoal_noise", "hindsight_goals")
        self._require_whole("hindsight_goals")
        self._require_one_of("test_draw", "top", "each_level")
        self._require_one_of("hindsight_relabels", "preceding", "segment", "future")


@dataclasses.dataclass(frozen=True)
class ScheduleConfig(_Part):
    """Which episodes are played, and how many."""

    continue_after_goal: bool = False  # R18: a training episode goes on after the end goal
    test_until_horizon: bool = True  # R18, R20: in tests the top level is not held to T_n
    episodes_per_period: int = 300  # Section 4.2
    test_episodes: int = 64  # Section 4.2
    episodes_per_round: int = 4  # ours: episodes a seed collects between rounds of updates

    def _check_schedule(self) -> None:
        self._require_counts("episodes_per_period", "test_episodes", "episodes_per_round")
        self._require(
            "episodes_per_period",
            self.episodes_per_period % self.episodes_per_round == 0,
            f"a multiple of episodes_per_round ({self.episodes_per_round})",
        )


@dataclasses.dataclass(frozen=True)
class LearnerConfig(_Part):
    """What each level learns with."""

    discount: float = 0.98  # R18, R20
    batch_size: int = 256  # ours; R18, R20 1024
    updates_per_episode: int = 20  # per level, ours; R18, R20 40
    # Above level 0, ours: a level there sees a T_0-th of the transitions, and fewer the higher it
    # is. 0: as many as level 0, as in R18 and R20.
    upper_updates_per_episode: int = 0
    learning_rate: float = 1e-3  # Adam, actor and critic; R18, R20
    hidden_sizes: tuple[int, ...] = (64, 64, 64)  # R18, R20
    # bf16: products between hidden layers are in bfloat16 (ours). Faster where the processor has
    # avx512_bf16 or AMX, and refused elsewhere.
    precision: PrecisionName = "fp32"
    replay_capacity: int = 300_000  # transitions per level and seed; ours
    bounded_critic: bool = True  # R20: -F * sigmoid, and targets clipped to [-F, 0]
    # F: T_i (R20), or the least return that T_i attempts can have, (1 - g^T_i) / (1 - g) (ours).
    critic_floor: Literal["attempts", "returns"] = "attempts"
    initial_q: float = -0.067  # R20: the bounded critic's optimistic start
    saturation_penalty: float = 1e-4  # ours: on the actor's squared output before the tanh
    target_rate: float = 0.05  # R18: Polyak; 0 learns from the online networks, as R20 does
    # Tests run an average of the actor that moves by this share an actor update, more at first:
    # R18's is its target actor, at 0.05; R20 tests the actor itself, which is what 0 does. Ours is
    # slower: a curve then shows what was learnt and not the last few batches.
    tested_actor_rate: float = 0.0005

    # ddpg (text), td3 (Fujimoto et al. 2018), or a class of one's own: my_learner.py:MyLearner
    learner: str = "ddpg"
    # -- td3 only
    target_noise: float = 0.2  # on the target actor's output, in half-ranges; Fujimoto et al.
    target_noise_clip: float = 0.5  # that noise is at most this; Fujimoto et al.
    policy_delay: int = 2  # updates of the critics for one of the actor and targets; as well

    def _check_learner(self) -> None:
        self._require_shares("discount", "target_rate", "tested_actor_rate")
        self._require_amounts("saturation_penalty", "target_noise", "target_noise_clip")
        self._require_amounts("upper_updates_per_episode")
        self._require_whole("upper_updates_per_episode")
        self._require_counts("batch_size", "updates_per_episode", "replay_capacity", "policy_delay")
        self._require("learning_rate", 0 < self.learning_rate < math.inf, "above zero")
        self._require("initial_q", -1 < self.initial_q < 0, "between -1 and 0")
        self._require_one_of("critic_floor", "attempts", "returns")
        self._require_one_of("precision", *get_args(PrecisionName))
        self._require(
            "hidden_sizes",
            len(self.hidden_sizes) > 0 and min(self.hidden_sizes) >= 2,
            "one or more sizes of at least 2",
        )
        self._require(
            "precision",
            self.precision == "fp32" or len(self.hidden_sizes) > 1,
            "fp32 with one hidden layer: there are no products between hidden layers",
        )
        learners.check(self.learner)
        if self.learner == "td3":
            self._require("target_rate", self.target_rate > 0, "above 0: td3 has target networks")


# The fields come in the order of their parts from the last base to the first.
@dataclasses.dataclass(frozen=True)
class Config(LearnerConfig, ScheduleConfig, HierarchyConfig):
    """Hyperparameters of one experiment. Rates are probabilities; noise is in half-ranges.

    Raises:
        ValueError: a value is outside what its comment allows; the message names it.
    """

    def __post_init__(self) -> None:
        self._check_hierarchy()
        self._check_schedule()
        self._check_learner()


def updates_of_level(config: LearnerConfig, level: int) -> int:
    """How many updates a level has for each training episode."""
    if level > 0 and config.upper_updates_per_episode:
        return config.upper_updates_per_episode
    return config.updates_per_episode


PAPER = Config()

# What agents with 0, 1 and 2 subgoal layers were tuned to, with the same trials for each.
SUITE = dataclasses.replace(
    PAPER,
    # Every transition of every level gets two goals from what follows it in its segment.
    hindsight_relabels="future",
    hindsight_goals=2,
    critic_floor="returns",
    # Noise of 0.1 would be beyond most thresholds: a noisy subgoal is never the one meant.
    test_draw="each_level",
    subgoal_noise=0.03,
    random_subgoal_rate=0.1,
    learning_rate=2e-3,
    replay_capacity=100_000,
)

_RELEASES = dataclasses.replace(
    PAPER,
    test_draw="each_level",
    tested_subgoal_noise_free=False,
    hindsight_pick_last=True,
    drop_held_hindsight=False,
    batch_size=1024,
    updates_per_episode=40,
    saturation_penalty=0.0,
)

RELEASE_2018 = dataclasses.replace(
    _RELEASES,
    subgoal_test_rate=0.2,
    continue_after_goal=True,
    bounded_critic=False,
    tested_actor_rate=0.05,
)

RELEASE_2020 = dataclasses.replace(
    _RELEASES, hindsight_relabels="segment", target_rate=0.0, tested_actor_rate=0.0
)

PRESETS = {
    "suite": SUITE,
    "paper": PAPER,
    "release_2018": RELEASE_2018,
    "release_2020": RELEASE_2020,
}


def completed(fields: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a config that some version wrote, completed by those that it lacks.

    A field that is missing gets the value that corresponds to the behaviour before it existed,
    which may differ from today's default.
    """
    before = dict(_BEFORE)
    if "random_action_rate" in fields:  # it stood for all levels
        before["random_subgoal_rate"] = fields["random_action_rate"]
    return {**before, **fields}


_BEFORE: dict[str, Any] = {
    "upper_updates_per_episode": 0,
    "critic_floor": "attempts",
    "learner": "ddpg",
    "precision": "fp32",
    # What ddpg does not read.
    "target_noise": 0.2,
    "target_noise_clip": 0.5,
    "policy_delay": 2,
}


def horizons(
    max_steps: int, subgoal_layers: int, own: Mapping[int, tuple[int, ...]] | None = None
) -> tuple[int, ...]:
    """Attempts (T_0, ..., T_n) of each level: the least equal T_i whose product spans `max_steps`.

    The paper uses one T for all levels (Section 3.2). The agent without subgoal layers gets
    `max_steps`.

    Args:
        own: a task's own attempts, by number of subgoal layers; they take the place of equal ones.

    Raises:
        ValueError: a negative number of subgoal layers.
    """
    if subgoal_layers < 0:
        raise ValueError(f"subgoal_layers is {subgoal_layers}; it must be zero or more.")
    if own and subgoal_layers in own:
        return own[subgoal_layers]
    levels = subgoal_layers + 1
    attempts = max(1, round(max_steps ** (1 / levels)))
    while attempts**levels < max_steps:
        attempts += 1
    return (attempts,) * levels
