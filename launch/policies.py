"""The policies of a run folder, and which of them to show."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from launch.errors import CommandError
from launch.run_folder import RunFolder


class Found(NamedTuple):
    """A policy's file, and what it says of itself."""

    path: Path  # without suffix
    subgoal_layers: int
    seed: int
    success_rate: float  # in the last test period


def find(folder: RunFolder) -> list[Found]:
    """All whole policies of a run folder, by agent and seed."""
    found = []
    for file in folder.policies.glob("[!.]*.json"):
        description = json.loads(file.read_text(encoding="utf-8"))
        layers, seed = description["subgoal_layers"], description["seed"]
        if folder.has_policy(layers, seed):
            path = folder.policy(layers, seed)
            found.append(Found(path, layers, seed, description["success_rate"]))
    return sorted(found, key=lambda policy: (policy.subgoal_layers, policy.seed))


def typical(found: Sequence[Found], subgoal_layers: int) -> Found | None:
    """The agent's policy of median test success: neither its best nor its worst seed."""
    own = [policy for policy in found if policy.subgoal_layers == subgoal_layers]
    own.sort(key=lambda policy: policy.success_rate)
    return own[len(own) // 2] if own else None


def choose(folder: RunFolder, subgoal_layers: int, seed: int | None) -> Found:
    """The policy of an agent and seed; without a seed, the typical one.

    Raises:
      CommandError: it is not there; the message says what is.
    """
    found = find(folder)
    if not found:
        raise CommandError(
            f"{folder.path} holds no policies; train some with "
            f"`python launch/run.py --task={folder.task}`"
        )
    if seed is None:
        policy = typical(found, subgoal_layers)
    else:
        same = [p for p in found if (p.subgoal_layers, p.seed) == (subgoal_layers, seed)]
        policy = same[0] if same else None
    if policy is None:
        wanted = f"{subgoal_layers} subgoal layers" + ("" if seed is None else f", seed {seed}")
        raise CommandError(f"{folder.path} has no policy of {wanted}; it has {_listed(found)}")
    return policy


def _listed(found: Sequence[Found]) -> str:
    agents = sorted({policy.subgoal_layers for policy in found})
    return "; ".join(
        f"{layers} subgoal layers: seeds "
        + ", ".join(str(policy.seed) for policy in found if policy.subgoal_layers == layers)
        for layers in agents
    )
