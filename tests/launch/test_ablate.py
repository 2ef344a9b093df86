"""One command trains every variant: what each is trained with, and what is answered."""

import dataclasses

import pytest

import hac_suite
from launch import ablate, run
from launch.asking import request


@pytest.fixture
def requests(monkeypatch) -> list[request.Request]:
    """What would have been trained."""
    found = []

    def main(argv):
        found.append(request.parse(argv))
        return len(found) == 2  # the second has failed runs

    monkeypatch.setattr(run, "main", main)
    return found


def test_every_variant_is_trained_in_a_folder_of_its_own_with_its_choice_alone(requests, tmp_path):
    words = ["launch/ablate.py", "--task=pendulum_balance", "--seeds=5", f"--out={tmp_path}"]
    assert ablate.main(words) == 1
    assert [request.out for request in requests] == [tmp_path / name for name in ablate.VARIANTS]
    assert {request.tasks for request in requests} == {("pendulum_balance",)}
    assert {len(request.seeds) for request in requests} == {5}
    configs = dict(zip(ablate.VARIANTS, (request.config for request in requests), strict=True))
    paper = hac_suite.PRESETS["paper"]
    assert configs["paper"] == paper
    for year in ("release_2018", "release_2020"):
        same_work = {"batch_size": 256, "updates_per_episode": 20}
        assert configs[year] == dataclasses.replace(hac_suite.PRESETS[year], **same_work)
    for name in ("no_subgoal_tests", "no_hindsight_actions", "no_hindsight_goals"):
        old, new = dataclasses.asdict(paper), dataclasses.asdict(configs[name])
        (changed,) = [field for field in old if old[field] != new[field]]
        assert not new[changed]
    assert configs["penalise_cut_short"] == dataclasses.replace(paper, penalise_cut_short=True)


def test_some_variants_can_be_named(requests, capsys):
    assert ablate.main(["", "--variants=paper,no_hindsight_goals"]) == 1
    assert len(requests) == 2
    assert ablate.main(["", "--variants=no_hindsight"]) == 2
    assert "did you mean 'no_hindsight_goals'?" in capsys.readouterr().err
    assert len(requests) == 2


def test_a_wrong_command_is_answered_once(monkeypatch, capsys):
    assert ablate.main(["", "--task=pick_plce"]) == 2
    assert capsys.readouterr().err.count("did you mean 'pick_place'?") == 1


def test_help_names_the_variants(capsys):
    assert ablate.main(["", "--help"]) == 0
    assert all(name in capsys.readouterr().out for name in ["no_subgoal_tests"])
