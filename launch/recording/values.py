"""Q over the goals of each level, as the critics of an agent's typical policy have it."""

from collections.abc import Sequence
from typing import Any

import numpy as np

import hac_suite
import tasks
from analysis.reading.episodes import some_planes
from hac_suite.types import level_specs
from launch.asking import settings
from launch.folder import policies
from launch.pictures import choosing
from launch.recording.tables import DIGITS

_GRID = 41  # points of a side of a map


def of_agents(found: Sequence[policies.Found]) -> dict[str, Any]:
    """Of each agent's typical policy, Q over the goals of each level; none without critics."""
    agents = []
    for layers in sorted({policy.subgoal_layers for policy in found}):
        own = [policy for policy in found if policy.subgoal_layers == layers]
        policy = hac_suite.Policy.load(policies.typical(own)[0].path)
        if policy.critics:
            agents.append({"subgoal_layers": layers, "seed": policy.metadata["seed"],
                           "levels": _q_maps(policy)})  # fmt: skip
    return {"task": found[0].task, "agents": agents}


def _q_maps(policy: hac_suite.Policy) -> list[dict[str, Any]]:
    """At the start of the first test episode: a map for each level that has a plane."""
    env = tasks.load_vector(policy.metadata["task"], 1)
    state = env.reset(choosing.seeds_of_tests(policy)[:1], test=True)
    env.close()
    levels = level_specs(env, policy.horizons)
    tops = [level == len(levels) - 1 for level in range(len(levels))]
    now = [state.achieved_goal[0] if top else state.achieved_subgoal[0] for top in tops]
    wanted = [state.desired_goal[0] if top else None for top in tops]
    grids = [
        _Grid(level.goal_space, here if goal is None else goal)
        for level, here, goal in zip(levels, now, wanted, strict=True)
    ]
    observation = np.repeat(state.observation, _GRID**2, axis=0)
    config = settings.to_config(policy.metadata["config"])
    values = hac_suite.q_values(policy, levels, config, observation, [g.goals for g in grids])
    return [
        grid.described(level, value, here, goal)
        for level, (grid, value, here, goal) in enumerate(
            zip(grids, values, now, wanted, strict=True)
        )
        if grid.plane
    ]


class _Grid:
    """Goals that fill a plane of a space; in its other dimensions they are as `around`."""

    def __init__(self, space: Any, around: np.ndarray):
        self._space = space
        found = some_planes(self._space.names)
        self.title = found[0][0] if found else ""
        self.plane: tuple[int, ...] = found[0][1] if found else ()
        self.goals = np.tile(around.astype(float), (_GRID**2, 1))
        self.axes = [np.linspace(space.low[d], space.high[d], _GRID) for d in self.plane]
        if self.plane:
            across, up = np.meshgrid(*self.axes)
            self.goals[:, self.plane[0]], self.goals[:, self.plane[1]] = across.flat, up.flat

    def described(
        self, level: int, value: np.ndarray, here: np.ndarray, goal: np.ndarray | None
    ) -> dict[str, Any]:
        plane = list(self.plane)
        return {
            "level": level,
            "title": self.title,
            "names": [self._space.names[d] for d in plane],
            "units": [self._space.units[d] for d in plane],
            "axes": [axis.round(DIGITS).tolist() for axis in self.axes],
            "q": value.reshape(_GRID, _GRID).round(2).tolist(),
            "here": here[plane].round(DIGITS).tolist(),
            "goal": None if goal is None else goal[plane].round(DIGITS).tolist(),
        }
