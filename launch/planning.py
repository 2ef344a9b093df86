"""Which jobs there are, and in which order the workers take them."""

from collections.abc import Mapping
from typing import NamedTuple


class Agent(NamedTuple):
    """What a curve in the figure stands for: a task and a number of subgoal layers."""

    task: str
    subgoal_layers: int

    def __str__(self) -> str:
        plural = "" if self.subgoal_layers == 1 else "s"
        return f"{self.task}, {self.subgoal_layers} subgoal layer{plural}"


class Job(NamedTuple):
    """One agent and the seeds that one worker process trains as a population."""

    agent: Agent
    seeds: tuple[int, ...]

    @property
    def name(self) -> str:
        """Unique within a launch, and fit for a file name."""
        first, last = min(self.seeds), max(self.seeds)
        return f"{self.agent.task}_{self.agent.subgoal_layers}layers_seeds{first}-{last}"

    @property
    def cost(self) -> int:
        """Relative duration: every level of every seed has its own networks to update."""
        return (self.agent.subgoal_layers + 1) * len(self.seeds)


def plan(missing: Mapping[Agent, tuple[int, ...]], workers: int) -> list[Job]:
    """Jobs for the missing seeds of each agent, longest first.

    An agent's seeds stay together, since a population shares its matrix products; the longest job
    is halved only while there are fewer jobs than workers. A seed's results do not depend on the
    seeds it is trained with, so that any grouping gives the same experiment.
    """
    jobs = [Job(agent, tuple(seeds)) for agent, seeds in missing.items() if seeds]
    while jobs and len(jobs) < workers:
        longest = max((job for job in jobs if len(job.seeds) > 1), key=_cost, default=None)
        if longest is None:
            break
        jobs.remove(longest)
        half = (len(longest.seeds) + 1) // 2
        jobs += [Job(longest.agent, longest.seeds[:half]), Job(longest.agent, longest.seeds[half:])]
    return sorted(jobs, key=_cost, reverse=True)


def _cost(job: Job) -> int:
    return job.cost
