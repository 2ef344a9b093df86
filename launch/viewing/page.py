"""The live page: controls, panels and the scene, for an episode that runs in this process."""

import functools
import queue
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import hac_suite
import tasks
from analysis.program import CommandError
from analysis.reading import paper
from launch.folder import policies
from launch.pictures.scene import Scene
from launch.pictures.stage import Stage, Watched, simulation_of
from launch.viewing import panel
from launch.viewing.episode import Episode
from launch.viewing.goal_handle import GoalHandle
from launch.viewing.player import SPEEDS, Player

_IDLE_SECONDS = 0.05
_PANEL_SECONDS = 0.1  # between updates of what stands beside the picture
_FRAME_SECONDS = 1 / 40
_SEEDS = 2**32 - 1
_LEAST_STEPS = 150  # of a slider


class Page:
    """Everything that one server shows. All its work is done in the thread that calls `run`."""

    def __init__(
        self,
        server: Any,
        env: Watched,
        spec: tasks.TaskSpec,
        found: Sequence[policies.Found],
        chosen: policies.Found,
        seed: int = 0,
    ):
        """Shows the start of an episode.

        Args:
          server: as `scene.private` makes it.
          env: one environment of the task.
          spec: the task's.
          found: the policies to choose from, all of the task.
          chosen: the one to begin with.
          seed: of the episode to begin with.

        Raises:
          CommandError: the policy cannot be loaded or run, or its task cannot be drawn.
        """
        self._server, self._env, self._spec, self._found = server, env, spec, list(found)
        self._commands: queue.Queue[Callable[[], None]] = queue.Queue()
        self._chosen, self._seed = chosen, seed
        self._policy = _load(chosen)
        self.player = Player(self._episode(), spec.control_timestep)
        if simulation_of(env) is None:
            raise CommandError(
                f"{chosen.task}: MuJoCo does not simulate it, so there are no bodies to show here; "
                "`python launch/play.py --output=video.mp4` renders it"
            )
        self._env.show_subgoals(0, [])
        self._stage = Stage(env)
        self._handle = GoalHandle(env, self._stage, self.player.episode.goal)
        self._scene = Scene(server, self._stage)
        self._marker = np.zeros(3)  # where the goal's marker is drawn
        self._grip: np.ndarray | None = None  # from the pointer to the marker, while it is dragged
        self._dragged: np.ndarray | None = None  # where the marker is to go
        self._panelled = self._framed = 0.0
        self._build()
        self._restart()
        self._refresh()

    def _episode(self) -> Episode:
        try:
            return Episode(self._env, self._policy, self._seed)
        except (KeyError, TypeError, ValueError) as error:
            raise CommandError(f"policy {self._chosen.path}: {error}") from error

    # What is on the page.

    def _build(self) -> None:
        gui = self._server.gui
        gui.set_panel_label(self._chosen.task)
        gui.main_panel.dock_right()
        self._status = gui.add_html("")
        self._play = gui.add_button("Play", icon="player-play")
        self._play.on_click(lambda _: self._do(self._toggle))
        self._move = gui.add_button_group("", ("Step", "Restart", "Next episode"))
        self._move.on_click(self._pressed)
        self._levels = gui.add_html("")
        gui.add_html(panel.key())
        with gui.add_folder("Latest outcomes"):
            self._endings = gui.add_html("")
        with gui.add_folder("What is played"):
            self._build_choices(gui)
        with gui.add_folder("End goal"):
            self._build_goal(gui)

    def _build_choices(self, gui: Any) -> None:
        agents = sorted({policy.subgoal_layers for policy in self._found})
        names = [paper.agent_name(layers) for layers in agents]
        self._agent = gui.add_dropdown(
            "agent", names, initial_value=paper.agent_name(self._chosen.subgoal_layers)
        )
        self._agent.on_update(self._by_person(self._choose_agent))
        self._which = gui.add_dropdown("policy", self._labels(), initial_value=_label(self._chosen))
        self._which.on_update(self._by_person(self._choose_policy))
        self._seed_box = gui.add_number("episode", self._seed, min=0, max=_SEEDS, step=1)
        self._seed_box.on_update(self._by_person(self._choose_seed))
        speed = next(word for word, times in SPEEDS.items() if times == self.player.speed)
        self._speed = gui.add_dropdown(
            "speed", list(SPEEDS), initial_value=speed, hint="1 is real time"
        )
        self._speed.on_update(
            lambda _: self._do(lambda: setattr(self.player, "speed", SPEEDS[self._speed.value]))
        )

    def _build_goal(self, gui: Any) -> None:
        space = self._spec.goal_space
        self._sliders = []
        if self._handle.why_fixed:
            gui.add_html(panel.hint(self._handle.why_fixed))
            return
        for index, (name, unit) in enumerate(zip(space.names, space.units, strict=True)):
            low, high = float(space.low[index]), float(space.high[index])
            slider = gui.add_slider(
                f"{name} ({unit})",
                min=low,
                max=high,
                step=_round_step(high - low),
                initial_value=low,
            )
            slider.on_update(self._by_person(functools.partial(self._slid, index)))
            self._sliders.append(slider)
        if any(self._handle.axes):
            gui.add_html(panel.hint("Or drag the goal's marker in the picture."))
            self._scene.on_drag(self._stage.goal, self._drag)

    def _labels(self) -> list[str]:
        return [_label(policy) for policy in self._of_agent()]

    def _of_agent(self) -> list[policies.Found]:
        layers = self._chosen.subgoal_layers
        return [policy for policy in self._found if policy.subgoal_layers == layers]

    # What a person does: the server's threads put it into the queue, and `run` carries it out.

    def _do(self, command: Callable[[], None]) -> None:
        self._commands.put(command)

    def _pressed(self, event: Any) -> None:
        self._do(functools.partial(self._moved, event.target.value))

    def _by_person(self, command: Callable[[], None]) -> Callable[[Any], None]:
        """For what a person changes on the page, and not what `run` itself writes there."""

        def changed(event: Any) -> None:
            if event.client is not None:
                self._do(command)

        return changed

    async def _drag(self, event: Any) -> None:
        """Notes where the marker is to go: as far from the pointer as when it was taken."""
        if event.phase == "start" or self._grip is None:
            self._grip = self._marker - event.start_position
        self._dragged = event.end_position + self._grip
        if event.phase == "end":
            self._grip = None

    def _toggle(self) -> None:
        if self.player.running:
            self.player.pause()
        else:
            if self.player.episode.over:
                self._restart()
            self.player.play(time.monotonic())

    def _moved(self, word: str) -> None:
        if word == "Step":
            self.player.pause()
            self.player.step()
        elif word == "Restart":
            self._restart()
        else:
            self._seed = (self._seed + 1) % _SEEDS
            self._seed_box.value = self._seed
            self._restart()

    def _choose_seed(self) -> None:
        self._seed = int(self._seed_box.value)
        self._restart()

    def _choose_agent(self) -> None:
        agents = {paper.agent_name(policy.subgoal_layers): policy for policy in self._found}
        layers = agents[self._agent.value].subgoal_layers
        own = [policy for policy in self._found if policy.subgoal_layers == layers]
        if self._take(policies.typical(own)[0]):
            self._which.options = self._labels()
            self._which.value = _label(self._chosen)

    def _choose_policy(self) -> None:
        self._take(next(p for p in self._of_agent() if _label(p) == self._which.value))

    def _take(self, policy: policies.Found) -> bool:
        """Plays another policy; if it cannot be played, says why and stays with the present one."""
        before = self._chosen, self._policy
        try:
            self._chosen, self._policy = policy, _load(policy)
            self._restart()
        except CommandError as error:
            self._chosen, self._policy = before
            for client in self._server.get_clients().values():
                client.add_notification("This policy cannot be played", str(error), color="red")
            self._agent.value = paper.agent_name(self._chosen.subgoal_layers)
            self._which.value = _label(self._chosen)
            return False
        return True

    def _restart(self) -> None:
        self.player.begin(self._episode())
        self._show_goal()
        if self.player.playing:
            self.player.play(time.monotonic())

    def _slid(self, index: int) -> None:
        goal = self.player.episode.goal.copy()
        goal[index] = self._sliders[index].value
        self.player.move_goal(goal)

    def _show_goal(self) -> None:
        """The sliders show the goal that now is; there are none for one that cannot be moved."""
        for slider, value in zip(self._sliders, self.player.episode.goal, strict=False):
            within = float(np.clip(value, slider.min, slider.max))
            slider.value = round(within, -round(np.log10(slider.step)))

    def _follow_drag(self) -> None:
        if self._dragged is None:
            return
        place, self._dragged = self._dragged, None
        self.player.move_goal(self._handle.goal_at(place, self.player.episode.goal))
        self._show_goal()

    # Time.

    def run(self, stopped: Callable[[], bool]) -> None:
        """Serves the page until `stopped()` is true."""
        while not stopped():
            self.turn(time.monotonic())

    def turn(self, now: float) -> None:
        """Carries out what a person asked for and what is due, and shows it."""
        changed = self._carry_out(self.player.seconds_to_wait(now, _IDLE_SECONDS))
        if self._dragged is not None:
            self._follow_drag()
            changed = True
        if self.player.tick(time.monotonic()) or changed:
            self._refresh(changed)

    def _carry_out(self, wait: float) -> bool:
        done = False
        while True:
            try:
                command = self._commands.get(block=not done and wait > 0, timeout=wait or None)
            except queue.Empty:
                return done
            command()
            done = True

    def _refresh(self, everything: bool = True) -> None:
        """Brings picture and panels up to date; both only so often while an episode plays."""
        now, over = time.monotonic(), self.player.episode.over
        with self._server.atomic():
            if everything or over or now - self._framed >= _FRAME_SECONDS:
                self._scene.draw(self._stage.poses())
                if self._stage.goal:
                    self._marker = self._handle.place()
                self._framed = now
            if everything or over or now - self._panelled >= _PANEL_SECONDS:
                self._write_panels()
                self._panelled = now

    def _write_panels(self) -> None:
        player = self.player
        self._play.label = "Pause" if player.running else "Play"
        self._play.icon = "player-pause" if player.running else "player-play"
        self._status.content = panel.status(player.episode, self._spec.max_steps, self._spec.title)
        statuses = player.episode.statuses()
        self._levels.content = panel.levels(statuses, player.counts, self._stage)
        self._endings.content = panel.endings(player.recent)


def _load(found: policies.Found) -> hac_suite.Policy:
    try:
        return hac_suite.Policy.load(found.path)
    except ValueError as error:
        raise CommandError(f"policy {found.path}: {error}") from error


def _round_step(span: float) -> float:
    """A power of ten that goes some hundreds of times into a span."""
    return float(10.0 ** np.floor(np.log10(span / _LEAST_STEPS)))


def _label(found: policies.Found) -> str:
    return f"seed {found.seed}, {found.success_rate:.0%} in its last test"
