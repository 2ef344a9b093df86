"""Whole episodes as JSON: the path, and every subgoal with its outcome."""

from collections.abc import Sequence
from typing import Any

import numpy as np

import tasks
from launch.pictures.subgoal_log import Replayed
from launch.recording.tables import DIGITS


def anatomy(chosen: Sequence[tuple[Replayed, int]], task: str) -> dict[str, Any]:
    """The episodes with all their subgoals, and the spaces that these are points of."""
    spec = tasks.spec(task)
    spaces = {"subgoal_space": spec.subgoal_space, "goal_space": spec.goal_space}
    described = {
        name: {
            "names": list(space.names),
            "units": list(space.units),
            "threshold": space.threshold.tolist(),
        }
        for name, space in spaces.items()
    }
    shared = set(spec.subgoal_space.names)
    goal_only = [i for i, name in enumerate(spec.goal_space.names) if name not in shared]
    episodes = [_episode(played, index, goal_only) for played, index in chosen]
    return {
        "task": task,
        "control_timestep": spec.control_timestep,
        **described,
        "episodes": episodes,
    }


def _episode(played: Replayed, index: int, goal_only: Sequence[int]) -> dict[str, Any]:
    """An episode; `goal_only` are the goal's dimensions that `path` does not have."""
    steps = int(played.stats.steps[index])
    achieved = played.achieved_goal[: steps + 1, index]
    return {
        "subgoal_layers": played.policy.subgoal_layers,
        "seed": played.policy.metadata["seed"],
        "episode": index,
        "success": bool(played.stats.success[index]),
        "goal": _rounded(played.goal[index]),
        "path": [_rounded(point) for point in played.path[: steps + 1, index]],
        **({"goal_path": [_rounded(point[goal_only]) for point in achieved]} if goal_only else {}),
        "subgoals": [
            {
                "level": subgoal.level,
                "step": subgoal.step,
                "end_step": subgoal.end_step,
                "outcome": subgoal.outcome,
                "subgoal": _rounded(subgoal.subgoal),
            }
            for subgoal in sorted(played.subgoals, key=lambda s: (s.level, s.step))
            if subgoal.episode == index
        ],
    }


def _rounded(point: np.ndarray) -> list[float]:
    return [round(float(value), DIGITS) for value in point]
