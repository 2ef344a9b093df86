"""Tuning: what a study tries first, its budget, and what a kill, a stop or a second worker does."""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import optuna
import pytest
from optuna.trial import TrialState

import hac_suite
from launch import tune
from tests.launch import fake_trainings

ROOT = Path(__file__).resolve().parents[2]
NAME = "pendulum_climb_1layers"
SECOND = 1 / 3600  # in hours
_FOLDER = tempfile.TemporaryDirectory()  # for the length of the test run
TWO_STARTS = Path(_FOLDER.name, "two_starts.toml")
TWO_STARTS.write_text(tune.space.FILE.read_text().split("# Hindsight and critic as in")[0])


def words(out, *, seconds=60.0, more=()):
    return [
        "launch/tune.py", "--task=pendulum_climb", "--seeds=100-101", "--periods=3",
        f"--search={TWO_STARTS}", f"--hours={seconds * SECOND}", f"--out={out}", *more,
    ]  # fmt: skip


def study(out, name=NAME):
    backend = optuna.storages.journal.JournalFileBackend(str(out / f"{name}.journal"))
    return optuna.load_study(
        study_name=None, storage=optuna.storages.journal.JournalStorage(backend)
    )


def seconds(trials):
    return sum(trial.user_attrs.get("cpu_seconds", 0.0) for trial in trials)


def of_state(trials, state):
    return [trial for trial in trials if trial.state == state]


@pytest.mark.slow
def test_the_budget_is_that_of_all_launches_together(tmp_path, capsys):
    assert tune.main(words(tmp_path, seconds=0.3), train=fake_trainings.quick) == 0
    first = study(tmp_path).trials
    assert 0.3 <= seconds(first) < 1 and len(of_state(first, TrialState.COMPLETE)) >= 2
    assert tune.main(words(tmp_path, seconds=1.2), train=fake_trainings.quick) == 0
    both = study(tmp_path).trials
    assert 1.2 <= seconds(both) < 2 and len(both) > len(first)
    assert tune.main(words(tmp_path, seconds=1.2), train=fake_trainings.raises) == 0
    assert len(study(tmp_path).trials) == len(both)
    assert study(tmp_path).user_attrs["hours"] == 1.2 * SECOND
    assert f"{seconds(both) / 60:.1f} of {1.2 / 60:g} core-minutes used" in capsys.readouterr().out


