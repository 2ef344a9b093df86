"""A task begun from a model, and what is said of one in which something is wrong."""

import re
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest

import hac_suite
import tasks
from launch import check_task, fit, new_task, run
from tasks.authoring import check

ARM = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="link">
      <joint name="shoulder" axis="0 0 1" range="-90 90" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.5 0 0" size=".05" mass="1"/>
      <body name="fore" pos="0.5 0 0">
        <joint name="elbow" axis="0 0 1" range="-120 120" damping="0.1"/>
        <geom type="capsule" fromto="0 0 0 0.4 0 0" size=".04" mass="1" contype="0"/>
        <site name="tip" pos="0.4 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="shoulder" ctrlrange="-1 1" gear="2"/>
    <motor joint="elbow" ctrlrange="-1 1"/>
  </actuator>
  <sensor><jointpos joint="elbow"/></sensor>
</mujoco>
"""


SWING = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="pole" euler="90 0 0">
      <joint name="hinge" axis="0 0 1" ref="90" range="0 180" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0 -0.5 0" size=".05" mass="1"/>
    </body>
    <body name="box" pos="1 1 0">
      <joint name="lid" axis="0 0 1"/>
      <geom size=".1"/>
    </body>
  </worldbody>
  <tendon><fixed name="cable"><joint joint="hinge" coef="2"/></fixed></tendon>
  <actuator><motor tendon="cable" ctrlrange="-1 1"/></actuator>
</mujoco>
"""


@pytest.fixture
def arm(tmp_path, monkeypatch) -> Path:
    """The file of a task begun from a model."""
    (tmp_path / "model.xml").write_text(ARM)
    monkeypatch.chdir(tmp_path)
    assert new_task.main(["new_task", "arm", "model.xml", "--point=tip"]) == 0
    return tmp_path / "arm.py"


def checked(file: Path) -> list[check.Finding]:
    return list(check.findings(tasks.find(f"{file}:arm")))


def until_said(file: Path, said: str) -> check.Finding:
    """The first finding that says it; what would be checked after that takes seconds."""
    found = []
    for finding in check.findings(tasks.find(f"{file}:arm")):
        found.append(finding)
        if re.search(said, f"{finding.text} {finding.remedy}", re.DOTALL):
            return finding
    raise AssertionError(found)


def test_a_task_begun_from_a_model_passes_its_checks(arm, capsys):
    assert [f for f in checked(arm) if f.verdict == "wrong"] == []
    spec = tasks.spec(f"{arm}:arm")
    assert spec.goal_space.names == ("tip_x", "tip_y")  # z never changes
    assert spec.action_low.tolist() == [-1, -1] and spec.observation_dim == 6
    assert spec.goal_space.high[0] == pytest.approx(0.95, abs=0.02)
    # 90 degrees are 1.57 radians, whatever markers and robots say
    environment = tasks.load(f"{arm}:arm")
    model = environment.physics.model
    assert model.jnt_range[0].tolist() == pytest.approx([-np.pi / 2, np.pi / 2], abs=1e-3)
    assert model.ncam == model.nlight == 1
    # Nor do the hidden markers count among what pictures are measured by.
    own = mujoco.MjModel.from_xml_string(ARM).stat
    assert model.stat.extent == pytest.approx(own.extent, rel=0.01)
    np.testing.assert_allclose(model.stat.center, own.center, atol=1e-3)


def test_a_task_that_cannot_be_trained_on_is_refused_before_anything_is_made(
    arm, monkeypatch, capsys
):
    words = ["run", "--seeds=1", "--periods=1", "--novideo", "--config.episodes_per_period=4"]
    text = arm.read_text()
    for old, new, said in (
        ("uniform(_START_LOW", "uniform(np.random.uniform() * _START_LOW", "of one seed differ"),
        ("observation_parts(self, readings):", "observation_parts(self, readings):\n        1 / 0",
         "ZeroDivisionError"),
    ):  # fmt: skip
        assert old in text
        other = arm.with_name(f"arm_{len(said)}.py")
        other.write_text(text.replace(old, new, 1))
        other.with_suffix(".xml").write_text(arm.with_suffix(".xml").read_text())
        assert run.main([*words, f"--task={other.name}:arm"]) == 2
        printed = capsys.readouterr().err
        assert said in printed and f"launch/check_task.py {other}:arm" in printed
        assert fit.main(["fit", f"--task={other.name}:arm"]) == 2
        assert said in capsys.readouterr().err and not Path(f"{other.stem}-arm_fit.toml").exists()
    assert not Path("runs").exists()


