"""What a trial is worth: areas computed by hand."""

import numpy as np
import pytest

import hac_suite
from launch.tuning import trial


@pytest.mark.parametrize(
    ("success", "minutes", "budget", "by_episodes", "by_minutes"),
    [
        ([0, 0.5, 1], [0, 1, 2], 2, 0.75, 0.5),
        ([0, 0.5, 1], [0, 1, 2], 4, 0.75, 0.75),  # the last success is held
        ([0, 0.5, 1], [0, 1, 2], 1, 0.75, 0.25),  # what is learnt later does not count
        ([0, 0.5, 1], [0, 1, 2], 1.5, 0.75, (0.25 + 0.5 * (0.5 + 0.75) / 2) / 1.5),
        ([0, 0.5, 1], [0, 4, 8], 2, 0.75, 0.125),  # the same curve, four times as slow
        ([0.2, 0.2], [0, 3], 1, 0.2, 0.2),
        ([0, 0, 0], [0, 1, 2], 5, 0, 0),
        ([1, 1, 1], [0, 1, 2], 5, 1, 1),
    ],
)
def test_half_by_episodes_and_half_by_core_minutes(
    success, minutes, budget, by_episodes, by_minutes
):
    curves = np.array([success, np.zeros(len(success))]).T
    found = trial.objective(curves, np.array(minutes, float), budget)
    assert found == pytest.approx([(by_episodes + by_minutes) / 2, 0])


def test_tasks_count_alike_for_each_seed():
    def curve(task, rates):
        agent = trial.Agent(task, 0, (10,), hac_suite.Config(), (100, 105), 1)
        made = trial.Curve(agent)
        for minutes, own in enumerate(rates):
            rows = [
                {"seed": seed, "success_rate": rate, "train_steps": 5}
                for seed, rate in zip(agent.seeds, own, strict=True)
            ]
            made.add(rows, float(minutes))
        return made

    curves = [curve("a", [(1, 1), (1, 0)]), curve("b", [(0, 0), (0, 0)])]
    assert trial.values(curves, 1.0) == pytest.approx({100: 0.5, 105: (0 + 0.5) / 4})
    assert trial.as_json(curves)["a"] == {
        "T": [10], "success": [[1, 1], [1, 0]], "minutes": [0, 1], "train_steps": [10, 10],
    }  # fmt: skip