def test_a_trial_that_the_budget_ends_waits_for_more(tmp_path):
    assert tune.main(words(tmp_path, seconds=0.4), train=fake_trainings.endless) == 0
    ended, *waiting = study(tmp_path).trials
    assert (ended.state, ended.user_attrs["ended"]) == (TrialState.FAIL, "budget")
    assert 0.4 <= ended.user_attrs["cpu_seconds"] < 1.4
    assert {trial.user_attrs["label"] for trial in waiting} == {"default", "candidate"}
    assert {trial.state for trial in waiting} == {TrialState.WAITING}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Trials of a study whose budget is used up."""
    out = tmp_path_factory.mktemp("finished")
    assert tune.main(words(out, seconds=2), train=fake_trainings.quick) == 0
    return study(out).trials


@pytest.mark.slow
def test_the_defaults_and_the_candidate_come_first_and_are_never_pruned(finished):
    labels = [trial.user_attrs.get("label") for trial in finished]
    assert labels[:3] == ["default", "candidate", None]
    assert [trial.state for trial in finished[:2]] == [TrialState.COMPLETE] * 2
    assert finished[0].params["hindsight"] == "preceding 3"
    assert finished[1].params["hindsight"] == "future 2"


def test_a_trial_leaves_its_curves_cost_and_versions(finished):
    first = finished[0]
    curves = first.user_attrs["curves"]["pendulum_climb"]
    assert curves["success"] == [[0, 0], [0.3333, 0.3333], [0.6667, 0.6667], [1, 1]]
    assert curves["T"] == [18, 18] and curves["train_steps"] == [0, 200, 400, 600]
    assert curves["minutes"] == sorted(curves["minutes"]) and curves["minutes"][0] == 0
    assert first.intermediate_values == pytest.approx({1: 1 / 3, 2: 2 / 3, 3: 1})
    own = first.user_attrs["objectives"]
    assert set(own) == {"100", "101"}
    assert first.value == pytest.approx(sum(own.values()) / 2, abs=1e-4)
    assert 9 * 0.01 < first.user_attrs["cpu_seconds"] < 2
    assert first.user_attrs["versions"]["torch"]


def test_what_does_worse_than_most_is_pruned_before_its_end(finished):
    pruned = of_state(finished, TrialState.PRUNED)
    assert pruned
    for trial in pruned:
        assert list(trial.intermediate_values) == [1, 2]
        others = [t.intermediate_values[2] for t in of_state(finished, TrialState.COMPLETE)]
        assert trial.intermediate_values[2] < max(others)
        assert set(trial.user_attrs["curves"]) == {"pendulum_climb"}
        assert "objectives" not in trial.user_attrs and "label" not in trial.user_attrs


def launch(out, training, *more):
    """A launch in a process of its own, once its first trial has had a test."""
    program = (
        "import sys; from launch import tune; from tests.launch import fake_trainings; "
        f"sys.exit(tune.main({words(out, more=more)!r}, train=fake_trainings.{training}))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        cwd=ROOT, env={**os.environ, "MUJOCO_GL": "disabled"}, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    for line in process.stdout:
        if "period 1 of 3" in line:
            return process
    raise AssertionError(f"it ended with {process.wait()}")


@pytest.mark.slow
@pytest.mark.parametrize("number", (signal.SIGKILL, signal.SIGINT))
def test_the_same_command_continues_what_a_signal_ended(tmp_path, capsys, number):
    process = launch(tmp_path, "endless")
    process.send_signal(number)
    assert process.wait(timeout=30) == {signal.SIGKILL: -9, signal.SIGINT: 130}[number]
    with (tmp_path / f"{NAME}.journal").open("ab") as file:
        file.write(b'{"op_code":5,"worker')  # what a kill in mid-write leaves
    assert tune.main(words(tmp_path, seconds=1), train=fake_trainings.quick) == 0
    trials = study(tmp_path).trials
    assert trials[0].state == TrialState.FAIL and trials[0].user_attrs["cpu_seconds"] >= 0.1
    again = next(trial for trial in trials if trial.user_attrs.get("retry_of") == 0)
    assert again.state == TrialState.COMPLETE and again.params == trials[0].params
    assert again.user_attrs["label"] == "default"
    assert 1 <= seconds(trials) < 2
    said = "trial 0: its process was killed; it is started again" in capsys.readouterr().out
    assert said == (number == signal.SIGKILL)


@pytest.mark.slow
def test_a_trial_whose_process_is_killed_twice_is_not_tried_again(tmp_path):
    for _ in range(3):  # the defaults, the candidate, the defaults again
        process = launch(tmp_path, "endless")
        process.kill()
        process.wait(timeout=30)
    assert tune.main(words(tmp_path, seconds=1), train=fake_trainings.quick) == 0
    trials = study(tmp_path).trials
    labelled = [(t.user_attrs.get("label"), t.user_attrs.get("tries"), t.state) for t in trials[:4]]
    assert labelled == [
        ("default", None, TrialState.FAIL),
        ("candidate", None, TrialState.FAIL),
        ("default", 2, TrialState.FAIL),
        ("candidate", 2, TrialState.COMPLETE),
    ]
    assert "default" not in {trial.user_attrs.get("label") for trial in trials[4:]}


@pytest.mark.slow
def test_workers_share_a_study_and_lose_no_trial(tmp_path, capsys):
    # Long enough for the second worker to load torch on a slow machine.
    command = words(tmp_path, seconds=8, more=["--workers=2"])
    assert tune.main(command, train=fake_trainings.quick) == 0
    trials = study(tmp_path).trials
    begun = [trial for trial in trials if "worker" in trial.user_attrs]
    assert len({trial.user_attrs["worker"]["pid"] for trial in begun}) == 2
    assert not of_state(trials, TrialState.RUNNING) and 8 <= seconds(trials) < 12
    assert [trial.user_attrs.get("label") for trial in trials].count("default") == 1
    for trial in of_state(trials, TrialState.COMPLETE):
        assert list(trial.intermediate_values) == [1, 2, 3]
    assert os.listdir(tmp_path) == [f"{NAME}.journal"]


@pytest.mark.slow
def test_a_worker_that_dies_is_said_and_its_trial_is_found(tmp_path, capfd):
    process = launch(tmp_path, "endless", "--workers=2")
    (other,) = _children(process.pid)
    os.kill(other, signal.SIGKILL)
    process.send_signal(signal.SIGTERM)
    said = process.stdout.read()
    assert process.wait(timeout=30) == 143
    assert "a worker ended early, with exit status -9" in said
    assert tune.main(words(tmp_path, seconds=1), train=fake_trainings.quick) == 0
    trials = study(tmp_path).trials
    assert not of_state(trials, TrialState.RUNNING)
    done = {t.user_attrs.get("label") for t in of_state(trials, TrialState.COMPLETE)}
    assert {"default", "candidate"} <= done


def _children(pid):
    """Processes that a launch began, but for multiprocessing's resource tracker."""
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [
        int(child)
        for child in found
        if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()
    ]


