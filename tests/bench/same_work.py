"""The same work done by us and by a peer: 10 seeds over two processes, taking turns."""

import contextlib
import dataclasses
import itertools
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any, NamedTuple

import hac_suite
import tasks
from hac_suite.config import PrecisionName
from hac_suite.learning import mixed
from tests.bench.plain_hac import ArrayReplay, PlainAgents, Replay
from tests.bench.population import TASK, Training
from tests.bench.repeats import REPEATS, entry, rounded
from tests.bench.team import Team
from tests.bench.work import Work, total

SEEDS = (range(5), range(5, 10))  # per process
ROUNDS = 1  # in each repeat
Say = Callable[[str], None]


class Turn(NamedTuple):
    """One repeat: seconds until both processes were done, and what they did."""

    seconds: float
    work: Work


class Ours:
    """A population on goals out of reach."""

    def __init__(
        self, task: str, config: hac_suite.Config, seeds: Sequence[int], subgoal_layers: int
    ):
        self._training = Training(task, config, seeds, subgoal_layers, unreachable=True)

    def __call__(self, episodes: int) -> Work:
        """Trains every seed for so many episodes more."""
        rounds = episodes // self._training.config.episodes_per_round
        return total([self._training.round() for _ in range(rounds)])


def sb3(say: Say) -> dict[str, Any]:
    """Our flat agent against stable-baselines3, at two batch sizes."""
    from tests.bench.sb3_peer import Sb3Agents  # in [dev] only

    report: dict[str, Any] = {}
    for batch, updates in ((256, 20), (1024, 40)):
        say(f"stable-baselines3, batch {batch}, {updates} updates an episode")
        config = dataclasses.replace(
            hac_suite.PRESETS["suite"], batch_size=batch, updates_per_episode=updates
        )
        report |= compare(f"sb3_same_work_b{batch}", TASK, config, 0, Sb3Agents, ())
    return report


def plain_hac(say: Say) -> dict[str, Any]:
    """Our hierarchies against a plain one-environment HAC."""
    report: dict[str, Any] = {}
    for key, layers, replay, held in (
        ("plain_hac_1_layer", 1, Replay, "a list of transitions"),
        ("plain_hac_2_layers", 2, Replay, "a list of transitions"),
        ("plain_hac_1_layer_array_replay", 1, ArrayReplay, "arrays"),
    ):
        say(f"plain HAC, {layers} subgoal layer{'s' * (layers > 1)}, replay in {held}")
        config = hac_suite.PRESETS["paper"]
        report |= compare(key, TASK, config, layers, PlainAgents, (layers, replay))
    return report


def compare(
    key: str,
    task: str,
    config: hac_suite.Config,
    subgoal_layers: int,
    make_peer: Callable[..., Any],
    arguments: tuple,
) -> dict[str, Any]:
    """The entries of turns of ours and of the peer's, after a warm-up of each.

    Where the processor has bf16, ours take turns in both precisions.

    Args:
      make_peer: called with task, config, the seeds of a process and `arguments`.

    Raises:
      AssertionError: one did other work than the other, or than was asked for.
    """
    configs = {
        f"{key}{suffix}": dataclasses.replace(config, precision=precision)
        for precision, suffix in precisions().items()
    }
    episodes = ROUNDS * config.episodes_per_round
    turns: dict[str, list[Turn]] = {name: [] for name in (*configs, "peer")}
    with contextlib.ExitStack() as opened:
        teams = {
            name: opened.enter_context(
                Team(Ours, [(task, c, own, subgoal_layers) for own in SEEDS])
            )
            for name, c in configs.items()
        }
        teams["peer"] = opened.enter_context(
            Team(make_peer, [(task, config, own, *arguments) for own in SEEDS])
        )
        for _ in range(1 + REPEATS):
            for name, team in teams.items():
                seconds, works = team.work(episodes)
                turns[name].append(Turn(seconds, total(works)))
    count = sum(len(own) for own in SEEDS)
    for turn in itertools.chain(*turns.values()):
        check(turn.work, task, config, subgoal_layers, count * episodes)
    report: dict[str, Any] = {}
    for name in configs:
        report |= entries(name, turns[name][1:], turns["peer"][1:])
    return report


def precisions() -> dict[PrecisionName, str]:
    """The precisions that this machine has, and what an entry's name has at its end."""
    return {"fp32": "", "bf16": "_bf16"} if mixed.has_bf16() else {"fp32": ""}


def check(
    work: Work, task: str, config: hac_suite.Config, subgoal_layers: int, episodes: int
) -> None:
    """Asserts that these are the updates and environment steps of so many whole episodes."""
    updates = episodes * config.updates_per_episode * (subgoal_layers + 1)
    steps = episodes * tasks.load_vector(task, 1).max_steps
    assert (work.updates, work.env_steps) == (updates, steps), (work, updates, steps)


def entries(key: str, ours: Sequence[Turn], peer: Sequence[Turn]) -> dict[str, Any]:
    """Ratios (the peer's seconds over ours), and what an update and a step take either."""
    pairs = list(zip(ours, peer, strict=True))
    details = {
        **entry("update_ratio", [b.work.update_seconds / a.work.update_seconds for a, b in pairs]),
        "task": TASK,
        "updates": ours[0].work.updates,
        "env_steps": ours[0].work.env_steps,
        "ours": _unit_times(ours),
        "peer": _unit_times(peer),
    }
    return {
        **entry(key, [b.seconds / a.seconds for a, b in pairs]),
        f"{key}_details": details,
    }


def _unit_times(turns: Sequence[Turn]) -> dict[str, float]:
    """Medians. `step` is all that is not updates; `physics` is the environment's part of it."""
    works = [turn.work for turn in turns]
    return {
        "seconds": rounded(median(turn.seconds for turn in turns)),
        "update_ms": rounded(median(1e3 * w.update_seconds / w.updates for w in works)),
        "step_us": rounded(
            median(1e6 * (w.seconds - w.update_seconds) / w.env_steps for w in works)
        ),
        "physics_us": rounded(median(1e6 * w.physics_seconds / w.env_steps for w in works)),
    }
