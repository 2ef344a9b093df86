"""The benchmark's arithmetic, against numbers worked out by hand."""

import functools
import math
from types import SimpleNamespace
from typing import Any

import pytest

from launch.folder.agents import Agent, Job
from tests.bench import limits, panel
from tests.bench.repeats import entry, summary
from tests.bench.team import Team
from tests.bench.work import Meter, Work, total
from tests.bench.writing import Written


def test_the_median_lies_in_its_interval_and_the_interval_among_the_samples():
    middle, (low, high) = summary([5.0, 1.0, 2.0, 4.0, 30.0])
    assert middle == 4.0
    assert 1.0 <= low < middle < high <= 30.0


def test_equal_samples_leave_no_doubt():
    assert summary([2.5] * 5) == (2.5, [2.5, 2.5])


def test_no_samples_have_no_median():
    with pytest.raises(ValueError, match="nothing was measured"):
        summary([])


def test_an_entry_has_its_interval_beside_it():
    assert entry("ratio", [1 / 3] * 5) == {"ratio": 0.3333, "ratio_ci": [0.3333, 0.3333]}


def test_update_flops_by_hand():
    # The products alone: not the bias rows, and not the second output column that only pads.
    actor = SimpleNamespace(sizes=(3, 4, 2), outputs=1)
    critic = SimpleNamespace(sizes=(4, 5, 2), outputs=1)
    actor_1, actor_2 = 2 * 3 * 4, 2 * 4 * 1
    critic_1, critic_2 = 2 * 4 * 5, 2 * 5 * 1
    by_hand = [
        actor_1 + actor_2,  # target actor
        critic_1 + critic_2,  # target critic
        critic_1 + critic_2,  # critic
        critic_1 + critic_2,  # its weights' gradients
        critic_2,  # its hidden layer's gradient
        actor_1 + actor_2,  # actor
        critic_1 + critic_2,  # critic of its action
        critic_2,  # back to the hidden layer
        2 * 1 * 5,  # and to the action
        actor_1 + actor_2,  # the actor's weights' gradients
        actor_2,  # its hidden layer's gradient
    ]
    learner: Any = SimpleNamespace(actor=actor, critic=critic)
    assert limits.update_flops(learner, 7) == 7 * sum(by_hand)


def test_work_adds_up_and_bookkeeping_is_what_is_left():
    work = Work(10.0, 4, 30, update_seconds=5.0, physics_seconds=2.0, acting_seconds=1.0)
    assert work.bookkeeping_seconds == 2.0
    assert total([work, work]) == Work(20.0, 8, 60, 10.0, 4.0, 2.0)


def test_a_meter_counts_one_piece_of_work_only():
    meter = Meter()
    act = meter.timed("acting", sum)
    act([1])
    work = meter.measure(lambda: [act([1]), act([2])])
    assert 0 < work.acting_seconds < work.seconds
    assert (work.update_seconds, work.physics_seconds) == (0, 0)
    assert meter.measure(lambda: None).acting_seconds == 0


@pytest.mark.slow
def test_a_team_works_side_by_side_and_reports_failures():
    with Team(functools.partial, [(pow, 2), (pow, 3)]) as team:
        seconds, answers = team.work(5)
        assert answers == [32, 243]
        assert 0 < seconds < team.start_seconds
        with pytest.raises(RuntimeError, match="TypeError"):
            team.work("five")


def test_a_panel_by_hand():
    # Per round of 2 s: 1 s updates, 0.5 s physics, 0.25 s acting, so 0.25 s bookkeeping.
    work = Work(2.0, 800, 1000, update_seconds=1.0, physics_seconds=0.5, acting_seconds=0.25)
    sample = panel.Sample([work], test_seconds=10.0, save_seconds=1.0, gib=1.5, rows=[])
    jobs = [
        panel.Measured(Job(Agent("pick_place", layers), (0, 1)), 4.0, [sample, sample])
        for layers in (2, 1, 0)
    ]
    report = panel.report({"pick_place": jobs}, Written(seconds=30.0, gib=0.5))
    job = 4 + 750 * 2 + 11 * 10 + 1
    assert report["panel_minutes"]["pick_place"] == pytest.approx((2 * job + 15) / 60, rel=1e-3)
    whole = 3 * job + 30
    share = 3 * (750 * 0.5 + 11 * 10) / whole
    assert report["non_update_share"] == pytest.approx(share, rel=1e-3)
    assert math.isclose(sum(report["panel_shares"]["pick_place"].values()), 1, rel_tol=1e-3)
    assert report["peak_memory_gib"] == 3.5