def test_a_trial_taken_for_dead_is_given_up_without_harm(tmp_path, capsys):
    def overtaken(*arguments, **named):
        for result in fake_trainings.quick(*arguments, **named):
            if result.period == 1 and not of_state(study(tmp_path).trials, TrialState.FAIL):
                study(tmp_path).tell(0, state=TrialState.FAIL)
            yield result

    assert tune.main(words(tmp_path, seconds=1), train=overtaken) == 0
    assert "trial 0: abandoned, because another worker declared it dead" in capsys.readouterr().out
    trials = study(tmp_path).trials
    assert trials[0].state == TrialState.FAIL and trials[1].state == TrialState.COMPLETE


def test_trials_that_raise_are_said_and_too_many_end_the_launch(tmp_path, capsys):
    assert tune.main(words(tmp_path), train=fake_trainings.raises) == 1
    trials = study(tmp_path).trials
    assert [trial.state for trial in trials] == [TrialState.FAIL] * 3
    assert trials[0].user_attrs["ended"] == "RuntimeError: the reason"
    assert "trial 2: failed: RuntimeError: the reason\n" in capsys.readouterr().out


def test_tasks_count_alike_and_are_trained_side_by_side(tmp_path, capsys):
    def by_task(make_env, config, seeds, **named):
        factor = {"pendulum_climb": 1.0, "ur5_reacher": 0.5}[make_env.args[0]]
        for result in fake_trainings.quick(make_env, config, seeds, **named):
            for row in result.rows:
                row["success_rate"] *= factor
            yield result

    command = words(tmp_path, seconds=0.2, more=["--task=pendulum_climb,ur5_reacher"])
    assert tune.main(command, train=by_task) == 0
    first = study(tmp_path, "pendulum_climb+ur5_reacher_1layers").trials[0]
    assert first.intermediate_values == pytest.approx({1: 0.25, 2: 0.5, 3: 0.75})
    assert set(first.user_attrs["curves"]) == {"pendulum_climb", "ur5_reacher"}
    assert "success 75% (pendulum_climb 100%, ur5_reacher 50%)" in capsys.readouterr().out


