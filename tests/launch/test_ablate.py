"""One command trains every variant: what each is trained with, and what is answered."""

import dataclasses

import pytest
import torch

import hac_suite
from launch import ablate
from launch.asking.request import Request


class Runs:
    """Stands in for `experiment.run`: keeps what would have been trained."""

    def __init__(self) -> None:
        self.requests: list[Request] = []
        self.commands: list[list[str]] = []
        self.statuses = [0, 1]  # the second has failed runs

    def __call__(self, request, command) -> int:
        self.requests.append(request)
        self.commands.append(list(command))
        return self.statuses.pop(0) if self.statuses else 0


@pytest.fixture
def runs() -> Runs:
    return Runs()


def test_every_variant_is_trained_in_a_folder_of_its_own_with_its_choice_alone(runs, tmp_path):
    words = ["launch/ablate.py", "--task=pendulum_balance", "--seeds=5", f"--out={tmp_path}"]
    assert ablate.main(words, run=runs) == 1
    usual = [name for name in ablate.VARIANTS if name != "bf16"]
    assert [request.out for request in runs.requests] == [tmp_path / name for name in usual]
    assert {request.tasks for request in runs.requests} == {("pendulum_balance",)}
    assert {len(request.seeds) for request in runs.requests} == {5}
    assert not any(request.video for request in runs.requests)
    assert runs.commands[2] == [*words, "--variants=release_2020"]
    configs = dict(zip(usual, (request.config for request in runs.requests), strict=True))
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


def test_a_variant_changes_the_config_that_was_typed(runs):
    words = ["", "--variants=release_2018,no_hindsight_goals", "--config.batch_size=32"]
    assert ablate.main(words, run=runs) == 1
    assert [request.config.batch_size for request in runs.requests] == [32, 32]
    assert {request.config.learning_rate for request in runs.requests} == {1e-3}  # the paper's
    assert [request.config.hindsight_goals for request in runs.requests] == [3, 0]


def test_some_variants_can_be_named(runs, capsys):
    assert ablate.main(["", "--variants=paper,no_hindsight_goals"], run=runs) == 1
    assert len(runs.requests) == 2
    assert ablate.main(["", "--variants=no_hindsight"], run=runs) == 2
    assert "did you mean 'no_hindsight_goals'?" in capsys.readouterr().err
    assert len(runs.requests) == 2


def test_bf16_is_a_variant_where_the_processor_has_it(runs, capsys, monkeypatch):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"amx_bf16": True})
    assert ablate.main(["", "--variants=paper,bf16"], run=runs) == 1
    exact, mixed = (request.config for request in runs.requests)
    assert mixed == dataclasses.replace(exact, precision="bf16")
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {})
    assert ablate.main(["", "--variants=paper,bf16"], run=runs) == 2
    assert "neither avx512_bf16 nor amx_bf16" in capsys.readouterr().err
    assert len(runs.requests) == 2


def test_a_signal_is_for_all(runs):
    runs.statuses = [0, 130]
    assert ablate.main([""], run=runs) == 130
    assert len(runs.requests) == 2


def test_a_wrong_command_is_answered_once_and_nothing_runs(runs, capsys):
    assert ablate.main(["", "--task=pick_plce"], run=runs) == 2
    assert capsys.readouterr().err.count("did you mean 'pick_place'?") == 1
    assert not runs.requests


def test_help_names_the_variants_and_each_flag_of_training_once(capsys):
    assert ablate.main(["", "--help"]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in ablate.VARIANTS)
    assert printed.count("\n  --seeds=") == printed.count("\n  --out=") == 1


def test_no_variants_are_answered(capsys):
    assert ablate.main(["launch/ablate.py", "--variants="]) == 2
    assert "--variants=: give one or more of paper, " in capsys.readouterr().err


def test_choices_of_a_release_are_the_same_from_whichever_preset(runs):
    words = ["", "--variants=release_2018,release_2020", "--config=launch/configs/suite.py"]
    assert ablate.main(words, run=runs) == 1
    for request, year in zip(runs.requests, ("release_2018", "release_2020"), strict=True):
        same_work = {"batch_size": 256, "updates_per_episode": 20}
        assert request.config == dataclasses.replace(hac_suite.PRESETS[year], **same_work)


def test_a_variant_that_cannot_be_is_answered_before_anything_is_trained(runs, capsys):
    words = ["", "--variants=paper,release_2020", "--config.learner=td3"]
    assert ablate.main(words, run=runs) == 2 and not runs.requests
    assert "variant release_2020: " in capsys.readouterr().err
