"""Words that name a task: registered names, files of one's own, and what is wrong with the rest."""

import os
import pickle
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

import tasks
from hac_suite.types import level_specs
from tasks import registry

ROOT = Path(__file__).resolve().parents[2]

# A task of one's own: the suite's pendulum with a shorter horizon, under a name of the suite's.
OWN = """
import dataclasses
from tasks import registry
from tasks.families import pendulum

SPEC = dataclasses.replace(pendulum._CLIMB, max_steps=7)

@registry.add(SPEC)
def pick_place(test=False):
    return pendulum.Pendulum(SPEC, (0.0, 1.3), test=test)
"""


@pytest.fixture
def own(tmp_path):
    """Writes a task file and returns its path."""

    def write(text=OWN, name="mine.py"):
        path = tmp_path / name
        path.write_text(textwrap.dedent(text))
        return path

    return write


def test_the_five_tasks_are_registered():
    assert tasks.ALL == (
        "pendulum_climb",
        "pendulum_balance",
        "ur5_reacher",
        "cartpole_swingup",
        "pick_place",
    )


def test_a_registered_name_is_found_with_its_spec_and_loads():
    found = tasks.find("cartpole_swingup")
    assert found.name == found.word == "cartpole_swingup"
    assert found.spec is tasks.spec("cartpole_swingup")
    env = found.load_vector(3, 4)
    assert (env.name, env.num_envs) == ("cartpole_swingup", 3)
    twin = tasks.load_vector("cartpole_swingup", 3, 4)
    np.testing.assert_array_equal(env.reset().observation, twin.reset().observation)
    start, twin = found.load(5, test=True).reset(), tasks.load("cartpole_swingup", 5, test=True)
    np.testing.assert_array_equal(start.observation["angle"], twin.reset().observation["angle"])


