"""Which trials are taken for dead, and what a journal may hold."""

import dataclasses
import os
import re
from pathlib import Path

import optuna
import pytest
from optuna.storages.journal import JournalFileBackend, JournalStorage
from optuna.trial import TrialState

from launch.tuning import space
from launch.tuning.study import Asked, Buried, Study

ASKED = Asked(("pendulum_climb",), 0, None, (100, 101), 3)
ALL = space.read(space.FILE)
SPACE = dataclasses.replace(
    ALL, starts={label: ALL.starts[label] for label in ("default", "candidate")}
)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "x.journal"


def opened(path, hours=1.0):
    return Study(path, ASKED, SPACE, hours)


def rewrite(path, pattern, by):
    text, count = re.subn(pattern, by, path.read_text())
    assert count
    path.write_text(text)


def claim(path):
    """What another worker claims: the trial's number, and those that it finds dead."""
    dead = []
    trial = opened(path).claim(lambda trial: dead.append(trial.number))
    return trial.number, dead


def test_a_trial_of_a_living_process_is_left_alone(path):
    study = opened(path)
    study.beat(study.claim(print), 1.0)
    rewrite(path, r'"alive":\d+', '"alive":5')  # silent for long: a laptop that slept
    assert claim(path) == (1, [])


def test_a_later_process_of_the_same_id_is_another(path):
    study = opened(path)
    study.beat(study.claim(print), 1.0)
    rewrite(path, r'"started":"\d+"', '"started":"7"')
    assert claim(path) == (1, [0])


def test_a_process_that_died_and_was_not_looked_at_is_dead(path):
    study = opened(path)
    study.beat(study.claim(print), 1.0)
    child = os.fork()
    if not child:
        os._exit(0)
    os.waitid(os.P_PID, child, os.WEXITED | os.WNOWAIT)
    started = Path(f"/proc/{child}/stat").read_text().split()[21]
    rewrite(path, r'"pid":\d+,"started":"\d+"', f'"pid":{child},"started":"{started}"')
    assert claim(path) == (1, [0])
    os.waitpid(child, 0)


@pytest.mark.parametrize(
    "change", [('"host":"[^"]*"', '"host":"elsewhere"'), ('"boot":"[^"]*"', '"boot":"2"')]
)
def test_a_trial_of_another_machine_is_dead_once_it_is_silent_for_long(path, change):
    study = opened(path)
    study.beat(study.claim(print), 1.0)
    rewrite(path, *change)
    assert claim(path) == (1, [])
    rewrite(path, r'"alive":(\d+)', lambda found: f'"alive":{int(found[1]) - 1000}')
    number, dead = claim(path)
    assert (number, dead) == (2, [0])
    again = opened(path).trials()[2]
    assert again.params["hindsight"] == "preceding 3"
    assert again.user_attrs["retry_of"] == 0 and again.user_attrs["label"] == "default"


def test_who_was_taken_for_dead_learns_it_at_whatever_it_does_next(path):
    study = opened(path)
    trial = study.claim(print)
    storage = JournalStorage(JournalFileBackend(str(path)))
    optuna.load_study(study_name=ASKED.name, storage=storage).tell(0, state=TrialState.FAIL)
    for act in (
        lambda: study.beat(trial, 1.0),
        lambda: study.report(trial, 1, 0.5),
        lambda: study.complete(trial, 0.5, note=1),
        lambda: study.fail(trial, again=True, ended="stopped"),
    ):
        with pytest.raises(Buried):
            act()
    assert [t.state for t in study.trials()] == [TrialState.FAIL, TrialState.WAITING]


def test_a_start_that_raised_is_tried_again_once_by_each_launch(path):
    study = opened(path)
    study.fail(study.claim(print), again=False, ended="RuntimeError: no")

    def waiting(study):
        return [t.user_attrs["label"] for t in study.trials() if t.state == TrialState.WAITING]

    assert waiting(Study(path, ASKED, SPACE, 1.0, retries=False)) == ["candidate"]
    assert waiting(opened(path)) == ["candidate", "default"]
    assert waiting(opened(path)) == ["candidate", "default"]


def test_what_is_open_is_what_was_begun(path):
    study = opened(path)
    study.fail(study.claim(print), again=False, cpu_seconds=1800.0)
    assert study.core_hours() == 0.5 and opened(path, 0.5).claim(print) is None
    assert opened(path, 0.6).claim(print).number == 1
    before = path.read_bytes()
    opened(path, 0.6)  # adds nothing
    assert path.read_bytes() == before
