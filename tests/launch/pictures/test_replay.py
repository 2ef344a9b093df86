"""Replays: what the file says of bodies, subgoals and outcomes is what happened, frame by frame."""

import base64
import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest

import hac_suite
import tasks
from launch import play
from launch.pictures import course as course_lib
from launch.pictures import replay, scene
from launch.pictures.course import Course
from launch.pictures.video import RenderingError
from tests.cases import published

TASK, SEED = "ur5_reacher", 11
POLICY = published(TASK, 2)


@pytest.fixture(scope="module")
def course() -> Course:
    return course_lib.record(hac_suite.Policy.load(POLICY), SEED)


@pytest.fixture(scope="module")
def views() -> list[hac_suite.StepView]:
    """The same episode as another rollout sees it."""
    seen: list[hac_suite.StepView] = []

    def keep(view: hac_suite.StepView) -> None:
        kept = {name: [part.copy() for part in getattr(view, name)] for name in ("subgoals",)}
        outcomes = [part.copy() for part in view.outcomes]
        seen.append(view._replace(**kept, outcomes=outcomes))

    env = tasks.load_vector(TASK, 3)
    policy = hac_suite.Policy.load(POLICY)
    hac_suite.run_episodes(env, policy, np.array([5, SEED, 6]), on_step=keep)
    return seen


def test_bodies_are_where_composer_has_them(course):
    environment = tasks.load(TASK, seed=SEED, test=True)
    policy, spec = course.policy, tasks.spec(TASK)
    policy.reset(spec)
    timestep = environment.reset()
    markers = {*course.stage.goal, *itertools.chain(*course.stage.subgoals)}
    moving = [body for body in range(len(course.stage.bodies)) if body not in markers]
    for frame in course.poses:
        physics = environment.physics
        np.testing.assert_allclose(frame.position[moving], physics.data.xpos[moving], atol=1e-5)
        if timestep.last():
            break
        seen = timestep.observation
        action = policy.act(spec.flat(seen), seen["desired_goal"], seen["achieved_subgoal"])
        timestep = environment.step(action)
    assert timestep.last() and course.steps > 20
    assert course.success == (timestep.discount == 0.0)


def test_markers_are_where_the_subgoals_of_another_rollout_are(course, views):
    one = 1  # the environment of that rollout that plays the same episode
    for frame, view in zip(course.poses, views, strict=False):
        for bodies, subgoal in zip(course.stage.subgoals, view.subgoals, strict=True):
            np.testing.assert_allclose(frame.position[bodies[0]], subgoal[one], atol=1e-5)
        goal = view.env_step.desired_goal[one]
        np.testing.assert_allclose(frame.position[course.stage.goal[0]], goal, atol=1e-5)


def test_attempts_on_the_timeline_end_when_and_as_they_did(course, views):
    ends: dict[int, list[list]] = {1: [], 2: []}
    for view in views[1 : course.steps + 1]:
        for level, outcome in enumerate(view.outcomes, start=1):
            if outcome[1]:
                word = hac_suite.Outcome(outcome[1]).name.lower().replace("_", " ")
                ends[level].append([view.step, word])
    lanes = replay.overlay(course)["lanes"]
    assert [lane["name"] for lane in lanes] == ["level 2's subgoals", "level 1's subgoals"]
    for lane, level in zip(lanes, (2, 1), strict=True):
        assert [[end, outcome] for _, end, outcome in lane["attempts"]] == ends[level]
        # Nothing is left open, and an attempt begins where the one before it ended.
        starts = [start for start, _, _ in lane["attempts"]]
        assert starts == [0, *(end for _, end, _ in lane["attempts"][:-1])]
        assert lane["attempts"][-1][1] == course.steps
    assert len(ends[1]) > len(ends[2]) > 1


