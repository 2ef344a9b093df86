"""Jobs: every missing seed once, populations kept together, work spread evenly over workers."""

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from launch.folder.agents import Agent
from launch.jobs.planning import Group, makespan, plan


def test_the_main_job_fills_two_workers_evenly():
    seeds = tuple(range(10))
    jobs = plan({Group(Agent("pick_place", layers)): seeds for layers in (0, 1, 2)}, workers=2)
    assert [job.agent.subgoal_layers for job in jobs] == [2, 1, 0]
    assert makespan([job.cost for job in jobs], 2) == pytest.approx(jobs[0].cost)


def test_a_lone_agent_is_split_over_the_workers():
    jobs = plan({Group(Agent("ur5_reacher", 1)): (0, 1, 2)}, workers=2)
    assert [job.seeds for job in jobs] == [(0, 1), (2,)]


def test_workers_share_what_they_cannot_share_evenly_in_whole_populations():
    seeds = tuple(range(10))
    names = ("pick_place", "ur5_reacher", "pendulum_climb")
    alike = {Group(Agent(task, 1)): seeds for task in names}
    even = sum(2 * len(seeds) for seeds in alike.values())
    for workers, most in ((2, 1.1), (4, 1.35), (8, 1.5)):  # whole: 1.4, 2.8 and 2.8 times even
        costs = [job.cost for job in plan(alike, workers)]
        assert makespan(costs, workers) <= most * even / workers
    assert [len(job.seeds) for job in plan({Group(Agent("ur5_reacher", 0)): seeds}, 3)] == [4, 3, 3]


def test_no_more_jobs_than_a_shorter_launch_needs():
    seeds = tuple(range(10))
    alike = {Group(Agent(task, 1)): seeds for task in ("pick_place", "ur5_reacher")}
    assert len(plan(alike, workers=2)) == 2


def test_one_worker_keeps_populations_whole():
    assert len(plan({Group(Agent("ur5_reacher", 1)): (0, 1, 2)}, workers=1)) == 1


@pytest.mark.parametrize("missing", [{}, {Group(Agent("ur5_reacher", 1)): ()}])
def test_nothing_missing_means_no_jobs(missing):
    assert plan(missing, workers=4) == []


@given(
    st.dictionaries(
        st.builds(
            Group,
            st.builds(Agent, st.sampled_from(["a", "b"]), st.integers(0, 2)),
            st.sampled_from([0, 4, 8]),
        ),
        st.sets(st.integers(0, 30)).map(lambda seeds: tuple(sorted(seeds))),
    ),
    st.integers(1, 9),
)
def test_every_missing_seed_is_in_exactly_one_job(missing, workers):
    # A seed stands at one episode.
    seen: set[tuple[Agent, int]] = set()
    for group, seeds in missing.items():
        missing[group] = tuple(seed for seed in seeds if (group.agent, seed) not in seen)
        seen.update((group.agent, seed) for seed in seeds)
    jobs = plan(missing, workers, episodes=9)
    planned = sorted((job.agent, job.start, seed) for job in jobs for seed in job.seeds)
    assert planned == sorted((*group, seed) for group, seeds in missing.items() for seed in seeds)
    assert len({job.name for job in jobs}) == len(jobs)
    assert [job.cost for job in jobs] == sorted((job.cost for job in jobs), reverse=True)
    assert len(jobs) >= min(workers, len(planned))


def test_seeds_go_on_only_with_those_that_stand_where_they_do():
    agent = Agent("ur5_reacher", 1)
    groups = {Group(agent, 900): (0, 2), Group(agent, 300): (1, 3, 4), Group(agent, 0): (5,)}
    jobs = plan(groups, workers=1, episodes=1000)
    assert [(job.seeds, job.start) for job in jobs] == [((1, 3, 4), 300), ((5,), 0), ((0, 2), 900)]


@pytest.mark.slow
def test_as_many_seeds_and_workers_as_there_may_be_are_planned_in_seconds():
    seeds = tuple(range(10_000))
    start = time.process_time()
    jobs = plan({Group(Agent("a", layers)): seeds for layers in range(3)}, 1000)
    assert time.process_time() - start < 10
    assert len(jobs) >= 1000
    for layers in range(3):
        own = [seed for job in jobs if job.agent.subgoal_layers == layers for seed in job.seeds]
        assert sorted(own) == list(seeds)
