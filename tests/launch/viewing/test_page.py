"""The page without a browser: what a person's clicks do, and who can reach it."""

import asyncio
import os
import socket
import types

import numpy as np
import psutil
import pytest

import tasks
from analysis.program import CommandError
from launch.folder import policies
from launch.pictures import scene
from launch.viewing import panel, serving
from launch.viewing.episode import LevelStatus
from launch.viewing.page import Page

pytest.importorskip("viser", exc_type=ImportError)

TASK = "pick_place"


@pytest.fixture(scope="module")
def server():
    made = scene.private(serving.LOOPBACK, 0)
    yield made
    scene.stop(made)


@pytest.fixture
def page(server):
    server.scene.reset()
    server.gui.reset()
    env = tasks.load_vector(TASK, 1)
    found = policies.published(TASK)
    yield Page(server, env, env.spec, found, next(p for p in found if p.subgoal_layers == 2))
    env.close()


def turn(page: Page, times: int = 1) -> None:
    for _ in range(times):
        page.turn(0.0)


def choose(page: Page, box, value) -> None:
    """As a person at a browser chooses."""
    box.value = value
    event = types.SimpleNamespace(client=object(), target=box)
    for call in box._impl.update_cb:
        call(event)
    turn(page)


def test_a_goal_that_cannot_be_moved_has_no_sliders(server, page, monkeypatch):
    def fixed(i, goal):
        raise ValueError("it does not store its goal in an array")

    monkeypatch.setattr(page._env, "move_goal", fixed)
    server.scene.reset()
    server.gui.reset()
    page = Page(server, page._env, page._spec, page._found, page._chosen)
    assert page._sliders == [] and not any(page._handle.axes)
    turn(page)


def test_what_mujoco_does_not_simulate_is_refused_with_what_shows_it(server, page, monkeypatch):
    monkeypatch.setattr(page._env, "simulation", lambda i: None)
    with pytest.raises(CommandError, match=r"play.py --output=video.mp4` renders it"):
        Page(server, page._env, page._spec, page._found, page._chosen)


def test_step_takes_one_step_and_pauses(page):
    page._do(page._toggle)
    turn(page)
    page._do(lambda: page._moved("Step"))
    turn(page)
    step = page.player.episode.step
    assert step >= 1 and not page.player.running
    turn(page, 3)
    assert page.player.episode.step == step
    assert f"step {step} of 300" in page._status.content


def test_the_next_episode_has_the_next_seed_and_restart_the_same(page):
    first = page.player.episode.goal.copy()
    page._do(lambda: page._moved("Next episode"))
    turn(page)
    assert page._seed_box.value == 1
    second = page.player.episode.goal.copy()
    assert np.abs(first - second).max() > 1e-3
    page._do(lambda: page._moved("Step"))
    page._do(lambda: page._moved("Restart"))
    turn(page)
    np.testing.assert_array_equal(page.player.episode.goal, second)
    assert page.player.episode.step == 0
    choose(page, page._seed_box, 0)
    np.testing.assert_array_equal(page.player.episode.goal, first)


def test_another_agent_brings_its_own_policies(page):
    assert len(page.player.episode.subgoals) == 2
    choose(page, page._agent, page._agent.options[1])
    assert len(page.player.episode.subgoals) == 1
    (own,) = (one for one in policies.published(TASK) if one.subgoal_layers == 1)
    assert page._which.value.startswith(f"seed {own.seed},")
    choose(page, page._agent, page._agent.options[0])
    assert page.player.episode.subgoals == []


def test_a_policy_that_cannot_be_played_leaves_the_page_as_it_was(page, tmp_path):
    chosen = page._chosen
    broken = chosen._replace(path=tmp_path / "nothing", seed=77)
    page._found.append(broken)
    page._which.options = page._labels()
    choose(page, page._which, page._labels()[-1])
    assert page._which.value.startswith(f"seed {chosen.seed},") and page._chosen == chosen
    page._do(lambda: page._moved("Step"))
    turn(page)
    assert page.player.episode.step == 1


def test_dragging_the_marker_moves_the_goal_and_the_sliders(page):
    before = page.player.episode.subgoals
    place = page._handle.place()

    def drag(phase: str, to: np.ndarray) -> None:
        event = types.SimpleNamespace(phase=phase, start_position=place, end_position=to)
        asyncio.run(page._drag(event))

    drag("start", place)
    drag("update", place + [0.2, 0.5, 0.1])  # y is off the plane that the goal lies in
    turn(page)
    drag("end", place + [0.2, 0.5, 0.1])
    turn(page)
    np.testing.assert_allclose(page._handle.place(), place + [0.2, 0.0, 0.1], atol=1e-4)
    sliders = [slider.value for slider in page._sliders]
    np.testing.assert_allclose(sliders, page.player.episode.goal, atol=6e-3)
    assert np.abs(page.player.episode.subgoals[1] - before[1]).max() > 1e-3  # the answer


def test_a_slider_moves_the_goal(page):
    choose(page, page._sliders[0], 0.4)
    assert page.player.episode.goal[0] == pytest.approx(0.4)
    assert page._handle.place()[0] == pytest.approx(0.4, abs=1e-6)


@pytest.mark.slow
def test_an_episode_that_plays_to_its_end_says_so(page):
    page.player.speed = 1e6
    page._do(page._toggle)
    turn(page, 40)
    assert page.player.episode.over
    assert "goal achieved" in page._status.content and "cut short" in page._endings.content
    assert page._play.label == "Play"
    page._do(page._toggle)  # again from the start
    turn(page)
    assert page.player.episode.step <= 20


def test_the_scene_has_every_body_and_shows_what_moves(page):
    names = {name for name, _ in page._server.scene._handle_from_node_name.items()}
    assert {"/floor", "/7_goal_rod_", "/10_subgoal_1_gripper_"} <= names
    gripper = page._scene._frames[page._stage.bodies.index("worm/gripper")]
    before = np.array(gripper.position)
    for _ in range(10):
        page._do(lambda: page._moved("Step"))
    turn(page)
    assert np.abs(np.array(gripper.position) - before).max() > 1e-3


def test_only_this_machine_can_reach_the_page(server):
    own = psutil.Process(os.getpid()).net_connections("inet")
    listening = [c.laddr for c in own if c.status == psutil.CONN_LISTEN]
    assert server.get_port() in [where.port for where in listening]
    assert {where.ip for where in listening} == {"127.0.0.1"}


def test_nothing_is_published_whatever_a_page_asks_for(server, monkeypatch):
    monkeypatch.setattr(socket.socket, "connect", lambda *_: pytest.fail("it called out"))
    assert server.request_share_url() is None
    assert server._share_tunnel is None


def test_q_is_shown_where_there_are_critics(page):
    without = panel.levels(
        [LevelStatus(0, 1, 7, None), LevelStatus(1, 0, None, None)], {}, page._stage
    )
    assert "without its critics" in without and "<th" in without and ">Q<" not in without
    with_q = panel.levels(
        [LevelStatus(0, 1, 7, -2.25), LevelStatus(1, 0, None, -5.0)], {}, page._stage
    )
    assert "-2.2" in with_q and "6 of 7" in with_q and ">Q<" in with_q


def test_the_address_is_told_with_the_ssh_line():
    lines = serving.told("127.0.0.1", 8123)
    assert lines[0].startswith("view: http://127.0.0.1:8123")
    assert "ssh -L 8123:127.0.0.1:8123 " in lines[1]
    opened = serving.told("0.0.0.0", 8123)
    assert opened[1].startswith("warning: anybody who can reach 0.0.0.0 can use this page")
