"""Agents, and the jobs that train some of an agent's seeds."""

from typing import NamedTuple

from analysis.reading import paper

_OVERHEAD = 0.4  # what a population takes whatever its size, in seeds (measured on ur5_reacher)


class Agent(NamedTuple):
    """One curve in the figure: a task and a number of subgoal layers."""

    task: str
    subgoal_layers: int

    def __str__(self) -> str:
        return f"{self.task}, {paper.agent_name(self.subgoal_layers)}"


class Job(NamedTuple):
    """One agent and the seeds that one worker process trains as a population."""

    agent: Agent
    seeds: tuple[int, ...]
    start: int = 0  # the training episode of each seed that it goes on from
    stop: int = 1  # and the one that it ends with

    @property
    def name(self) -> str:
        """Unique within a launch, and fit for a file name."""
        first, last = min(self.seeds), max(self.seeds)
        return f"{self.agent.task}_{self.agent.subgoal_layers}layers_seeds{first}-{last}"

    @property
    def cost(self) -> float:
        """Relative duration: every level of every seed has its own networks to update."""
        episodes = self.stop - self.start
        return (self.agent.subgoal_layers + 1) * (len(self.seeds) + _OVERHEAD) * episodes
