"""A copy of a Gymnasium environment as flat arrays, and a pool of copies to share."""

import contextlib
import random
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium
import mujoco
import numpy as np

from tasks.errors import one_line
from tasks.worlds import making

_NO_GOAL = (
    "{word}: its observations are {space}, not a dictionary of observation, achieved_goal and "
    "desired_goal with a compute_reward: name the elements that are the goal, as in "
    "--goal='obs[0:2]' with --goal_threshold=0.1"
)
_NO_REWARD = (
    "{word}: it has goals, but no compute_reward(achieved_goal, desired_goal, info) that says "
    "when they are achieved; give --goal_threshold, or add compute_reward to the environment"
)
_HAS_GOAL = "{word}: it has goals of its own; --goal is for environments that have none"
_NO_THRESHOLD = (
    "{word}: --goal={goal} needs --goal_threshold, the distance within which it is achieved"
)
_BAD_VALUE = "{what}={text}: {count} elements are chosen, but the values are {values}"
_FIXED_GOAL = "{word}: it does not store its goal in an array `goal`, so the goal cannot be moved"
_UNDETERMINED = (
    "{word}: reset(seed=...) does not determine {what}: two episodes of one seed differ. HAC's "
    "results must depend on seeds alone; use self.np_random in the environment after "
    "super().reset(seed=seed), and reset all that the last episode changed"
)
_FAILED = "{word}: its {what} failed: {error}"
_RETURNED = "it returned {given}, but must return {wanted}"
_TUPLES = {
    "reset": ("observation", "info"),
    "step": ("observation", "reward", "terminated", "truncated", "info"),
}
_SHARED = (
    "{word}: copies of it are not independent: what one does changes another's episode. Keep its "
    "state in the instance, not in the class or the module"
)
_OTHER_SIZE = (
    "{word}: its {part} has {found} numbers, but its observation space declares {declared}"
)
GLOBAL_RANDOM = "it uses numpy's or Python's global random generators, which the suite seeds for it"
_PROBE_SEED, _PROBE_STEPS = 123, 5
_BROKEN = [  # MuJoCo's warnings after which it resets the state in mid-episode
    int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{what}")) for what in ("QPOS", "QVEL", "QACC")
]


class EnvFailed(ValueError):
    """The environment's own code raised something; one line says what."""


class Options(NamedTuple):
    """What a person said of an environment beside its id."""

    goal: str = ""  # 'obs[0:2]' or 'obs[0:2]=1,0': the goal of an environment without one
    subgoal: str = ""  # 'obs[0:4]': the subgoal space; none: the goal space's own
    threshold: tuple[float, ...] = ()  # of end goals, in place of compute_reward
    train: Mapping[str, Any] | None = None  # options of resets
    test: Mapping[str, Any] | None = None


class View(NamedTuple):
    """What one copy shows, flat and in float64."""

    observation: np.ndarray  # [D]
    achieved_goal: np.ndarray  # [G]
    achieved_subgoal: np.ndarray  # [H]
    desired_goal: np.ndarray  # [G]


def finite(view: View) -> bool:
    """Whether all of its numbers are."""
    return bool(np.isfinite(np.concatenate(view)).all())


