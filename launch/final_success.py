"""Measures whether agents stay at the goal: `python launch/final_success.py --task=TASK`."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from absl import flags
from rich.table import Table

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

    from launch.asking import start

    start.without_display()

import numpy as np

import hac_suite
import tasks
from analysis import program
from analysis.program import CommandError
from analysis.reading import names, paper
from hac_suite.algorithm import exploration
from launch.asking import lists, settings
from launch.asking.console import Console
from launch.folder import manifest, policies

_HELP = """Measures success at the end of test episodes, not only at the first touch of the goal.

  python launch/final_success.py --task=gym:gymnasium_robotics:FetchReach-v4

The suite counts the first touch of the goal as success. Other benchmarks count whether the goal is
achieved at the end of the episode. This program plays test episodes to their last step. It prints
both rates for each agent, as mean and range over seeds, and the share of steps after the first
touch at which the goal is achieved.

Flags:
{flags}

Exit status: 0; 2 the command was wrong."""


class Held(NamedTuple):
    """Shares over the test episodes of one policy."""

    touched: float  # the goal was achieved at some step
    at_end: float  # it was achieved at the last
    after: float  # of the steps after the first touch; NaN where there was none


class _Unending:
    """An environment whose episodes continue after the goal; records when it is achieved."""

    def __init__(self, env: Any):
        self._env, self.held = env, list[np.ndarray]()
        self.goal_space = _NeverAchieved(env.goal_space)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._env, name)

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> Any:
        state = self._env.step(actions, mask)
        space = self._env.goal_space
        self.held.append(space.achieved(state.achieved_goal, state.desired_goal) & ~state.diverged)
        return state


class _NeverAchieved:
    """A space whose end goals are never reported as achieved."""

    def __init__(self, space: Any):
        self._space = space

    def __getattr__(self, name: str) -> Any:
        return getattr(self._space, name)

    def achieved(self, achieved: np.ndarray, goal: np.ndarray) -> np.ndarray:
        return np.zeros(np.broadcast_shapes(achieved.shape, goal.shape)[:-1], bool)


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = flags.FlagValues()
    lists.define_task(values, "pick_place", lists.ANY_TASK)
    flags.DEFINE_string("run", None, "run folder; default: runs/TASK", values)
    program.define_count(values, "episodes", 64, "test episodes of each policy", least=1)
    return program.carry_out(program.Program(_HELP, values), argv, lambda _: _show(values))


def _show(values: flags.FlagValues) -> None:
    task = lists.task(lists.task_word(values))
    folder = Path("runs", task) if values.run is None else Path(values.run)
    manifest.check_same_task(folder / names.MANIFEST, tasks.find(task))
    found = [own for own in policies.find(folder / names.POLICIES) if own.task == task]
    if not found:
        raise CommandError(policies.lacking(folder, task))
    table = Table(box=None, pad_edge=False, header_style="bold")
    headings = ("agent", "seeds", "first touch", "at the end", "steps held after")
    for heading in headings:
        table.add_column(heading, justify="left" if heading == "agent" else "right")
    for layers in sorted({own.subgoal_layers for own in found}):
        own = [policy for policy in found if policy.subgoal_layers == layers]
        measured = [measure(policy.path, values.episodes) for policy in own]
        cells = [_cell(column) for column in zip(*measured, strict=True)]
        table.add_row(paper.agent_name(layers), str(len(own)), *cells)
    Console().print(table)


def measure(path: Path, episodes: int) -> Held:
    """Plays test episodes of a policy's own seed to their last step.

    Raises:
      CommandError: the policy cannot be loaded or run.
    """
    try:
        policy = hac_suite.Policy.load(path)
        seeds = exploration.episode_seeds(
            policy.metadata["seed"], exploration.Purpose.TEST_EPISODE, 0, episodes
        )
        env = _Unending(tasks.load_vector(policy.metadata["task"], episodes))
        config = settings.to_config(policy.metadata["config"])
        hac_suite.run_episodes(env, policy, seeds, config=config)
    except (KeyError, TypeError, ValueError) as error:
        raise CommandError(f"policy {path}: {error}") from error
    env.close()
    held = np.array(env.held)  # [T, E]
    touched = np.logical_or.accumulate(held, axis=0)
    after = touched[:-1]
    return Held(
        touched=float(touched[-1].mean()),
        at_end=float(held[-1].mean()),
        after=float(held[1:][after].mean()) if after.any() else np.nan,
    )


def _cell(values: Sequence[float]) -> str:
    known = [value for value in values if np.isfinite(value)]
    if not known:
        return "-"
    mean = f"{np.mean(known):.0%}"
    return mean if len(known) == 1 else f"{mean} ({min(known):.0%} to {max(known):.0%})"


if __name__ == "__main__":
    sys.exit(main(sys.argv))
