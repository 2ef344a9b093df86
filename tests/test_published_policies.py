"""The published policies still do what is said of them: each is replayed on 64 test episodes."""

import pytest

import hac_suite
import tasks
from launch.folder import policies
from launch.pictures.subgoal_log import replay
from tests.cases import some_slow

EPISODES = 64
MOST_LOST = 0.05  # of the success rate, as where another machine rounds otherwise

PUBLISHED = policies.find(policies.PUBLISHED)


OTHERS = [found for found in PUBLISHED if found.subgoal_layers != 1]


@pytest.mark.parametrize(
    "published", some_slow(PUBLISHED, *OTHERS), ids=lambda found: found.path.name
)
def test_a_published_policy_scores_what_it_scored(published):
    played = replay(hac_suite.Policy.load(published.path), EPISODES)
    assert played.stats.success.mean() >= published.success_rate - MOST_LOST


def test_each_agent_of_each_task_has_one_policy():
    agents = {task: [] for task in tasks.ALL}
    for found in PUBLISHED:
        agents[found.task].append(found.subgoal_layers)
    assert all(layers == [0, 1, 2] for layers in agents.values()), agents