def test_specs_compile_no_physics():
    """In a process in which whatever compiles a model raises."""
    script = """
    import mujoco.batch  # compiles an empty model when it is imported
    def refuse(*args, **kwargs):
        raise AssertionError("compiled")
    from dm_control import mjcf
    from dm_control.mjcf import physics
    mujoco.MjModel.from_xml_string = mujoco.MjModel.from_xml_path = refuse
    mujoco.MjSpec.compile = refuse
    mjcf.Physics.from_mjcf_model = physics.Physics.from_mjcf_model = refuse
    import tasks
    for name in tasks.ALL:
        spec = tasks.spec(name)
        print(name, spec.max_steps, spec.observation_dim, spec.action_high.tolist())
    try:
        tasks.load(name)
    except AssertionError as error:
        print(error)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)],
        capture_output=True, text=True, cwd=ROOT, env={**os.environ, "MUJOCO_GL": "disabled"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "pendulum_climb 300 3 [2.0]",
        "pendulum_balance 400 3 [2.0]",
        "ur5_reacher 200 15 [150.0, 150.0, 150.0, 28.0, 28.0, 28.0]",
        "cartpole_swingup 500 5 [10.0]",
        "pick_place 300 16 [4.0, 2.5]",
        "compiled",
    ]


def test_a_spec_can_be_sent_to_another_process():
    spec = tasks.spec("pick_place")
    copy = pickle.loads(pickle.dumps(spec))
    assert (copy.max_steps, copy.horizons) == (spec.max_steps, spec.horizons)
    np.testing.assert_array_equal(copy.goal_space.high, spec.goal_space.high)


@pytest.mark.parametrize("load", [tasks.load, tasks.spec, lambda name: tasks.load_vector(name, 1)])
def test_an_unknown_name_is_answered_with_the_closest(load):
    with pytest.raises(
        ValueError, match=r"^unknown task 'pick_plce': did you mean 'pick_place'\?$"
    ):
        load("pick_plce")


@pytest.mark.parametrize("word", ["", "../pick_place", "gymn:Pendulum-v1", "a\nb", "x.txt:name"])
def test_other_words_are_unknown_tasks(word):
    with pytest.raises(ValueError, match=r"^unknown task .*: [^\n]*$") as caught:
        tasks.find(word)
    assert "path/to/file.py:name" in str(caught.value) or "did you mean" in str(caught.value)


def test_a_duplicate_name_is_refused():
    def pick_place(test=False):
        raise AssertionError("never built")

    with pytest.raises(ValueError, match="'pick_place' is already registered"):
        registry.add(tasks.spec("pick_place"))(pick_place)
    assert tasks.find("pick_place").factory is not pick_place


def test_a_task_of_ones_own_is_found_in_its_file(own):
    path = own()
    found = tasks.find(f"{path}:pick_place")
    assert found.spec.max_steps == 7
    env = found.load_vector(2)
    env.reset(np.array([3, 4]))
    assert (env.name, env.max_steps) == (found.name, 7)
    assert found.load(seed=0).task.spec is found.spec


def test_names_of_a_file_cannot_collide_with_the_suites(own):
    found = tasks.find(f"{own(name='my arm.v2.py')}:pick_place")
    assert found.name == "my_arm_v2-pick_place"
    assert tasks.find("pick_place").spec.max_steps == 300
    assert registry.names() == list(tasks.ALL)


def test_a_file_is_run_once_however_it_is_named(own, monkeypatch):
    path = own(OWN + "\nprint('run', file=open(__file__ + '.log', 'a'))\n")
    first = tasks.find(f"{path}:pick_place")
    monkeypatch.chdir(path.parent)
    assert tasks.find("mine.py:pick_place") is first
    assert Path(f"{path}.log").read_text() == "run\n"
    monkeypatch.chdir("/")  # its word is good from everywhere
    assert tasks.find(first.word) is first


def test_two_files_called_alike_are_two(own, tmp_path):
    (tmp_path / "other").mkdir()
    one = tasks.find(f"{own()}:pick_place")
    two = tasks.find(f"{own(OWN.replace('=7', '=8'), 'other/mine.py')}:pick_place")
    assert (one.spec.max_steps, two.spec.max_steps) == (7, 8)


@pytest.mark.parametrize(
    ("text", "name", "problem"),
    [
        ("def f(:\n", "x", "line 1: it is not Python: "),
        ("\x00", "x", "not Python|null bytes"),
        ("import math\n\nmath.sqrt(-1)\n", "x", "line 3: ValueError: "),
        ("raise ValueError('one\\ntwo')", "x", "line 1: ValueError: one two$"),
        ("import sys\nsys.exit(3)", "x", "line 2: SystemExit: 3$"),
        ("import no_such_module", "x", "ModuleNotFoundError: .*'no_such_module'$"),
        ("", "x", "registers no task 'x': it registers no task with tasks.registry.add$"),
        (OWN, "pick_plce", "registers no task 'pick_plce': did you mean 'pick_place'"),
        (OWN, "zzz", "registers no task 'zzz': it registers pick_place$"),
        (OWN, "", "add the name of its task, as in .*mine.py:pick_place$"),
        (OWN + OWN, "pick_place", "line 1.: ValueError: .*'pick_place' is already registered"),
    ],
)
def test_what_is_wrong_with_a_file_is_said_in_one_line(own, text, name, problem):
    path = own(text)
    with pytest.raises(ValueError, match=problem) as caught:
        tasks.find(f"{path}:{name}")
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)
    assert registry.names() == list(tasks.ALL)


@pytest.mark.parametrize("word", ["nowhere.py:x", "nowhere.py", "nowhere.py:", ".py:x"])
def test_a_missing_file_is_named(word, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"^task file (nowhere)?\.py: there is no such file$"):
        tasks.find(word)


def test_a_file_that_was_mended_is_run_again(own):
    path = own("raise ValueError('not yet')")
    with pytest.raises(ValueError, match="not yet"):
        tasks.find(f"{path}:pick_place")
    own(OWN + "\n# mended\n")
    assert tasks.find(f"{path}:pick_place").spec.max_steps == 7


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ("action_bounds=([-2], [3])", r"action_high \[3.0\], but the task has \[2.0\]"),
        ("observation={'angle': (1.0, 1.0)}", "observation parts and sizes"),
        ("observation={'angle': (1,), 'angular_velocity': (1,)}", "observation parts and sizes"),
        ("subgoal_space=pendulum._TIP_AND_VELOCITY_SPACE", "subgoal space's dimensions 3"),
    ],
)
def test_a_spec_that_the_model_belies_is_refused(own, change, problem):
    found = tasks.find(f"{own(OWN.replace('max_steps=7', change))}:pick_place")
    with pytest.raises(ValueError, match=f"Pendulum: its spec says .*{problem}"):
        found.load(seed=0)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ("max_steps=0", "max_steps of at least 1"),
        ("control_timestep=0.0", "control_timestep above 0"),
        ("observation={}", "above 0"),
        ("observation={'angle': (1, 0)}", "above 0"),
        ("action_bounds=([5], [2])", "low below high"),
        ("action_bounds=([-1, -1], [2])", "low below high"),
        ("action_bounds=([-float('inf')], [2])", "finite"),
        ("horizons={1: (5,)}", "1 subgoal layers need 2 counts"),
        ("horizons={0: (0,)}", "0 subgoal layers need 1 counts"),
    ],
)
def test_a_spec_that_cannot_be_is_refused(own, change, problem):
    with pytest.raises(ValueError, match=f"line .: ValueError: .*{problem}"):
        tasks.find(f"{own(OWN.replace('max_steps=7', change))}:pick_place")


def test_an_offset_counts_in_training_as_it_does_in_acting(own):
    old = "max_steps=7"
    path = own(OWN.replace(old, f"{old}, offset=[0.5] * pendulum._CLIMB.observation_dim"))
    entry = tasks.find(f"{path}:pick_place")
    (trained,), (acting,) = (
        level_specs(spaces, (7,)) for spaces in (entry.load_vector(1), entry.spec)
    )
    state = entry.load_vector(1).reset(np.array([3])).observation
    np.testing.assert_array_equal(trained.scaled(state), acting.scaled(state))
    assert (trained.scaled(state) != state / trained.observation_scale).all()
