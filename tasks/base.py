"""The goal-conditioned Composer task that every task builds on."""

import abc
import collections
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import numpy.typing as npt
from dm_control import composer
from dm_control.composer.observation import observable

from tasks import goal_space as goal_space_lib
from tasks import markers as markers_lib

_NOT_FINITE = "action {index} ({name}) is {value}; actions must be finite"
_NO_PLACEMENT = (
    "{task}: no valid {what} in {attempts} attempts; widen its range or relax what it must satisfy"
)
_PLACEMENT_ATTEMPTS = 1000


class GoalTask(composer.Task):
    """A task whose episodes are to reach a goal (section 4.1 of the paper).

    What the agent observes and what it has achieved are pure functions of the `readings`: the
    model's sensors, then 1.0 or 0.0 for each equality constraint that is active. Composer's
    observables and the vectorised stepping of `tasks.vector` call the same functions.

    The reward is -1 after each control step that does not achieve the goal and 0 after one that
    does; the discount is 0 only on success. An episode ends on success or after `max_steps`
    control steps.

    Subclasses say `observation_parts`, `achieved_goal`, `achieved_subgoal`, `sample_episode`,
    `place_goal_marker` and `place_subgoal_marker`; those in which something happens to the model
    during an episode also say `event_mask` and `apply_event`.
    """

    def __init__(
        self,
        arena: composer.Arena,
        *,
        goal_space: goal_space_lib.GoalSpace,
        subgoal_space: goal_space_lib.GoalSpace,
        observation_scale: npt.ArrayLike,
        markers: Sequence[markers_lib.Marker],
        control_timestep: float,
        max_steps: int,
        horizons: Mapping[int, tuple[int, ...]] | None = None,
        test: bool = False,
    ):
        """Initialises the task; bodies other than markers are already in the arena.

        Args:
          arena: the root entity.
          goal_space: the space of end goals, G dimensions.
          subgoal_space: the space of subgoals, H dimensions.
          observation_scale: [D] what the observation is divided by to come out about [-1, 1].
          markers: goal and subgoal markers, which are attached to the arena here.
          control_timestep: seconds between actions, a multiple of the physics timestep.
          max_steps: control steps after which an episode is cut off.
          horizons: by number of subgoal layers, the attempts (T_0, ..., T_n) that suit this task
            better than equal ones.
          test: whether episodes begin from the test starts rather than the training starts.
        """
        self._arena = arena
        self.goal_space = goal_space
        self.subgoal_space = subgoal_space
        self.observation_scale = np.asarray(observation_scale, dtype=np.float64)
        self.max_steps = max_steps
        self.horizons = dict(horizons or {})
        self._test = test
        self._step_count = 0
        self._goal = np.zeros(goal_space.dim)
        self._subgoals = np.zeros((markers_lib.SUBGOAL_LEVELS, subgoal_space.dim))
        for marker in markers:
            marker.attach_to(arena)
        self.control_timestep = control_timestep
        self._task_observables: collections.OrderedDict = collections.OrderedDict()

    # What the task is: one definition each, used by Composer and by the vectorised path.

    def readings(self, physics) -> np.ndarray:
        """The sensors followed by the activity of each equality constraint, [R] (a copy)."""
        return np.concatenate([physics.data.sensordata, physics.data.eq_active])

    @abc.abstractmethod
    def observation_parts(self, readings: np.ndarray) -> dict[str, np.ndarray]:
        """The named parts of the observation, each [..., k], from readings [..., R]."""

    def observation(self, readings: np.ndarray) -> np.ndarray:
        """The observation [..., D]: its parts side by side, in natural units."""
        return np.concatenate(list(self.observation_parts(readings).values()), axis=-1)

    @abc.abstractmethod
    def achieved_goal(self, readings: np.ndarray) -> np.ndarray:
        """The achieved point [..., G] of the end-goal space, from readings [..., R]."""

    @abc.abstractmethod
    def achieved_subgoal(self, readings: np.ndarray) -> np.ndarray:
        """The achieved point [..., H] of the subgoal space, from readings [..., R]."""

    @abc.abstractmethod
    def sample_episode(self, physics, random_state, test: bool) -> np.ndarray:
        """Sets positions and velocities for a start, and returns the episode's goal [G].

        Raises:
          composer.EpisodeInitializationError: no valid start or goal was found.
        """

    def draw(self, what: str, propose: Callable, accept: Callable) -> np.ndarray:
        """Returns the first value of `propose()` that `accept(value)` takes.

        Raises:
          composer.EpisodeInitializationError: none did; the message says `what` was sought.
        """
        for _ in range(_PLACEMENT_ATTEMPTS):
            value = propose()
            if accept(value):
                return value
        raise composer.EpisodeInitializationError(
            _NO_PLACEMENT.format(task=type(self).__name__, what=what, attempts=_PLACEMENT_ATTEMPTS)
        )

    def event_mask(self, readings: np.ndarray) -> np.ndarray:
        """Where `apply_event` is due after a control step: bool [...], from readings [..., R]."""
        return np.zeros(readings.shape[:-1], dtype=bool)

    def apply_event(self, physics) -> None:
        """Changes the model's state, such as switching on a constraint. Touches `data` only."""
        raise NotImplementedError(f"{type(self).__name__} has no event to apply")

    @property
    def has_event(self) -> bool:
        """Whether something may happen to the model between control steps."""
        return type(self).event_mask is not GoalTask.event_mask

    @abc.abstractmethod
    def place_goal_marker(self, physics, goal: np.ndarray) -> None:
        """Shows the end goal [G]."""

    @abc.abstractmethod
    def place_subgoal_marker(self, physics, level: int, subgoal: np.ndarray | None) -> None:
        """Shows the subgoal [H] for a level (0 = the lowest); hides its marker for None."""

    # An episode.

    @property
    def goal(self) -> np.ndarray:
        """The current episode's end goal [G] (a copy)."""
        return self._goal.copy()

    def begin_episode(self, physics, random_state, test: bool) -> None:
        """Starts an episode from a test start or a training start."""
        self._step_count = 0
        self._subgoals[:] = 0.0
        self._goal = np.array(self.sample_episode(physics, random_state, test), dtype=np.float64)
        self.place_goal_marker(physics, self._goal)

    def place_subgoal_markers(self, physics, subgoals: Sequence[np.ndarray | None]) -> None:
        """Shows subgoals, the lowest level's first; levels with None or beyond the end hide."""
        for level in range(markers_lib.SUBGOAL_LEVELS):
            subgoal = subgoals[level] if level < len(subgoals) else None
            self.place_subgoal_marker(physics, level, subgoal)

    def set_subgoals(self, physics, subgoals: Sequence[np.ndarray | None]) -> None:
        """Makes these the current subgoals: observable as "subgoal_0", "subgoal_1", and shown."""
        for level in range(markers_lib.SUBGOAL_LEVELS):
            subgoal = subgoals[level] if level < len(subgoals) else None
            self._subgoals[level] = 0.0 if subgoal is None else subgoal
        self.place_subgoal_markers(physics, subgoals)

    def check_actions(self, physics, actions: np.ndarray) -> None:
        """Raises ValueError naming the first of the actions [A] that is not finite."""
        bad = np.flatnonzero(~np.isfinite(actions))
        if bad.size:
            index = int(bad[0])
            name = physics.model.id2name(index, "actuator") or str(index)
            raise ValueError(_NOT_FINITE.format(index=index, name=name, value=actions[index]))

    def _succeeded(self, physics) -> bool:
        return bool(
            self.goal_space.achieved(self.achieved_goal(self.readings(physics)), self._goal)
        )

    # Composer's hooks.

    @property
    def root_entity(self) -> composer.Arena:
        return self._arena

    @property
    def task_observables(self):
        return self._task_observables

    def after_compile(self, physics, random_state) -> None:
        """Makes the observables; only the compiled model tells how many readings there are."""
        del random_state
        functions: dict[str, Callable[..., np.ndarray]] = {}
        for part in self.observation_parts(self.readings(physics)):
            functions[part] = lambda physics, part=part: self.observation_parts(
                self.readings(physics)
            )[part]
        functions["achieved_goal"] = lambda physics: self.achieved_goal(self.readings(physics))
        functions["desired_goal"] = lambda physics: self._goal.copy()
        for level in range(markers_lib.SUBGOAL_LEVELS):
            functions[f"subgoal_{level}"] = lambda physics, i=level: self._subgoals[i].copy()
        self._task_observables.clear()
        for name, function in functions.items():
            self._task_observables[name] = observable.Generic(function)
            self._task_observables[name].enabled = True

    def initialize_episode(self, physics, random_state) -> None:
        self.begin_episode(physics, random_state, self._test)

    def before_step(self, physics, action, random_state) -> None:
        del random_state
        self.check_actions(physics, action)
        self._step_count += 1
        # `bind(...).ctrl` would mark the physics dirty and cost a forward pass.
        physics.set_control(action)

    def after_step(self, physics, random_state) -> None:
        del random_state
        if self.has_event and self.event_mask(self.readings(physics)):
            self.apply_event(physics)

    def get_reward(self, physics) -> float:
        return 0.0 if self._succeeded(physics) else -1.0

    def get_discount(self, physics) -> float:
        return 0.0 if self._succeeded(physics) else 1.0

    def should_terminate_episode(self, physics) -> bool:
        return self._step_count >= self.max_steps or self._succeeded(physics)