def test_lost_seeds_count_as_failures(tmp_path):
    def loses(_make_env, config, seeds, *, callback, **_):
        yield fake_trainings.result(0, seeds, 1.0)
        fake_trainings.burn(0.01)
        callback.on_lost(hac_suite.LostSeed(101, 0, 20, 4))
        yield fake_trainings.result(1, seeds[:1], 1.0)

    assert tune.main(words(tmp_path, seconds=0.3), train=loses) == 0
    first = study(tmp_path).trials[0]
    curves = first.user_attrs["curves"]["pendulum_climb"]
    assert curves["success"] == [[1, 1], [1, 0], [0, 0], [0, 0]]
    assert "not finite" in curves["lost"]["101"]
    assert first.state == TrialState.COMPLETE and first.value < 0.9


@pytest.mark.slow
@pytest.mark.parametrize("layers", [0, 2])
def test_the_real_training_is_what_a_trial_carries_out(tmp_path, layers):
    more = [f"--subgoal_layers={layers}", "--learner=td3", "--periods=1"]
    assert tune.main(words(tmp_path, seconds=1.5, more=more), train=fake_trainings.tiny) == 0
    first = study(tmp_path, f"pendulum_climb_{layers}layers_td3").trials[0]
    curves = first.user_attrs["curves"]["pendulum_climb"]
    assert len(curves["T"]) == layers + 1 and curves["train_steps"][1] > 0
    assert first.user_attrs.get("ended") in (None, "budget")


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("--task=pendulum_clim", "unknown task 'pendulum_clim': did you mean 'pendulum_climb'?"),
        ("--task=pendulum_climb,pendulum_climb", "give each task once"),
        (f"--task={ROOT}/tasks/families/depth.py:ur5_reacher_400", "give tasks of the suite"),
        ("--seeds=10", "names seed 0: seeds below 100 are for published results"),
        ("--seeds=99-103", "names seed 99"),
        ("--hours=0", "give a number of core-hours above zero"),
        ("--hours=nan", "give a number of core-hours above zero"),
        ("--subgoal_layers=3", "3 is not an integer in the range [0, 2]"),
        ("--periods=0", "--periods=0"),
        ("--learner=sac", "sac"),
        ("--learner=none.py:Mine", "there is no such file"),
        (f"--learner={ROOT}/tests/launch/fake_trainings.py:Mine", "has no class 'Mine'"),
        ("--search=none.toml", "there is no search file 'none.toml'"),
        (f"--search={ROOT}", "cannot be read"),
        (f"--out={ROOT}/README.md", "README.md is no folder"),
        ("--out=", "give a name of printable characters"),
        ("--horus=3", "did you mean 'hours'?"),
        ("hours=3", "unexpected word 'hours=3'"),
    ],
)
def test_a_wrong_command_is_answered_in_a_line_and_nothing_is_made(tmp_path, capsys, word, said):
    assert tune.main([*words(tmp_path / "out"), word], train=fake_trainings.raises) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1 and error.startswith("error: ")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [("import nothing_of_that_name", "ModuleNotFoundError: No module named 'nothing_of_that_name'"),
     ("raise RuntimeError('two\\nlines')", "RuntimeError: two lines"),
     ("import sys; sys.exit('no')", "SystemExit: no")],
)  # fmt: skip
def test_a_learner_that_does_not_load_is_said_and_nothing_is_made(tmp_path, capsys, text, said):
    file = tmp_path / "own.py"
    file.write_text(text)
    command = words(tmp_path / "out", more=[f"--learner={file}:Mine"])
    assert tune.main(command, train=fake_trainings.raises) == 2
    why = f"learner is in '{file}', line 1, which fails: {said}"
    assert capsys.readouterr().err == f"error: flag --learner={file}:Mine: {why}\n"
    assert not (tmp_path / "out").exists()


def test_the_next_launch_tries_starts_again_that_failed(tmp_path):
    assert tune.main(words(tmp_path), train=fake_trainings.raises) == 1
    assert tune.main(words(tmp_path, seconds=0.3), train=fake_trainings.quick) == 0
    done = of_state(study(tmp_path).trials, TrialState.COMPLETE)
    assert [trial.user_attrs.get("label") for trial in done][:2] == ["default", "candidate"]