class Reader:
    """Turns an environment's observations into a View: which numbers are what.

    Goals that the observation does not contain already are added to it: an agent that is not told
    where it is cannot learn to go anywhere.
    """

    def __init__(self, word: str, env: gymnasium.Env, options: Options):
        """Raises ValueError where there is no goal, or a choice of numbers that there are not."""
        space = env.observation_space
        self.word, self._options = word, options
        self.goals = making.has_goals(space)
        if self.goals and options.goal:
            raise ValueError(_HAS_GOAL.format(word=word))
        if not self.goals and not options.goal:
            raise ValueError(_NO_GOAL.format(word=word, space=making.kind(space)))
        if self.goals and not options.threshold and making.method(env, "compute_reward") is None:
            raise ValueError(_NO_REWARD.format(word=word))
        if options.goal and not options.threshold:
            raise ValueError(_NO_THRESHOLD.format(word=word, goal=options.goal))
        parts = space.spaces if isinstance(space, gymnasium.spaces.Dict) else {}
        if self.goals:
            making.check_goals(word, parts)
        self._space = parts["observation"] if self.goals else space
        self._goal_space = parts["desired_goal"] if self.goals else None
        self._size = size = gymnasium.spaces.flatdim(self._space)
        self.notes = making.check_size(word, size)
        text, _, fixed = options.goal.partition("=")
        self._goal_at = None if self.goals else making.indices("--goal", text, size, "=VALUES")
        self.fixed_goal = self._fixed(fixed) if fixed else None
        self._subgoal_at = (
            making.indices("--subgoal", options.subgoal, size) if options.subgoal else None
        )
        self.adds_goal = False

    def _fixed(self, text: str) -> np.ndarray:
        assert self._goal_at is not None
        try:
            values = np.array([float(number) for number in text.split(",")])
        except ValueError:
            values = np.zeros(0)
        if len(values) != len(self._goal_at) or not np.isfinite(values).all():
            raise ValueError(
                _BAD_VALUE.format(
                    what="--goal", text=self._options.goal, count=len(self._goal_at), values=text
                )
            )
        return values

    @property
    def goal_shape(self) -> tuple[int, ...]:
        if self._goal_space is not None and self._goal_space.shape is not None:
            return self._goal_space.shape
        return () if self._goal_at is None else self._goal_at.shape

    @property
    def goal_dtype(self) -> Any:
        return np.float64 if self._goal_space is None else self._goal_space.dtype

    def view(self, seen: Any, goal: np.ndarray | None = None) -> View:
        """What an observation of the environment shows.

        Args:
          goal: the end goal, for environments that have none of their own.
        """
        own = seen["observation"] if self.goals else seen
        flat = self._of_size("observation", gymnasium.spaces.flatten(self._space, own), self._size)
        if self.goals:
            size = int(np.prod(self.goal_shape))
            achieved, desired = (
                self._of_size(part, seen[part], size) for part in ("achieved_goal", "desired_goal")
            )
        else:
            achieved = flat[self._goal_at]
            desired = np.zeros_like(achieved) if goal is None else np.array(goal, np.float64)
        subgoal = achieved if self._subgoal_at is None else flat[self._subgoal_at]
        if self.adds_goal:
            flat = np.concatenate([flat, achieved])
        return View(flat, achieved, subgoal.copy(), desired)

    def _of_size(self, part: str, values: Any, size: int) -> np.ndarray:
        """Values of an observation as [size].

        Raises:
          EnvFailed: there are more or fewer.
        """
        flat = np.array(values, np.float64).ravel()
        if len(flat) != size:
            raise EnvFailed(
                _OTHER_SIZE.format(word=self.word, part=part, found=len(flat), declared=size)
            )
        return flat

    def learn_what_is_there(self, views: Sequence[View]) -> None:
        """Finds out from views whether the observation contains the achieved goal."""
        observations = np.stack([view.observation for view in views])  # [K, D]
        achieved = np.stack([view.achieved_goal for view in views])  # [K, G]
        same = observations[:, :, None] == achieved[:, None, :]
        self.adds_goal = not same.all(axis=0).any(axis=0).all()

    def names(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names for the numbers of the goal space and the subgoal space."""
        goals = (
            tuple(f"goal[{i}]" for i in range(int(np.prod(self.goal_shape))))
            if self._goal_at is None
            else tuple(f"obs[{i}]" for i in self._goal_at)
        )
        at = self._subgoal_at
        return goals, goals if at is None else tuple(f"obs[{i}]" for i in at)


class EnvCopy:
    """A copy of the environment. Its episodes depend on their seeds only."""

    def __init__(self, env: gymnasium.Env, reader: Reader, seeds_global: bool):
        self.env, self._reader, self._seeds_global = env, reader, seeds_global
        self.owner: object = None  # whose episode it plays
        self._random: Any = None  # states of the global generators, as the episode left them
        self._space = making.check_actions(reader.word, env.action_space)
        self.goal: np.ndarray | None = None
        self._seen: Any = None  # the latest observation, as the environment gave it
        self._warned = 0  # warnings of MuJoCo at the start of the episode

    def reset(self, seed: int, options: Mapping[str, Any] | None, goal: np.ndarray | None) -> View:
        """The start of an episode.

        Raises:
          EnvFailed: the environment raised something.
        """
        self.goal = goal
        given = {} if options is None else {"options": dict(options)}
        with making.global_random(None) if self._seeds_global else contextlib.nullcontext():
            if self._seeds_global:
                np.random.seed(seed)
                random.seed(seed)
            self._seen, _ = self._asked("reset", seed=seed, **given)
            self._random = making.random_states() if self._seeds_global else None
        self._warned = self._warnings()
        return self._reader.view(self._seen, goal)

    def move_goal(self, goal: np.ndarray) -> View:
        """The view with another end goal [G], which the episode goes on with.

        Raises:
          ValueError: the environment does not say where it keeps its goal.
        """
        if self.goal is not None:  # it has none of its own
            self.goal = goal
            return self._reader.view(self._seen, goal)
        world: Any = self.env.unwrapped
        own = getattr(world, "goal", None)
        if not isinstance(own, np.ndarray) or own.shape != goal.shape:
            raise ValueError(_FIXED_GOAL.format(word=self._reader.word))
        world.goal = goal.astype(own.dtype)
        self._seen = {**self._seen, "desired_goal": world.goal.copy()}
        return self._reader.view(self._seen, None)

    @property
    def simulation(self) -> tuple[mujoco.MjModel, mujoco.MjData] | None:
        """MuJoCo's model and state of the environment; None where it is simulated otherwise."""
        world = self.env.unwrapped
        model, data = getattr(world, "model", None), getattr(world, "data", None)
        if isinstance(model, mujoco.MjModel) and isinstance(data, mujoco.MjData):
            return model, data
        return None

    def broke_down(self) -> bool:
        """Whether MuJoCo found the state of this episode broken, and began anew by itself."""
        return self._warnings() > self._warned

    def _warnings(self) -> int:
        simulation = self.simulation
        if simulation is None:
            return 0
        counts = simulation[1].warning.number
        return sum(int(counts[kind]) for kind in _BROKEN)

    def step(self, action: np.ndarray) -> tuple[View, bool, bool, Mapping[str, Any]]:
        """The view after an action [A], whether the environment terminated or truncated, info.

        Raises:
          EnvFailed: as `reset`.
        """
        own = action.astype(self._space.dtype).reshape(self._space.shape)
        with making.global_random(self._random) if self._seeds_global else contextlib.nullcontext():
            self._seen, _, terminated, truncated, info = self._asked("step", own)
            if self._seeds_global:
                self._random = making.random_states()
        return self._reader.view(self._seen, self.goal), bool(terminated), bool(truncated), info

    def _asked(self, method: str, *args: Any, **given: Any) -> tuple:
        """What the environment's reset or step returns."""
        wanted = _TUPLES[method]
        try:
            returned = getattr(self.env, method)(*args, **given)
            if not isinstance(returned, tuple) or len(returned) != len(wanted):
                count = f"{len(returned)} things" if isinstance(returned, tuple) else "no tuple"
                raise TypeError(_RETURNED.format(given=count, wanted=", ".join(wanted)))
        except Exception as error:  # another's code can raise anything
            reason = one_line(error)
            options = f"options={given['options']}" if given.get("options") else ""
            what = f"{method}({options}){making.place(error)}"
            raise EnvFailed(
                _FAILED.format(word=self._reader.word, what=what, error=reason)
            ) from error
        return returned


class Pool:
    """Copies of one environment, made when first needed.

    Training and its tests take turns, so they play in the same copies: making one takes time and
    memory.

    Attributes:
      reader: what the environment's observations mean.
      notes: what a person should know of how it is handled.
    """

    def __init__(self, word: str, make: Callable[[], gymnasium.Env], options: Options):
        """Makes a first copy, and looks at it.

        Raises:
          ValueError: HAC cannot train on it; one line says why.
        """
        self.word, self._make, self.options = word, making.CompiledOnce(make), options
        first = self._make()
        self.actions = making.check_actions(word, first.action_space)
        self.reader = Reader(word, first, options)
        self.notes = self.reader.notes
        self._seeds_global = False
        # How many copies each adapter plays in.
        self._users: weakref.WeakKeyDictionary[object, int] = weakref.WeakKeyDictionary()
        self._copies = [EnvCopy(first, self.reader, False)]
        self._check_seeds()
        self._check_independence()
        self.reader.learn_what_is_there(list(self._probe(self._copies[0])))

    @property
    def env(self) -> gymnasium.Env:
        """The first copy, for what does not change between episodes."""
        return self._copies[0].env

    @property
    def copy_bytes(self) -> int:
        """What MuJoCo's model and data of a copy take; 0 where it is simulated otherwise."""
        simulation = self._copies[0].simulation
        return 0 if simulation is None else sum(part.nbuffer for part in simulation)

    def copies(self, count: int, user: object = None) -> list[EnvCopy]:
        """The first `count` copies; they stay open until the `user` closes them."""
        if user is not None:
            self._users[user] = count
        while len(self._copies) < count:
            self._copies.append(EnvCopy(self._make(), self.reader, self._seeds_global))
        return self._copies[:count]

    def close(self, user: object) -> None:
        """Closes the copies that nobody but the user plays in, but for the first."""
        self._users.pop(user, None)
        while len(self._copies) > max([1, *self._users.values()]):
            self._copies.pop().env.close()

    def _check_seeds(self) -> None:
        """Plays one seed three times, the third time in a copy of its own."""
        with making.global_random(None):
            before = making.random_states()
            different = self._differ()
            others = making.same_states(before, making.random_states())
        if different and others:  # something else than the global generators
            raise ValueError(_UNDETERMINED.format(word=self.word, what=different))
        if different:
            self._seeds_global = True
            self._copies = [EnvCopy(own.env, self.reader, True) for own in self._copies]
            if self._differ():
                raise ValueError(_UNDETERMINED.format(word=self.word, what=different))
            self.notes.append(GLOBAL_RANDOM)

    def _differ(self) -> str:
        """What differs between episodes of one seed, if anything does."""
        copy, other = self.copies(2)
        first, again, elsewhere = (list(self._probe(own)) for own in (copy, copy, other))
        for step, views in enumerate(zip(first, again, elsewhere, strict=True)):
            if not (_equal(views[0], views[1]) and _equal(views[0], views[2])):
                return "what follows from actions" if step else "the start and goal"
        return ""

    def _check_independence(self) -> None:
        """Plays an episode alone, and once more with another copy's steps between its own."""
        copy, other = self.copies(2)
        alone = list(self._probe(copy))
        both = zip(self._probe(copy), self._probe(other, _PROBE_SEED + 1), strict=True)
        if not all(map(_equal, alone, (view for view, _ in both))):
            raise ValueError(_SHARED.format(word=self.word))

    def _probe(self, copy: EnvCopy, seed: int = _PROBE_SEED) -> Iterator[View]:
        """The start of an episode, step by step; after its end, its last view."""
        rng = np.random.default_rng(_PROBE_SEED)
        low, high = self.actions.low.ravel(), self.actions.high.ravel()
        view, over = copy.reset(seed, self.options.train, None), False
        yield view
        for _ in range(_PROBE_STEPS):
            action = rng.uniform(low, high)
            if not over:
                view, terminated, truncated, _ = copy.step(action)
                over = terminated or truncated
            yield view


def _equal(view: View, other: View) -> bool:
    return all(np.array_equal(*parts, equal_nan=True) for parts in zip(view, other, strict=True))
