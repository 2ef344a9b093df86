"""Third-party environments: copies of a Gymnasium environment as the engine's VectorEnv."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium
import mujoco
import numpy as np

from tasks import vector
from tasks.errors import one_line
from tasks.worlds import estimates, fitted, judging, making
from tasks.worlds.copies import EnvCopy, Options, Pool, View, finite

_NO_LIMIT = "{word}: it has no time limit: give the steps of an episode, as in --max_steps=200"
_NO_COUNT = "{word}: max_steps is {value}; it takes a count"
_NOT_NEAR = "{word}: --goal_threshold={given}: give numbers above 0"
_NOT_MAKER = (
    "{word}: this is one environment, but several are needed: give a function that makes them, or "
    "an id"
)
_ARGS = "{word}: args={args} are only for an id; bind them to the function with functools.partial"
_TAKEN = (
    "{word}: another VectorEnv of this task has begun episodes in the same copies, which "
    "tasks.find(...) shares; call tasks.from_gymnasium to get separate ones"
)
_FRAMES = 30  # a second of video, where the environment does not say
_THRESHOLDS = "{word}: --goal_threshold has {given} numbers; give one, or {count}"
_GOALS = 1  # marks the random stream of end goals, apart from the environment's own
_PAIRS = 64  # episodes whose goals are looked at to learn what compute_reward means


class Step(NamedTuple):
    """What N environments show after a reset or a step, in natural units; fresh arrays.

    Attributes:
      observation: [N, D]; flat, and with the achieved goal where it did not contain that.
      achieved_goal: [N, G].
      achieved_subgoal: [N, H].
      desired_goal: [N, G]; where it moves, the one that the step was judged by.
      diverged: [N] bool; numbers were no longer finite, or the environment cut the episode short.
      failed: [N] bool; the environment terminated, and not at the goal.
    """

    observation: np.ndarray
    achieved_goal: np.ndarray
    achieved_subgoal: np.ndarray
    desired_goal: np.ndarray
    diverged: np.ndarray
    failed: np.ndarray


class World:
    """A Gymnasium environment before its spaces are known: copies, a judge and a step limit.

        world = World("gym:PointMaze_UMaze-v3", make, Options(), max_steps=None)
        env = fitted.of_world(world).load_vector(64)

    Attributes:
      word: what messages call it.
      pool: its copies.
      max_steps: control steps after which an episode is cut off.
      judge: which achieved goals [..., G] achieve which goals [..., G]: bool [...].
      threshold: [G] the distance by which it judges; None: the environment's own judgement.
      goal_points: [K, G] what end goals are drawn from, where the environment has none of its own.
    """

    def __init__(
        self,
        word: str,
        make: Callable[[], gymnasium.Env],
        options: Options,
        *,
        max_steps: int | None = None,
        title: str = "",
    ):
        """Makes a first copy and plays a few episodes in it.

        Raises:
          ValueError: HAC cannot train on it, or needs to be told more; one line says what.
        """
        self.word = word
        if max_steps is not None and (not isinstance(max_steps, int | np.integer) or max_steps < 1):
            raise ValueError(_NO_COUNT.format(word=word, value=max_steps))
        self.pool = Pool(word, make, options)
        self.title = title or word
        limit = max_steps or _time_limit(self.pool.env)
        if not limit:
            raise ValueError(_NO_LIMIT.format(word=word))
        self.max_steps: int = limit
        self.goal_points: np.ndarray | None = None
        self.threshold = self._given_threshold() if options.threshold else None
        self.judge = self._own_judge() if self.threshold is None else judging.by_box(self.threshold)

    def _own_judge(self) -> judging.Judge:
        reader, copy = self.pool.reader, self.pool.copies(1)[0]
        low, high = self.pool.actions.low.ravel(), self.pool.actions.high.ravel()
        pairs, rng = [], np.random.default_rng(0)
        for seed in range(_PAIRS):
            views = [copy.reset(seed, self.pool.options.train, None)]
            views.append(copy.step(rng.uniform(low, high))[0])
            pairs += [(view.achieved_goal, view.desired_goal) for view in views if finite(view)]
        achieved, goals = (np.stack(part) for part in zip(*pairs, strict=True))
        return judging.by_reward(
            self.word,
            self.pool.env.get_wrapper_attr("compute_reward"),
            reader.goal_shape,
            reader.goal_dtype,
            achieved,
            goals,
        )

    def _given_threshold(self) -> np.ndarray:
        count, given = int(np.prod(self.pool.reader.goal_shape)), self.pool.options.threshold
        if len(given) not in (1, count):
            raise ValueError(_THRESHOLDS.format(word=self.word, given=len(given), count=count))
        if min(given) <= 0:
            raise ValueError(_NOT_NEAR.format(word=self.word, given=given))
        return np.broadcast_to(np.asarray(given, np.float64), count)

    @property
    def control_timestep(self) -> float:
        """Seconds between actions, as far as the environment says; videos play at this rate."""
        fps = self.pool.env.metadata.get("render_fps") or _FRAMES
        seconds = getattr(self.pool.env.unwrapped, "dt", None)
        return float(seconds) if isinstance(seconds, float) and seconds > 0 else 1.0 / float(fps)

    def adapter(self, num_envs: int, seed: int = 0) -> "Adapter":
        """`num_envs` copies in lock step, without scales and bounds."""
        return Adapter(self, num_envs, seed)

    def about(self) -> estimates.About:
        """What `estimates` needs to know."""
        low, high = self.pool.actions.low, self.pool.actions.high
        names = self.pool.reader.names()
        return estimates.About(
            title=self.title,
            max_steps=self.max_steps,
            control_timestep=self.control_timestep,
            action_low=low.ravel().astype(np.float64),
            action_high=high.ravel().astype(np.float64),
            goal_names=names[0],
            subgoal_names=names[1],
            judge=self.judge,
            fixed_goal=self.pool.reader.fixed_goal,
            draws_goals=self.pool.reader.goals or self.pool.reader.fixed_goal is not None,
            threshold=self.threshold,
        )


class Adapter:
    """N copies of a world in lock step: the engine's VectorEnv but for its spaces."""

    def __init__(self, world: World, num_envs: int, seed: int = 0):
        vector.check_number(num_envs)
        self.num_envs, self.max_steps = num_envs, world.max_steps
        self._world, self._pool = world, world.pool
        self._copies: list[EnvCopy] = self._pool.copies(num_envs, self)
        self.action_low = self._pool.actions.low.ravel().astype(np.float64)
        self.action_high = self._pool.actions.high.ravel().astype(np.float64)
        self.control_timestep = world.control_timestep
        self._seeds = np.random.RandomState(seed)
        self._steps = np.zeros(num_envs, np.int64)
        self._over = np.zeros(num_envs, bool)  # the environment ended the episode
        self._goes_on = np.zeros(num_envs, bool)  # past its limit, to a goal that was moved
        self._shown: Step | None = None

    def reset(
        self, seeds: np.ndarray | None = None, *, mask: np.ndarray | None = None, test: bool = False
    ) -> Step:
        """Starts new episodes; see `hac_suite.VectorEnv`.

        Raises:
          ValueError: seeds that are not N integers in [0, 2**32).
          EnvFailed: an environment raised something.
        """
        seeds = vector.episode_seeds(seeds, self.num_envs, self._seeds)
        options = self._pool.options.test if test else self._pool.options.train
        self._copies = self._pool.copies(self.num_envs, self)  # others, after `close`
        for i in vector.masked(mask, self.num_envs).tolist():
            copy, seed = self._copies[i], int(seeds[i])
            copy.owner = self
            view = copy.reset(seed, options, self._draw_goal(seed))
            self._steps[i], self._over[i], self._goes_on[i] = 0, False, False
            broken = not finite(view)
            self._show(i, _finite_part(view) if broken else view, diverged=broken, failed=False)
        return self._fresh()

    def _draw_goal(self, seed: int) -> np.ndarray | None:
        """The end goal of an episode, where the environment has none of its own."""
        reader, points = self._pool.reader, self._world.goal_points
        if reader.goals:
            return None
        if reader.fixed_goal is not None:
            return reader.fixed_goal
        # The environment draws its start from the seed itself: goals need a stream of their own.
        return None if points is None else np.random.default_rng((seed, _GOALS)).choice(points)

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> Step:
        """One control step in each masked environment; see `hac_suite.VectorEnv`.

        Those that diverged, or that ended their episode, stay as they are.

        Raises:
          ValueError: an action is not finite, an argument has the wrong shape, or no episode has
            begun.
          EnvFailed: an environment raised something.
          RuntimeError: its copy plays for somebody else now.
        """
        actions = np.asarray(actions, np.float64)
        if actions.shape != (self.num_envs, len(self.action_low)):
            wanted = (self.num_envs, len(self.action_low))
            raise ValueError(f"actions must have shape {wanted}, got {actions.shape}")
        if self._shown is None:
            raise ValueError("no episode has begun: call reset before step")
        chosen = vector.masked(mask, self.num_envs).tolist()
        finite_actions = np.isfinite(actions).all(axis=1)
        for i in chosen:
            if not finite_actions[i]:
                raise ValueError(f"environment {i}: actions must be finite, got {actions[i]}")
        actions = np.clip(actions, self.action_low, self.action_high)
        for i in chosen:
            if not (self._shown.diverged[i] or self._over[i]):
                self._step_one(i, actions[i])
        return self._fresh()

    def _step_one(self, i: int, action: np.ndarray) -> None:
        copy = self._copies[i]
        if copy.owner is not self:
            raise RuntimeError(_TAKEN.format(word=self._world.word))
        view, terminated, truncated, _ = copy.step(action)
        self._steps[i] += 1
        self._over[i] = terminated or (truncated and not self._goes_on[i])
        ended = self._over[i] and self._steps[i] < self.max_steps
        if not finite(view) or copy.broke_down():
            self._show(i, None, diverged=True, failed=False)
            return
        if ended:
            ended = not bool(
                self._world.judge(view.achieved_goal[None], view.desired_goal[None])[0]
            )
        self._show(i, view, diverged=ended and not terminated, failed=ended and terminated)

    def _show(self, i: int, view: View | None, *, diverged: bool, failed: bool) -> None:
        """Keeps what environment i shows now; None: it stays as it was."""
        if self._shown is None:
            assert view is not None  # a reset comes first
            rows = {n: np.zeros((self.num_envs, len(v))) for n, v in view._asdict().items()}
            flags = {n: np.zeros(self.num_envs, bool) for n in ("diverged", "failed")}
            self._shown = Step(**rows, **flags)
        for shown, part in zip(self._shown, view or (), strict=False):
            shown[i] = part
        self._shown.diverged[i] = diverged
        self._shown.failed[i] = failed

    def _fresh(self) -> Step:
        assert self._shown is not None
        return Step(*(part.copy() for part in self._shown))

    def show_subgoals(self, i: int, subgoals: Sequence[np.ndarray | None]) -> None:
        """Nothing: there are no markers in others' scenes."""

    def simulation(self, i: int) -> tuple[mujoco.MjModel, mujoco.MjData] | None:
        """MuJoCo's model and state of environment i, to be read only; None: it is not MuJoCo's."""
        return self._copies[i].simulation

    def move_goal(self, i: int, goal: np.ndarray) -> Step:
        """Gives environment i's episode another end goal [G], to which it goes on.

        Raises:
          ValueError: its goal cannot be moved.
        """
        view = self._copies[i].move_goal(np.asarray(goal, np.float64))
        self._over[i], self._goes_on[i] = False, True
        self._show(i, _finite_part(view), diverged=False, failed=False)
        return self._fresh()

    def render(
        self, i: int, *, camera: int | str = 0, height: int = 480, width: int = 640
    ) -> np.ndarray:
        """A picture of environment i, uint8 [height, width, 3], by its own `render`.

        Raises:
          NoFrames: it gives none.
        """
        del camera  # it has one of its own
        try:
            picture: Any = self._copies[i].env.render()
        except NotImplementedError:
            picture = None
        except Exception as error:  # another's code can raise anything
            reason = one_line(error)
            raise making.NoFrames(f"{self._world.word}: its render() failed: {reason}") from error
        if not isinstance(picture, np.ndarray) or picture.ndim != 3:
            raise making.NoFrames(f"{self._world.word}: it renders no frames ('rgb_array')")
        return making.fitted_into(picture[..., :3].astype(np.uint8), height, width)

    def close(self) -> None:
        """Frees the copies that no other adapter plays in; the next reset makes them again."""
        self._pool.close(self)


