"""The goal-conditioned Composer task that every task builds on."""

import abc
import collections
from collections.abc import Callable, Sequence

import numpy as np
from dm_control import composer
from dm_control.composer.observation import observable

from tasks import markers as markers_lib
from tasks.task_spec import TaskSpec

_NOT_FINITE = "action {index} ({name}) is {value}; actions must be finite"
_NO_PLACEMENT = (
    "{task}: no valid {what} in {attempts} attempts; widen its range or relax what it must satisfy"
)
_NO_GOAL = (
    "{task}.sample_episode returned the goal {goal}; it must return {count} finite numbers, in the "
    "order of goal_space.names"
)
_NOT_AS_SPECIFIED = "{task}: its spec says {what} {said}, but the task has {found}"
_PLACEMENT_ATTEMPTS = 1000


class GoalTask(composer.Task):
    """A task whose episodes have a goal to reach (section 4.1 of the paper).

    What the agent observes and what it has achieved are pure functions of the `readings`: the
    model's sensors, then 1.0 or 0.0 for each equality constraint that is active. Composer's
    observables and the vectorised stepping of `tasks.vector` call the same functions.

    The reward is -1 after each control step that does not achieve the goal and 0 after one that
    does; the discount is 0 only on success. An episode ends on success or after `max_steps`
    control steps.

    Subclasses define `observation_parts`, `achieved_goal`, `achieved_subgoal`, `sample_episode`,
    `place_goal_marker` and `place_subgoal_marker`; those with events during an episode also define
    `event_mask` and `apply_event`.
    """

    def __init__(
        self,
        arena: composer.Arena,
        spec: TaskSpec,
        *,
        markers: Sequence[markers_lib.Marker],
        test: bool = False,
    ):
        """Initialises the task; bodies other than markers are already in the arena.

        Args:
          arena: the root entity.
          spec: the task's spaces, steps and scales, with which it is registered.
          markers: goal and subgoal markers, which are attached to the arena here.
          test: whether episodes begin from the test starts rather than the training starts.
        """
        self._arena = arena
        self.spec = spec
        self._test = test
        self._step_count = 0
        self._goal = np.zeros(spec.goal_space.dim)
        for marker in markers:
            marker.attach_to(arena)
        self.control_timestep = spec.control_timestep
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
        """Changes the model's state, such as switching on a constraint. Touches `data` only.

        `physics` has MuJoCo's own `model` and `data`, and nothing else.
        """
        raise NotImplementedError(f"{type(self).__name__} has no event to apply")

    @property
    def has_event(self) -> bool:
        """Whether something may happen to the model between control steps."""
        return type(self).event_mask is not GoalTask.event_mask

    @abc.abstractmethod
    def place_goal_marker(self, physics, goal: np.ndarray) -> None:
        """Shows the end goal [G]; `physics` has MuJoCo's own `model` and `data`, nothing else."""

    @abc.abstractmethod
    def place_subgoal_marker(self, physics, level: int, subgoal: np.ndarray | None) -> None:
        """Shows the subgoal [H] for a level (0 = the lowest); hides its marker for None.

        `physics` has MuJoCo's own `model` and `data`, and nothing else.
        """

    # An episode.

    @property
    def goal(self) -> np.ndarray:
        """The current episode's end goal [G] (a copy)."""
        return self._goal.copy()

    def begin_episode(self, physics, random_state, test: bool) -> None:
        """Starts an episode from a test start or a training start.

        Raises:
          ValueError: `sample_episode` returned something else than a goal.
        """
        self._step_count = 0
        goal = np.array(self.sample_episode(physics, random_state, test), dtype=np.float64)
        if goal.shape != (self.spec.goal_space.dim,) or not np.isfinite(goal).all():
            count = self.spec.goal_space.dim
            raise ValueError(_NO_GOAL.format(task=type(self).__name__, goal=goal, count=count))
        self._goal = goal
        self.place_goal_marker(physics, self._goal)

    def place_subgoal_markers(self, physics, subgoals: Sequence[np.ndarray | None]) -> None:
        """Shows subgoals, the lowest level's first; levels with None or beyond the end hide."""
        for level in range(markers_lib.SUBGOAL_LEVELS):
            subgoal = subgoals[level] if level < len(subgoals) else None
            self.place_subgoal_marker(physics, level, subgoal)

    def check_actions(self, physics, actions: np.ndarray) -> None:
        """Raises ValueError naming the first of the actions [A] that is not finite."""
        bad = np.flatnonzero(~np.isfinite(actions))
        if bad.size:
            index = int(bad[0])
            name = physics.model.id2name(index, "actuator") or str(index)
            raise ValueError(_NOT_FINITE.format(index=index, name=name, value=actions[index]))

    def _succeeded(self, physics) -> bool:
        return bool(
            self.spec.goal_space.achieved(self.achieved_goal(self.readings(physics)), self._goal)
        )

    # Composer's hooks.

    @property
    def root_entity(self) -> composer.Arena:
        return self._arena

    @property
    def task_observables(self):
        return self._task_observables

    def after_compile(self, physics, random_state) -> None:
        """Makes the observables: the observation's parts, and points of both spaces.

        Raises:
          ValueError: the compiled model is not what the spec says.
        """
        del random_state
        self._check_spec(physics)
        functions: dict[str, Callable[..., np.ndarray]] = {}
        for part in self.spec.observation:
            functions[part] = lambda physics, part=part: self.observation_parts(
                self.readings(physics)
            )[part]
        functions["achieved_goal"] = lambda physics: self.achieved_goal(self.readings(physics))
        functions["achieved_subgoal"] = lambda physics: self.achieved_subgoal(
            self.readings(physics)
        )
        functions["desired_goal"] = lambda physics: self._goal.copy()
        self._task_observables.clear()
        for name, function in functions.items():
            self._task_observables[name] = observable.Generic(function)
            self._task_observables[name].enabled = True

    def _check_spec(self, physics) -> None:
        """Raises ValueError where the model's sizes or bounds are not those of the spec."""
        spec, readings = self.spec, self.readings(physics)
        bounds = physics.model.actuator_ctrlrange
        parts = self.observation_parts(readings)
        pairs = {
            "observation parts and sizes": (
                [(name, len(scale)) for name, scale in spec.observation.items()],
                [(name, part.size) for name, part in parts.items()],
            ),
            "goal space's dimensions": (spec.goal_space.dim, self.achieved_goal(readings).size),
            "subgoal space's dimensions": (
                spec.subgoal_space.dim,
                self.achieved_subgoal(readings).size,
            ),
            "action_low": (spec.action_low.tolist(), bounds[:, 0].tolist()),
            "action_high": (spec.action_high.tolist(), bounds[:, 1].tolist()),
        }
        for what, (said, found) in pairs.items():
            if said != found:
                raise ValueError(
                    _NOT_AS_SPECIFIED.format(
                        task=type(self).__name__, what=what, said=said, found=found
                    )
                )

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
        return self._step_count >= self.spec.max_steps or self._succeeded(physics)