def test_the_file_holds_every_frame(course, tmp_path):
    """viser's recording, decoded and played in Python, shows the bodies that were seen."""
    pytest.importorskip("viser", exc_type=ImportError)
    replay.write(course, tmp_path / "episode.html")
    html = (tmp_path / "episode.html").read_text()
    (scheme,) = re.findall(r"__VISER_EMBED_CONFIG__=\{darkMode:(.*?)\};", html)
    assert scheme == "matchMedia('(prefers-color-scheme: dark)').matches"
    messages, duration = _recording(html)
    assert duration > course.steps * course.control_timestep
    names = [f"/{i}_{name.replace('/', '_')}" for i, name in enumerate(course.stage.bodies)]
    position: dict[str, tuple] = {}
    seen: dict[str, bool] = {}
    for step, frame in enumerate(course.poses):
        now = (step + 0.5) * course.control_timestep
        while messages and messages[0][0] <= now:
            message = messages.pop(0)[1]
            if message["type"] == "SetPositionMessage":
                position[message["name"]] = message["position"]
            if message["type"] == "SetSceneNodeVisibilityMessage":
                seen[message["name"]] = message["visible"]
        for body, name in enumerate(names):
            assert seen.get(name, True) == frame.seen[body]
            if frame.seen[body]:
                held = position.get(name, (0, 0, 0))
                np.testing.assert_allclose(held, frame.position[body], atol=1e-4)
        # A dot where the effector is, which is what subgoals are about.
        np.testing.assert_allclose(position["/here_0"], course.trail[step, 0], atol=1e-4)


def _recording(html: str) -> tuple[list, float]:
    import msgspec
    import zstandard

    found = re.search(r'__VISER_EMBED_DATA__="([^"]+)"', html)
    assert found
    packed = base64.b64decode(found[1])
    raw = zstandard.ZstdDecompressor().decompress(packed[8:], int.from_bytes(packed[:8], "little"))
    size = int.from_bytes(raw[:8], "little")
    held = msgspec.msgpack.decode(raw[8 : 8 + size])
    return list(held["messages"]), held["durationSeconds"]


@pytest.mark.parametrize("task", tasks.ALL)
def test_a_replay_of_every_task_is_small(task, tmp_path):
    pytest.importorskip("viser", exc_type=ImportError)
    replay.render([published(task, 2)], tmp_path / "new" / "r.html")
    assert 500_000 < (tmp_path / "new" / "r.html").stat().st_size < 3_000_000
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["r.html"]


def test_nothing_that_a_person_wrote_is_markup(course):
    hostile = course._replace(title="</script><script>alert(1)")
    page = replay.page("<html><head></head></html>", replay.overlay(hostile))
    assert "</script><script>alert" not in page
    data = json.loads(page.split("const episode = ")[1].split(";\n")[0].replace("<\\/", "</"))
    assert data["todo"] == "</script><script>alert(1)"


@pytest.mark.parametrize(("seconds", "speed"), [(0.6, 0.1), (1.3, 0.25), (2.6, 0.5), (8.0, 1.0)])
def test_what_is_soon_over_is_slowed_down(seconds, speed):
    assert replay._speed(seconds) == speed


def test_play_without_the_extra_says_how_to_install_it(monkeypatch, capsys, tmp_path):
    def missing() -> None:
        raise scene.ViewerMissing(scene.LACKING)

    monkeypatch.setattr(scene, "load", missing)
    words = ["launch/play.py", f"--task={TASK}", f"--output={tmp_path}/e.html"]
    assert play.main(words) == 2
    printed = capsys.readouterr()
    assert "pip install" in printed.err and printed.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_bad_policy_leaves_no_file(tmp_path):
    pytest.importorskip("viser", exc_type=ImportError)
    bad = tmp_path / "bad"
    Path(f"{bad}.json").write_text(Path(f"{POLICY}.json").read_text())
    Path(f"{bad}.safetensors").write_bytes(b"no weights")
    with pytest.raises(RenderingError, match=r"policy: .*not a safetensors policy"):
        replay.render([bad], tmp_path / "out.html")
    assert not (tmp_path / "out.html").exists()