def test_without_optuna_the_extra_is_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(tune.importlib.util, "find_spec", lambda name: None)
    assert tune.main(words(tmp_path / "out"), train=fake_trainings.raises) == 2
    assert "'.[tune]'" in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("word", "said"),
    [("--seeds=100-102", "seeds is [100, 101] there and [100, 101, 102] here"),
     ("--periods=4", "periods is 3 there and 4 here")],
)  # fmt: skip
def test_a_journal_of_another_study_is_refused_and_kept(tmp_path, capsys, word, said):
    tune.main(words(tmp_path, seconds=0.1), train=fake_trainings.quick)
    before = (tmp_path / f"{NAME}.journal").read_bytes()
    assert tune.main([*words(tmp_path), word], train=fake_trainings.raises) == 2
    assert said in capsys.readouterr().err
    assert (tmp_path / f"{NAME}.journal").read_bytes() == before


def test_another_search_space_is_another_study(tmp_path, capsys):
    tune.main(words(tmp_path, seconds=0.1), train=fake_trainings.quick)
    text = TWO_STARTS.read_text().replace(
        "learning_rate = { low = 3e-4", "learning_rate = { low = 1e-4"
    )
    (tmp_path / "wide.toml").write_text(text)
    command = words(tmp_path, more=[f"--search={tmp_path / 'wide.toml'}"])
    assert tune.main(command, train=fake_trainings.raises) == 2
    assert (
        "search.space.learning_rate.low is 0.0003 there and 0.0001 here" in capsys.readouterr().err
    )


@pytest.mark.slow
def test_a_start_that_was_added_is_tried_next_and_no_start_twice(tmp_path):
    tune.main(words(tmp_path, seconds=0.3), train=fake_trainings.quick)
    begun = len(study(tmp_path).trials)
    text = TWO_STARTS.read_text()
    more = text + "[starts.fast]\nlearning_rate = 0.002\n[starts.same]\nlearning_rate = 0.001\n"
    (tmp_path / "more.toml").write_text(more)
    command = words(tmp_path, seconds=1.2, more=[f"--search={tmp_path / 'more.toml'}"])
    assert tune.main(command, train=fake_trainings.quick) == 0
    labels = [trial.user_attrs.get("label") for trial in study(tmp_path).trials]
    assert labels[:2] == ["default", "candidate"]
    later = study(tmp_path).trials[begun:]
    assert [t.params["learning_rate"] for t in later if "label" in t.user_attrs] == [0.002]
    assert "same" not in labels  # it is the default once more


def test_a_start_that_was_changed_is_another_study(tmp_path, capsys):
    tune.main(words(tmp_path, seconds=0.1), train=fake_trainings.quick)
    text = TWO_STARTS.read_text().replace("subgoal_noise = 0.03", "subgoal_noise = 0.05")
    (tmp_path / "changed.toml").write_text(text)
    command = words(tmp_path, more=[f"--search={tmp_path / 'changed.toml'}"])
    assert tune.main(command, train=fake_trainings.raises) == 2
    said = "search.starts.candidate.subgoal_noise is 0.03 there and 0.05 here"
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("text", ["no journal\n", "no journal", '{"a": 1}\n', '{"op_code"\n{"x"\n'])
def test_a_file_that_is_no_journal_is_refused_and_kept(tmp_path, capsys, text):
    path = tmp_path / f"{NAME}.journal"
    path.write_text(text)
    assert tune.main(words(tmp_path), train=fake_trainings.raises) == 2
    assert "is not a journal of trials" in capsys.readouterr().err
    assert path.read_text() == text


def test_help_lists_the_flags(capsys):
    assert tune.main(["launch/tune.py", "--help"]) == 0
    printed = capsys.readouterr().out
    assert "--hours=1.0" in printed and "Exit status: 0 the budget is used up" in printed
