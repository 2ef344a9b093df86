"""Records what explains policies: `python launch/record_episodes.py --task=TASK`."""

import csv
import itertools
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from absl import flags

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

    from launch.asking import start

    start.without_display()

import numpy as np

import hac_suite
import tasks
from analysis import program
from analysis.program import CommandError
from analysis.reading import names
from analysis.reading.episodes import some_planes
from analysis.reading.files import write_atomically, write_text
from hac_suite.types import level_specs
from launch.asking import lists, settings
from launch.folder import policies
from launch.pictures import choosing
from launch.pictures.subgoal_log import Replayed, replay
from launch.record_subgoals import anatomy

_EPISODES = 32  # of each policy
_GALLERY = 4  # failures of each agent that are kept whole
_GRID = 41  # points of a side of a map of Q
_DIGITS = 3
_HELP = """Replays test episodes of a run's policies and records what explains them in pictures.

  python launch/record_episodes.py --task=ur5_reacher
  python -m analysis.explain runs/ur5_reacher

writes into the run folder: starts.csv, the start, goal and outcome of every episode; failures.json,
whole episodes that failed; maps.csv, every subgoal, also of the policies that --keep_policies kept;
values.json, what critics expect over the goals of each level.

Flags:
{flags}

Exit status: 0 the files are written; 2 the command was wrong."""


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = _flags()
    return program.carry_out(program.Program(_HELP, values), argv, lambda _: _record(values))


def _flags() -> flags.FlagValues:
    values = flags.FlagValues()
    lists.define_task(values, "pick_place", lists.ANY_TASK)
    lists.define_run(values)
    flags.DEFINE_string("output", None, "folder for the files; if not given, the run's", values)
    program.define_count(values, "episodes", _EPISODES, "test episodes of each policy", least=1)
    return values


def _record(values: flags.FlagValues) -> None:
    task = lists.task(lists.task_word(values))
    run = None if values.run is None else Path(values.run)
    found, where = policies.of_task(task, run, typed=bool(values["task"].present))
    if not found:
        raise CommandError(f"{where} holds no policies of {task}")
    stages = policies.find(where / names.STAGES)
    output = Path(values.output) if values.output else run or Path("runs", task)
    for path in record(found, stages, output, values.episodes):
        print(path)


def record(
    found: Sequence[policies.Found],
    stages: Sequence[policies.Found],
    output: Path,
    episodes: int,
) -> list[Path]:
    """Replays policies of one task and writes the files into `output`; returns their paths.

    Args:
      stages: policies of the same agents in the course of training.

    Raises:
      CommandError: a policy cannot be loaded or run.
    """
    replays = [(policy, _replay(policy, episodes)) for policy in found]
    earlier = [(policy, _replay(policy, episodes)) for policy in stages]
    paths = [
        output / name for name in (names.STARTS, names.MAPS, names.FAILED_EPISODES, names.VALUES)
    ]
    output.mkdir(parents=True, exist_ok=True)
    spec = tasks.spec(found[0].task)
    goals, subgoals = spec.goal_space.names, spec.subgoal_space.names
    head = ["task", "subgoal_layers", "seed", "train_episodes", "episode"]
    starts = [*head, "success", "steps", *_named("start", subgoals), *_named("goal", goals)]
    _write_table(paths[0], starts, itertools.chain.from_iterable(map(_starts, replays)))
    points = [*_named("subgoal", subgoals), *_named("goal", goals)]
    maps = [*head, "level", "step", "outcome", *points]
    _write_table(paths[1], maps, itertools.chain.from_iterable(map(_maps, earlier or replays)))
    failed = [(played, index) for played, index in _failures([played for _, played in replays])]
    write_text(paths[2], json.dumps(anatomy(failed, found[0].task)) + "\n")
    write_text(paths[3], json.dumps(_values(found)) + "\n")
    return paths


def _named(kind: str, of: Sequence[str]) -> list[str]:
    return [f"{kind}_{name}" for name in of]


def _write_table(path: Path, head: Sequence[str], rows: Iterable[list[Any]]) -> None:
    def write(temporary: Path) -> None:
        with temporary.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(head)
            writer.writerows(rows)

    write_atomically(path, write)


def _replay(policy: policies.Found, episodes: int) -> Replayed:
    try:
        return replay(hac_suite.Policy.load(policy.path), episodes)
    except (KeyError, TypeError, ValueError) as error:
        raise CommandError(f"policy {policy.path}: {error}") from error


def _starts(replayed: tuple[policies.Found, Replayed]) -> Iterator[list[Any]]:
    """A row for each episode."""
    policy, played = replayed
    for episode, (success, steps) in enumerate(
        zip(played.stats.success, played.stats.steps, strict=True)
    ):
        points = [*played.path[0, episode], *played.goal[episode]]
        yield [*_key(policy), episode, int(success), int(steps), *_rounded(points)]


def _maps(replayed: tuple[policies.Found, Replayed]) -> Iterator[list[Any]]:
    """A row for each subgoal of every level."""
    policy, played = replayed
    for s in sorted(played.subgoals, key=lambda s: (s.episode, s.level, s.step)):
        points = [*s.subgoal, *played.goal[s.episode]]
        yield [*_key(policy), s.episode, s.level, s.step, s.outcome, *_rounded(points)]


def _key(policy: policies.Found) -> list[Any]:
    return [policy.task, policy.subgoal_layers, policy.seed, policy.train_episodes]


def _rounded(points: Iterable[float]) -> list[str]:
    return [f"{value:.{_DIGITS}f}" for value in points]


def _failures(replays: Sequence[Replayed]) -> Iterator[tuple[Replayed, int]]:
    """Some failures of each agent: the first of each seed, then the second of each, ..."""
    for layers in sorted({played.policy.subgoal_layers for played in replays}):
        own = [played for played in replays if played.policy.subgoal_layers == layers]
        lost = [[(played, int(i)) for i in np.flatnonzero(~played.stats.success)] for played in own]
        by_turns = itertools.chain.from_iterable(itertools.zip_longest(*lost))
        yield from itertools.islice(filter(None, by_turns), _GALLERY)


def _values(found: Sequence[policies.Found]) -> dict[str, Any]:
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
            "axes": [axis.round(_DIGITS).tolist() for axis in self.axes],
            "q": value.reshape(_GRID, _GRID).round(2).tolist(),
            "here": here[plane].round(_DIGITS).tolist(),
            "goal": None if goal is None else goal[plane].round(_DIGITS).tolist(),
        }


if __name__ == "__main__":
    sys.exit(main(sys.argv))
