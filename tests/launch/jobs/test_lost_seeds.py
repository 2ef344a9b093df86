"""A seed whose weights become NaN: it stops, is named, and harms nobody."""

import json

import pytest

from hac_suite.training.population import Population
from launch.folder.layout import RunFolder
from tests.launch.lives import TASK, live, outcome, standings, tiny

__all__ = ["tiny"]

WORDS = ("--seeds=3", "--subgoal_layers=1", "--periods=2", "--workers=1")


def spoiling(seed: int, episodes: int, level: int = 1, value: float = float("nan")):
    """What spoils a weight of one seed in the round of updates that ends at an episode."""

    def patch() -> None:
        learn = Population.learn

        def spoilt(self) -> None:
            learn(self)
            if seed in self.seeds:
                index = self.seeds.index(seed)
                if self.updates(index, 0) == episodes:  # an update for each episode
                    self.learners[level].critic.parameters[index, 5] = value

        Population.learn = spoilt  # type: ignore[method-assign]

    return patch


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_the_other_seeds_do_not_change_by_a_bit(tmp_path, tiny, value):
    assert live(tmp_path / "whole", *WORDS)[0] == 0
    status, printed = live(tmp_path / "spoilt", *WORDS, first=spoiling(1, 16, value=value))
    assert status == 1
    reason = (
        "a weight or a transition of level 1 was not finite after 16 updates (16 training episodes)"
    )
    assert f"failed: {TASK}, 1 subgoal layer, seeds 1: {reason}" in printed
    whole, spoilt = outcome(tmp_path / "whole"), outcome(tmp_path / "spoilt")
    lost = {("1", "1", "2")}  # subgoal layers, seed, period
    assert spoilt["rows"] == [row for row in whole["rows"] if row[1:4] not in lost]
    policies = {name: file for name, file in whole["policies"].items() if "seed1." not in name}
    assert spoilt["policies"] == policies
    folder = RunFolder(tmp_path / "spoilt", TASK)
    recorded = json.loads(folder.manifest.read_text())
    assert [failure["seeds"] for failure in recorded["failures"]] == [[1]]
    assert [job["seeds"] for job in recorded["jobs"]] == [[0, 2]]
    ended = {f"{TASK}_1layers_seed{seed}": 24 for seed in (0, 2)}
    assert standings(tmp_path / "spoilt") == {**ended, f"{TASK}_1layers_seed1": 12}


def test_a_launch_whose_seeds_are_all_lost_ends_and_says_so(tmp_path, tiny):
    words = ("--seeds=1", "--subgoal_layers=0", "--periods=1", "--workers=1")
    status, printed = live(tmp_path, *words, first=spoiling(0, 8, level=0))
    assert status == 1 and printed.count("failed: ") == 1
    assert "a weight or a transition of level 0 was not finite after 8 updates" in printed
    assert "Traceback" not in printed