def _finite_part(view: View) -> View:
    """The view with 0 in place of numbers that are not finite."""
    return View(*(np.nan_to_num(part, posinf=0.0, neginf=0.0) for part in view))


def _time_limit(env: gymnasium.Env) -> int | None:
    """The steps of an episode, as the environment's id is registered, or its TimeLimit says."""
    wrapped: Any = env
    while isinstance(wrapped, gymnasium.Wrapper):
        limit = getattr(wrapped, "_max_episode_steps", None)
        if isinstance(limit, int):
            return limit
        wrapped = wrapped.env
    id = env.spec.id if env.spec else None
    return gymnasium.registry[id].max_episode_steps if id in gymnasium.registry else None


def from_gymnasium(
    make_or_id: Callable[[], gymnasium.Env] | str,
    num_envs: int = 1,
    *,
    seed: int = 0,
    args: Mapping[str, Any] | None = None,
    max_steps: int | None = None,
    goal: str = "",
    subgoal: str = "",
    goal_threshold: float | Sequence[float] = (),
    train_options: Mapping[str, Any] | None = None,
    test_options: Mapping[str, Any] | None = None,
    settings: "fitted.Settings | None" = None,
) -> "fitted.FittedEnv":
    """Copies of a Gymnasium goal environment, as `hac_suite.train` takes them.

        env = tasks.from_gymnasium("gymnasium_robotics:PointMaze_UMaze-v3", 64)

    The environment's own `compute_reward` says what achieves an end goal. Scales, bounds and
    thresholds are estimated from a few random episodes unless `settings` gives them.

    Args:
      make_or_id: a function without arguments that makes the environment, or what
        `gymnasium.make` takes: `ID` or `module:ID`.
      num_envs: how many; `env.copies(n)` makes more that share what is known of it.
      seed: decides the episodes of resets that are given no seeds.
      args: keywords of `gymnasium.make`.
      max_steps: steps of an episode; None takes the environment's time limit.
      goal: for an environment that is not goal-conditioned, which numbers of its observation are
        the goal, `obs[0:2]`; goals are points that random episodes reach, or are always the same:
        `obs[0:2]=1,0`.
      subgoal: which numbers of the observation are the subgoal space; the goal's own if not given.
      goal_threshold: how near counts as achieved in each dimension, in place of `compute_reward`.
      train_options, test_options: `options` of the environment's resets, in training and in tests.

    Raises:
      ValueError: HAC cannot train on the environment, or needs to be told more.
    """
    options = Options(
        goal, subgoal, tuple(np.ravel(goal_threshold).tolist()), train_options, test_options
    )
    word, make = _maker(make_or_id, args or {})
    world = World(word, make, options, max_steps=max_steps)
    return fitted.of_world(world, settings).load_vector(num_envs, seed)


def _maker(
    make_or_id: Callable[[], gymnasium.Env] | str, args: Mapping[str, Any]
) -> tuple[str, Callable[[], gymnasium.Env]]:
    """What messages call the environment, and what makes it."""
    if isinstance(make_or_id, str):
        id = make_or_id.removeprefix("gym:")
        return f"gym:{id}", making.maker(f"gym:{id}", id, args)
    word = getattr(make_or_id, "__name__", type(make_or_id).__name__)
    if not callable(make_or_id):
        raise ValueError(_NOT_MAKER.format(word=word))
    if args:
        raise ValueError(_ARGS.format(word=word, args=dict(args)))
    return word, make_or_id
