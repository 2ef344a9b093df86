"""Many environments of one task stepped together, bit for bit as Composer steps each of them."""

import copy
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import mujoco.batch
import numpy as np
from dm_control import composer
from dm_control.rl import control

from tasks import base

_MOST_ENVS = 100_000  # at a time; each has a simulation of its own
SEEDS = 2**32  # episode seeds lie in [0, 2**32)
_NOT_FINITE = "environment {env}: {error}"
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION  # what a row of the batch's `state` holds
_SENSORS_CURRENT = mujoco.mjtStage.mjSTAGE_VEL


class VectorStep(NamedTuple):
    """What N environments show after a reset or a control step; every array is a fresh copy.

    Attributes:
      observation: [N, D] in natural units.
      achieved_goal: [N, G] the achieved point of the end-goal space.
      achieved_subgoal: [N, H] the achieved point of the subgoal space.
      desired_goal: [N, G] the end goal of the episode.
      diverged: [N] bool, whether the physics broke down since the environment's last reset; its
        other entries then keep their last valid values.
    """

    observation: np.ndarray
    achieved_goal: np.ndarray
    achieved_subgoal: np.ndarray
    desired_goal: np.ndarray
    diverged: np.ndarray


class _Simulation(NamedTuple):
    """One environment's MuJoCo structures under the names that a task's functions look for."""

    model: mujoco.MjModel
    data: mujoco.MjData


def check_number(num_envs: int) -> None:
    """Raises ValueError for a number of environments that there cannot be."""
    if not 1 <= num_envs <= _MOST_ENVS:
        raise ValueError(f"num_envs must be from 1 to {_MOST_ENVS}, got {num_envs}")


def episode_seeds(
    seeds: np.ndarray | None, num_envs: int, stream: np.random.RandomState
) -> np.ndarray:
    """The seeds [N] that a reset was given, or the next ones of a stream.

    Raises:
      ValueError: they are not N integers in [0, 2**32).
    """
    if seeds is None:
        return stream.randint(0, SEEDS, size=num_envs, dtype=np.int64)
    found = np.asarray(seeds)
    whole = found.shape == (num_envs,) and found.dtype.kind in "iu"
    if not whole or found.min() < 0 or found.max() >= SEEDS:
        raise ValueError(f"seeds must be {num_envs} integers in [0, 2**32), got {seeds}")
    return found


def masked(mask: np.ndarray | None, num_envs: int) -> np.ndarray:
    """The environments that a mask [N] chooses, in order; None chooses all.

    Raises:
      ValueError: it is not N booleans.
    """
    if mask is None:
        return np.arange(num_envs)
    mask = np.asarray(mask)
    if mask.shape != (num_envs,) or mask.dtype != bool:
        raise ValueError(f"mask must be {num_envs} booleans, got {mask!r}")
    return np.flatnonzero(mask)


