"""Core-minutes to 90%, by the published rows and two curves made up."""

import pandas as pd
import pytest

from analysis.reading import grid
from analysis.reading.results import load
from analysis.statistics.peers import COLUMNS
from tests.bench.learning import waits

TASK = "pendulum_balance"


def _curve(agent: str, success: float) -> pd.DataFrame:
    """A seed that is tested before its training, and after 40 core-minutes."""
    rows = [
        (TASK, agent, "zoo", 100, 0, 0, 0.0, 0.0, 64),
        (TASK, agent, "zoo", 100, 300, 40_000, 40.0, success, 64),
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def test_the_fastest_of_each_side_is_compared():
    published = {TASK: load(grid.FOLDER / TASK)}
    report = waits(published, pd.concat([_curve("sac", 1.0), _curve("td3", 0.89)]), {})
    minutes = report["minutes_to_90"][TASK]
    assert minutes["sac zoo"] == 36.0 and minutes["td3 zoo"] is None
    ours = [minutes[f"hac {layers}"] for layers in ("0 subgoal layers", "1 subgoal layer")]
    assert min(ours) < 5
    assert report["minutes_to_90_ratio"][TASK] == pytest.approx(36 / min(ours), rel=1e-3)


def test_no_ratio_where_one_side_never_gets_there():
    published = {TASK: load(grid.FOLDER / TASK)}
    for strangers in (None, _curve("td3", 0.5)):
        report = waits(published, strangers, {"40 updates": published})
        names = list(report["minutes_to_90"][TASK])
        assert {"hac 1 subgoal layer", "hac 1 subgoal layer, 40 updates"} < set(names)
        assert report["minutes_to_90_ratio"] == {} and len(names) >= 6
