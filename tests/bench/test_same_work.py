"""We and our peers do the same work, as counted on both sides."""

import dataclasses

import pytest

import hac_suite
import tasks
from tests.bench.plain_hac import ArrayReplay, PlainAgents, Replay
from tests.bench.population import Training
from tests.bench.same_work import Ours, check
from tests.bench.work import whole_horizon

pytestmark = pytest.mark.slow  # the benchmark's own work, which takes seconds

TASK = "pendulum_climb"
SEEDS = (3, 8)
CONFIG = dataclasses.replace(
    hac_suite.PRESETS["paper"],
    batch_size=8,
    updates_per_episode=2,
    episodes_per_round=2,
    replay_capacity=5000,
    test_episodes=1,
)
EPISODES = 2 * len(SEEDS)  # a round of all seeds


@pytest.mark.parametrize("subgoal_layers", [0, 1, 2])
def test_our_rounds(subgoal_layers):
    work = Ours(TASK, CONFIG, SEEDS, subgoal_layers)(2)
    check(work, TASK, CONFIG, subgoal_layers, EPISODES)
    assert work.bookkeeping_seconds > 0
    assert min(work.update_seconds, work.physics_seconds, work.acting_seconds) > 0


@pytest.mark.parametrize("replay", [Replay, ArrayReplay])
@pytest.mark.parametrize("subgoal_layers", [1, 2])
def test_the_plain_agents(subgoal_layers, replay):
    agents = PlainAgents(TASK, CONFIG, SEEDS, subgoal_layers, replay)
    for _ in range(2):  # each call counts its own
        work = agents(2)
        check(work, TASK, CONFIG, subgoal_layers, EPISODES)
        assert min(work.update_seconds, work.physics_seconds) > 0


def test_stable_baselines3():
    pytest.importorskip("stable_baselines3")
    from tests.bench.sb3_peer import Sb3Agents

    agents = Sb3Agents(TASK, CONFIG, SEEDS)
    for _ in range(2):
        work = agents(2)
        check(work, TASK, CONFIG, 0, EPISODES)
        assert min(work.update_seconds, work.physics_seconds) > 0


def test_stable_baselines3_has_our_networks():
    pytest.importorskip("stable_baselines3")
    from tests.bench.sb3_peer import Sb3Agents

    model = Sb3Agents(TASK, CONFIG, [0])._agents[0]._model
    ours = Training(TASK, CONFIG, [0], 0).learners[0]
    goal = tasks.load_vector(TASK, 1).goal_space.dim
    for theirs, network, unseen in (
        (model.actor, ours.actor, goal),
        (model.critic, ours.critic, goal),
    ):
        weights = [p for p in theirs.parameters() if p.ndim == 2]
        widths = [weights[0].shape[1], *(weight.shape[0] for weight in weights)]
        # The library's networks also see the achieved goal.
        assert widths == [network.sizes[0] + unseen, *network.sizes[1:-1], network.outputs]


@pytest.mark.parametrize("field", ["updates", "env_steps"])
def test_other_work_is_refused(field):
    work = Ours(TASK, CONFIG, SEEDS, 0)(2)
    with pytest.raises(AssertionError):
        check(work._replace(**{field: getattr(work, field) - 1}), TASK, CONFIG, 0, EPISODES)


def test_goals_out_of_reach_are_not_achieved_by_what_is_near():
    env = whole_horizon(tasks.load_vector(TASK, 1))
    for space in (env.goal_space, env.subgoal_space):
        middle = (space.low + space.high) / 2
        assert not space.achieved(middle, middle + 1e-9)


def test_buffers_are_filled_with_what_rounds_store():
    training = Training(TASK, CONFIG, SEEDS, 1)
    replays = training._training.population.replays
    training.fill_as_after(3 * CONFIG.episodes_per_round)
    in_a_round = replays[0].sizes.mean() / 3
    assert 0 < in_a_round < CONFIG.replay_capacity / 3
    training.fill([4000, 10**9])
    assert replays[0].sizes.min() >= 4000
    assert list(replays[1].sizes) == [CONFIG.replay_capacity] * len(SEEDS)
    assert "add" not in vars(replays[0])