class VectorEnv:
    """N environments that share one compiled model.

    Episodes do not end here: the caller stops them when `goal_space.achieved` says so or after
    `max_steps`. Environments that a mask leaves out keep their last values.
    """

    def __init__(self, environment: composer.Environment, name: str, num_envs: int, seed: int):
        """Takes over a Composer environment of the task; `tasks.load_vector` makes one.

        Raises:
          ValueError: `num_envs` is below 1, or more than anybody means.
        """
        check_number(num_envs)
        self.name = name
        self.num_envs = num_envs
        # The Composer environment is kept: its physics prepares every reset and renders.
        self._environment = environment
        self._physics = environment.physics
        self._closed = False
        self._task: base.GoalTask = environment.task
        self.spec = self._task.spec
        self.max_steps = self.spec.max_steps
        self.horizons = self.spec.horizons
        self.control_timestep = self.spec.control_timestep
        self.goal_space = self.spec.goal_space
        self.subgoal_space = self.spec.subgoal_space
        self.observation_dim = self.spec.observation_dim
        self.observation_scale = self.spec.observation_scale
        self.observation_offset = self.spec.observation_offset
        self.action_low, self.action_high = self.spec.action_low, self.spec.action_high
        self._seeds = np.random.RandomState(seed)
        self._episode_random = np.random.RandomState(0)
        self._model = self._physics.model.ptr
        self._substeps = self._task.physics_steps_per_control_step
        self._build_simulations()
        self._readings = np.zeros((num_envs, self._task.readings(self._physics).size))
        self._goals = np.zeros((num_envs, self.goal_space.dim))
        self._diverged = np.zeros(num_envs, dtype=bool)
        self.reset(np.zeros(num_envs, dtype=np.int64))

    def _build_simulations(self) -> None:
        """Makes N simulations and holds live arrays of what each step reads and writes."""
        # On one thread: a launch runs a process for each core.
        self._batch = mujoco.batch.Batch(self._model, self.num_envs, nthread=1, persistent=True)
        self._controls = self._batch.bind("ctrl")
        self._sensors = self._batch.bind("sensordata")
        self._equalities = self._batch.bind("eq_active")
        self._warnings = self._batch.warning[:, :, 1]  # how often; [:, :, 0] is about the last
        self._warned_at_reset = self._warnings.copy()
        # Simulations with an event since their last step, as the event left them.
        self._after_event: dict[int, mujoco.MjData] = {}

    def reset(
        self, seeds: np.ndarray | None = None, *, mask: np.ndarray | None = None, test: bool = False
    ) -> VectorStep:
        """Starts new episodes.

        Args:
          seeds: [N] integers in [0, 2**32). Environment i's episode is the one that
            `tasks.load(name, seed=seeds[i], test=test)` plays first. None draws them from the
            stream that the constructor's seed began.
          mask: [N] bool, the environments to reset; None resets all.
          test: whether to begin from the test starts rather than the training starts.

        Raises:
          ValueError: a seed out of range, an argument of the wrong shape, or a closed environment.
        """
        self._check_open()
        chosen = masked(mask, self.num_envs)
        seeds = episode_seeds(seeds, self.num_envs, self._seeds)
        for i in chosen.tolist():
            self._reset_one(i, int(seeds[i]), test)
        return self._view()

    def _check_open(self) -> None:
        if self._closed:
            raise ValueError(f"this environment of {self.name} is closed; make another")

    def _reset_one(self, i: int, seed: int, test: bool) -> None:
        """Prepares an episode in Composer's physics, as Composer would, and copies it over."""
        self._episode_random.seed(seed)
        try:
            with self._physics.reset_context():
                self._task.begin_episode(self._physics, self._episode_random, test)
            readings = self._task.readings(self._physics)
            self._diverged[i] = not np.isfinite(readings).all()
        except control.PhysicsError:
            readings = self._task.readings(self._physics)
            self._diverged[i] = True
        self._after_event.pop(i, None)
        self._set_state(i, self._physics.data.ptr)
        self._warned_at_reset[i] = self._warnings[i]
        self._readings[i] = np.nan_to_num(readings, posinf=0.0, neginf=0.0)
        self._goals[i] = self._task.goal

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> VectorStep:
        """Makes one control step in each environment that is in the mask and has not diverged.

        Args:
          actions: [N, A] in natural units; clipped to the bounds.
          mask: [N] bool, the environments to step; None steps all.

        Raises:
          ValueError: an action of a stepped environment is not finite (the message names the
            environment and the action), an argument has the wrong shape, or it is closed.
        """
        self._check_open()
        chosen = masked(mask, self.num_envs)
        chosen = chosen[~self._diverged[chosen]]
        actions = np.asarray(actions, dtype=np.float64)
        if actions.shape != (self.num_envs, self.action_low.size):
            raise ValueError(
                f"actions must have shape {(self.num_envs, self.action_low.size)}, "
                f"got {actions.shape}"
            )
        self._check_finite(actions, chosen)
        if chosen.size:
            self._controls[chosen] = np.clip(actions, self.action_low, self.action_high)[chosen]
            self._advance(chosen)
            self._read(chosen)
        return self._view()

    def _advance(self, chosen: np.ndarray) -> None:
        """Steps physics in dm_control's order, so that sensors are current afterwards."""
        if not self._after_event:
            self._batch.step(chosen, self._substeps, _SENSORS_CURRENT)
            return
        late = np.isin(chosen, list(self._after_event))
        self._batch.step(chosen[~late], self._substeps, _SENSORS_CURRENT)
        for i in chosen[late].tolist():
            self._step_after_event(i)
        if self._substeps > 1:
            self._batch.step(chosen[late], self._substeps - 1, _SENSORS_CURRENT)
        else:
            self._batch.forward(chosen[late], _SENSORS_CURRENT)

    def _step_after_event(self, i: int) -> None:
        """Makes the first physics step after an event, as Composer makes it.

        There a step ends by computing what depends on positions and velocities; an event comes
        after that, so what was computed does not know of it yet.
        """
        data = self._after_event.pop(i)
        warned = data.warning.number.copy()
        data.ctrl[:] = self._controls[i]
        mujoco.mj_step2(self._model, data)
        self._set_state(i, data)
        self._warned_at_reset[i] -= data.warning.number - warned

    def _set_state(self, i: int, data: mujoco.MjData) -> None:
        mujoco.mj_getState(self._model, data, self._batch.state[i], _STATE)

    def _read(self, chosen: np.ndarray) -> None:
        """Takes the readings of the stepped environments, but for those that just diverged."""
        # dm_control raises PhysicsError for any MuJoCo warning that a step adds.
        broken = (self._warnings[chosen] > self._warned_at_reset[chosen]).any(axis=-1)
        self._diverged[chosen[broken]] = True
        readings = self._sensors[chosen]
        if self._model.neq:
            readings = np.concatenate([readings, self._equalities[chosen]], axis=-1)
        if broken.any():
            chosen, readings = chosen[~broken], readings[~broken]
        if self._task.has_event:
            readings = self._apply_events(chosen, readings)
        self._readings[chosen] = readings

    def _apply_events(self, chosen: np.ndarray, readings: np.ndarray) -> np.ndarray:
        for row in np.flatnonzero(self._task.event_mask(readings)).tolist():
            i = int(chosen[row])
            self._after_event[i] = self._batch.get_data(i)
            self._change(i, self._task.apply_event)
            readings[row] = self._task.readings(_Simulation(self._model, self._after_event[i]))
        return readings

    def _view(self) -> VectorStep:
        readings = self._readings
        return VectorStep(
            observation=self._task.observation(readings),
            achieved_goal=self._task.achieved_goal(readings).copy(),
            achieved_subgoal=self._task.achieved_subgoal(readings).copy(),
            desired_goal=self._goals.copy(),
            diverged=self._diverged.copy(),
        )

    def _check_finite(self, actions: np.ndarray, chosen: np.ndarray) -> None:
        bad = chosen[~np.isfinite(actions[chosen]).all(axis=-1)]
        if bad.size:
            try:
                self._task.check_actions(self._physics, actions[bad[0]])
            except ValueError as error:
                raise ValueError(_NOT_FINITE.format(env=bad[0], error=error)) from None

    def show_subgoals(self, i: int, subgoals: Sequence[np.ndarray | None]) -> None:
        """Shows environment i's subgoals when it is rendered.

        Args:
          i: the environment.
          subgoals: [H] each, the one that the lowest level pursues first; None hides a level's.
        """
        self._change(i, lambda physics: self._task.place_subgoal_markers(physics, subgoals))

    def move_goal(self, i: int, goal: np.ndarray) -> VectorStep:
        """Gives environment i's episode another end goal [G], in natural units, and shows it.

        Raises:
          ValueError: the goal has another shape, or is not finite; or a closed environment.
        """
        self._check_open()
        goal = np.asarray(goal, np.float64)
        if goal.shape != (self.goal_space.dim,) or not np.isfinite(goal).all():
            raise ValueError(f"a goal is {self.goal_space.dim} finite numbers, got {goal}")
        self._goals[i] = goal
        self._change(i, lambda physics: self._task.place_goal_marker(physics, goal))
        return self._view()

    def _change(self, i: int, change: Callable[[_Simulation], None]) -> None:
        """Lets a function write to environment i's data."""
        data = self._after_event.get(i)
        if data is None:
            data = self._batch.get_data(i)
        change(_Simulation(self._model, data))
        self._set_state(i, data)

    def simulation(self, i: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Environment i's model and a copy of its state, for those who draw them."""
        data = mujoco.MjData(self._model)
        mujoco.mj_setState(self._model, data, self._batch.state[i], _STATE)
        mujoco.mj_forward(self._model, data)
        return self._model, data

    def render(
        self, i: int, *, camera: int | str = 0, height: int = 480, width: int = 640
    ) -> np.ndarray:
        """Returns a picture of environment i, uint8 [height, width, 3], without disturbing it."""
        self._check_open()
        mujoco.mj_setState(self._model, self._physics.data.ptr, self._batch.state[i], _STATE)
        # All that pictures show: bodies, flexes, cameras that follow, lights, and tendons.
        mujoco.mj_fwdPosition(self._model, self._physics.data.ptr)
        return self._physics.render(height=height, width=width, camera_id=camera).copy()

    def snapshot(self) -> dict[str, Any]:
        """Where all environments stand: what `restore` of another of this task takes."""
        return {
            "state": self._batch.state.copy(),
            "after_event": copy.deepcopy(self._after_event),
            "readings": self._readings.copy(),
            "goals": self._goals.copy(),
            "diverged": self._diverged.copy(),
            "seeds": self._seeds.get_state(),
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Makes all environments stand where those did of which the snapshot is."""
        self._batch.state[:] = snapshot["state"]
        self._after_event = copy.deepcopy(snapshot["after_event"])
        self._warned_at_reset[:] = self._warnings
        self._readings[:] = snapshot["readings"]
        self._goals[:] = snapshot["goals"]
        self._diverged[:] = snapshot["diverged"]
        self._seeds.set_state(snapshot["seeds"])

    def close(self) -> None:
        """Frees the physics and the rendering context; nothing can be used after. Repeatable."""
        if not self._closed:
            self._environment.close()
            self._closed = True
