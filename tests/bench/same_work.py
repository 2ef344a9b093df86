"""The same work done by us and by a peer: 10 seeds over two processes, taking turns."""

import dataclasses
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any, NamedTuple

import hac_suite
import tasks
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
        ours, peer = compare(TASK, config, 0, Sb3Agents, ())
        report |= entries(f"sb3_same_work_b{batch}", ours, peer)
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
        report |= entries(key, *compare(TASK, config, layers, PlainAgents, (layers, replay)))
    return report


def compare(
    task: str,
    config: hac_suite.Config,
    subgoal_layers: int,
    make_peer: Callable[..., Any],
    arguments: tuple,
    *,
    seeds: Sequence[Sequence[int]] = SEEDS,
    repeats: int = REPEATS,
) -> tuple[list[Turn], list[Turn]]:
    """Turns of ours and of the peer's, after a warm-up of each.

    Args:
      make_peer: called with task, config, the seeds of a process and `arguments`.

    Raises:
      AssertionError: one did other work than the other, or than was asked for.
    """
    episodes = ROUNDS * config.episodes_per_round
    with (
        Team(Ours, [(task, config, own, subgoal_layers) for own in seeds]) as ours,
        Team(make_peer, [(task, config, own, *arguments) for own in seeds]) as peer,
    ):
        turns: tuple[list[Turn], list[Turn]] = ([], [])
        for _ in range(1 + repeats):
            for team, taken in zip((ours, peer), turns, strict=True):
                seconds, works = team.work(episodes)
                taken.append(Turn(seconds, total(works)))
    count = sum(len(own) for own in seeds)
    for turn in (*turns[0], *turns[1]):
        check(turn.work, task, config, subgoal_layers, count * episodes)
    return turns[0][1:], turns[1][1:]


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