def test_and_it_trains(arm):
    config = hac_suite.Config(episodes_per_period=4, test_episodes=4, hidden_sizes=(16,))
    task = tasks.find(f"{arm}:arm")
    *_, result = hac_suite.train(
        task.load_vector, config, [0], subgoal_layers=1, horizons=(15, 14), periods=1
    )
    assert result.rows[0]["train_steps"] > 0 and result.rows[0]["diverged_episodes"] == 0


def test_goals_lie_in_the_space_of_a_task_whose_point_is_a_body(tmp_path, monkeypatch, capsys):
    """Such as a hinge's own body, whose frame stays where it is."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.xml").write_text(SWING)
    assert new_task.main(["new_task", "arm", "model.xml"]) == 0
    assert "no actuator drives lid: " in capsys.readouterr().out
    word = f"{tmp_path}/arm.py:arm"
    assert len(tasks.spec(word).observation["velocities"]) == 1
    state = tasks.load_vector(word, 64).reset(np.arange(64))
    normal = tasks.spec(word).goal_space.normalise(state.desired_goal)
    assert np.abs(normal).max(axis=0) == pytest.approx(0.95, abs=0.05)
    start = tasks.load_vector(word, 64).reset(np.arange(64), test=True).achieved_goal
    assert start.mean(axis=0) == pytest.approx([0.0, -0.25], abs=0.05)  # as it is written


@pytest.mark.slow
def test_gymnasiums_reacher_is_a_model_to_begin_from(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    model = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets" / "reacher.xml"
    assert new_task.main(["new_task", "reach", str(model)]) == 0
    assert "was replaced by implicitfast" in capsys.readouterr().out
    found = list(check.findings(tasks.find(f"{tmp_path}/reach.py:reach")))
    assert [f for f in found if f.verdict == "wrong"] == []
    assert tasks.spec(f"{tmp_path}/reach.py:reach").goal_space.names[0] == "fingertip_x"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        # The file, changed as people change it; and what is to be said of it.
        ('self._goal_marker = markers.Marker', "self._goal = self._goal_marker = markers.Marker",
         "assigns self._goal, which tasks.base.GoalTask uses itself"),
        ("    def achieved_goal(self, readings):", "    def get_reward(self, physics):\n"
         "        return 1.0\n\n    def achieved_goal(self, readings):",
         "defines get_reward, which training never calls"),
        ('"velocities": (', '"velocities": (200.0 * ', "a factor of"),
        ("readings[..., _VELOCITIES]", "readings.T[_VELOCITIES].T if readings.ndim < 3 "
         "else readings[0][..., _VELOCITIES]", "gives different values"),
        ("random_state.uniform(_START_LOW, _START_HIGH))", "np.random.uniform(_START_LOW, "
         "_START_HIGH))", "two episodes of one seed differ"),
        ("lambda place: not _SPACE.achieved(place, goal)", "lambda place: "
         "_SPACE.achieved(place, goal)", "begin at their goal|no valid start"),
        ("        return goal\n", "        return goal + 9\n",
         "hindsight teaches nothing|outside the goal space"),
        ("observation_parts(self, readings):", "observation_parts(self, readings):\n"
         "        1 / 0", "does not load: ZeroDivisionError.*changed.py, line"),
        ("super().__init__(arena, _SPEC", "1 / 0\n        super().__init__(arena, _SPEC",
         "the factory does not make the task: ZeroDivisionError.*changed.py, line"),
        ("        super().__init__(arena, _SPEC", "        dict(arena=arena",
         r"Arm.__init__ does not call.*super\(\).__init__\(arena"),
        ("        return goal\n", "        return goal * np.nan\n",
         r"sample_episode returned the goal \[nan nan\]; it must return 2 finite numbers"),
        ("    threshold=np.array([", "    threshold=1e-3 * np.array([",
         "the subgoal threshold in tip_x is 7.19e-05, but episodes suggest"),
        ('"place": readings[..., _PLACE],\n', '"place": readings[..., [0]],\n',
         "its spec says observation parts and sizes"),
        ("control_timestep=0.02", "control_timestep=0.021", "should be an integer multiple"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_task_is_said_with_a_remedy(arm, old, new, said):
    text = arm.read_text()
    assert old in text
    if "200.0" in new:
        text = re.sub(r'("velocities": )\(([\d.]+), ([\d.]+)\)', r"\1(200 * \2, 200 * \3)", text)
    else:
        text = text.replace(old, new, 1)
    other = arm.with_name("changed.py")
    other.write_text(text)
    arm.with_suffix(".xml").rename(other.with_suffix(".xml"))
    finding = until_said(other, said)
    assert finding.verdict != "good" and finding.remedy and "\n" not in finding.text


@pytest.mark.parametrize(
    ("pattern", "new", "said"),
    [
        (r"<sensor>.*</sensor>", "", "the model has no sensors.*jointpos"),
        (r"<camera[^>]*/>", "", "no camera"),
        (r"<light[^>]*/>", "", "no light"),
        (r'range="-1.57\d* 1.57\d*"', 'range="-90 90"', "look like degrees"),
        (r"<option ", '<option integrator="RK4" ', "RK4"),
        (r"<statistic [^>]*/>", '<statistic extent="500"/>', "near plane is 5 m.*<statistic"),
    ],
)
def test_what_is_wrong_with_a_model_is_said_with_a_remedy(arm, pattern, new, said):
    file = arm.with_suffix(".xml")
    text, count = re.subn(pattern, new, file.read_text(), flags=re.DOTALL)
    assert count
    file.write_text(text)
    assert until_said(arm, said).verdict != "good"


@pytest.mark.slow
@pytest.mark.requires_gl
def test_the_program_draws_a_picture_and_its_exit_status_tells(arm, capsys):
    assert check_task.main(["check_task", f"{arm}:arm"]) == 0
    shown = capsys.readouterr().out
    assert "arm-arm.png: a picture of a test start" in shown and "wrong" not in shown
    assert (arm.parent / "arm-arm.png").stat().st_size > 2000
    text = arm.read_text().replace("self._goal_marker = m", "self._goal = self._goal_marker = m")
    other = arm.with_name("taken.py")
    other.write_text(text)
    other.with_suffix(".xml").write_text(arm.with_suffix(".xml").read_text())
    assert check_task.main(["check_task", f"{other}:arm"]) == 1


@pytest.mark.parametrize(
    ("model", "words", "said"),
    [
        (ARM, ["Arm", "model.xml"], "lower-case letters"),
        (ARM, ["pick_place", "model.xml"], "a task of the suite"),
        (ARM, ["class", "model.xml"], "a word of Python"),
        (ARM, ["np", "model.xml"], "a name that the file itself uses"),
        (ARM, ["markers", "model.xml"], "a name that the file itself uses"),
            (ARM, ["my-Arm", "model.xml"], "such as 'my_arm'"),
        (ARM, ["arm", "none.xml"], "there is no model"),
        (ARM, ["arm"], "a name and a model"),
        (ARM, ["arm", "model.xml", "--point=hand"], "no site or body 'hand'; it has tip"),
        ("<mujoco>", ["arm", "model.xml"], "does not compile as MJCF"),
        (re.sub("<actuator>.*</actuator>", "", ARM, flags=re.DOTALL), ["arm", "model.xml"],
         "has no actuators"),
        (ARM.replace('ctrlrange="-1 1" gear', "gear"), ["arm", "model.xml"], "has no ctrlrange"),
    ],
)  # fmt: skip
def test_a_model_that_is_none_to_begin_from_is_refused(
    model, words, said, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "model.xml").write_text(model)
    assert new_task.main(["new_task", *words]) == 2
    assert said in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["model.xml"]


def test_a_height_field_is_found_from_another_folder(tmp_path, monkeypatch):
    (tmp_path / "there").mkdir()
    with (tmp_path / "there" / "hills.bin").open("wb") as hills:
        np.array([2, 2], np.int32).tofile(hills)
        np.array([0, 1, 1, 0], np.float32).tofile(hills)
    field = '<asset><hfield name="hills" file="hills.bin" size="1 1 .1 .1"/></asset><worldbody>'
    ground = '<geom type="hfield" hfield="hills" pos="0 0 -1"/>'
    model = ARM.replace("<worldbody>", field + ground, 1)
    (tmp_path / "there" / "model.xml").write_text(model)
    monkeypatch.chdir(tmp_path)
    assert new_task.main(["new_task", "arm", "there/model.xml", "--point=tip"]) == 0
    assert tasks.load("arm.py:arm").reset().first()


def test_files_are_not_written_over_unasked(arm, capsys):
    assert new_task.main(["new_task", "arm", "model.xml"]) == 2
    assert "arm.py exists already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("pick_plce", "did you mean 'pick_place'"),
        ("gym:HACSuite/PickPlace-v0", "launch/fit.py"),
    ],
)
def test_wrong_words_are_answered_in_one_line(word, said, capsys):
    assert check_task.main(["check_task", word]) == 2
    assert said in capsys.readouterr().err


def test_markers_that_want_more_than_training_gives_are_found(arm):
    text = arm.read_text()
    head = "def place_subgoal_marker(self, physics, level, subgoal):"
    assert head in text
    arm.write_text(text.replace(head, f"{head}\n        physics.named.data.qpos", 1))
    found = until_said(arm, "has no attribute 'named'")
    assert found.verdict == "wrong" and "markers and events in training" in found.text
