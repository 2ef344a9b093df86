"""Checks a user's task, and says how to fix it."""

import ast
import inspect
import textwrap
import types
from collections.abc import Callable, Iterator
from typing import Any, Literal, NamedTuple

import mujoco
import numpy as np

from tasks import base, finding, registry
from tasks.errors import one_line
from tasks.worlds import cautions, estimates, fitted

Verdict = Literal["good", "doubtful", "wrong"]

_RESERVED = ("_arena", "_goal", "_step_count", "_task_observables", "_test")
_UNCALLED = ("get_reward", "get_discount", "should_terminate_episode", "before_step", "after_step",
             "initialize_episode", "initialize_episode_mjcf", "before_substep",
             "after_substep")  # fmt: skip
_WHOLE_TURN = 2 * np.pi
_ENVS, _STEPS = 8, 40  # of the episodes that are compared


class Finding(NamedTuple):
    """What one check found.

    Attributes:
      verdict: "doubtful" may be intended, but usually is not.
      text: what was found.
      remedy: what to do about it, if the verdict is not good.
    """

    verdict: Verdict
    text: str
    remedy: str = ""


def findings(entry: registry.Entry) -> Iterator[Finding]:
    """Checks a dm_control task, one thing after the other; ends at what keeps it from loading."""
    try:
        task = entry.factory()
    except Exception as error:
        yield _broken(entry, "the factory does not make the task", error)
        return
    if not hasattr(task, "_arena"):
        kind = type(task).__name__
        yield Finding(
            "wrong",
            f"{kind}.__init__ does not call that of tasks.base.GoalTask",
            "call super().__init__(arena, spec, markers=[...], test=test) in it",
        )
        return
    yield from _names(type(task))
    yield from _model(task)
    try:
        environment = entry.load(seed=0)
        environment.reset()
    except Exception as error:
        yield _broken(entry, "the task does not load", error)
        return
    yield Finding("good", "it compiles and matches its spec")
    for what, check in _CHECKS.items():
        try:
            yield from check(entry)
        except Exception as error:
            yield _broken(entry, f"{what}: it failed", error)
    environment.close()


def fault(entry: registry.Entry) -> Finding | None:
    """What keeps a task from being trained on at all: it does not load, or seeds decide nothing.

    These are the quick ones of the checks.
    """
    try:
        found = list(_deterministic(entry))
    except Exception as error:
        return _broken(entry, "the task does not load", error)
    return next((own for own in found if own.verdict == "wrong"), None)


def _broken(entry: registry.Entry, what: str, error: Exception) -> Finding:
    """An exception, with the last line of the task's file that it came through."""
    reason = one_line(error)
    file = entry.word.rpartition(":")[0]
    line = finding.line_in(file, error)
    if line is None:
        return Finding("wrong", f"{what}: {reason}", "mend what it names, then check again")
    text = f"{what}: {reason} ({file}, line {line})"
    return Finding("wrong", text, "mend that line, then check again")


# -- The class


def _names(kind: type) -> Iterator[Finding]:
    """Names of the base class that the task's classes take for something else."""
    own = kind.__mro__[: kind.__mro__.index(base.GoalTask)]
    taken = sorted({name for each in own for name in _assigned(each) if name in _RESERVED})
    for name in taken:
        yield Finding(
            "wrong",
            f"{kind.__name__} assigns self.{name}, which tasks.base.GoalTask uses itself",
            f"choose another name, such as self.{name}_marker",
        )
    ignored = [name for name in _UNCALLED if any(name in vars(each) for each in own)]
    for name in ignored:
        yield Finding(
            "doubtful",
            f"{kind.__name__} defines {name}, which training never calls",
            "define when a goal is achieved in achieved_goal, and events in event_mask and "
            "apply_event: training steps MuJoCo without Composer's hooks",
        )
    if not taken:
        yield Finding("good", "it overwrites no name of the base class")


def _assigned(kind: type) -> set[str]:
    """Attributes that a class's methods assign on self; and those of the class itself."""
    found = set(vars(kind))
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(kind)))
    except (OSError, TypeError, SyntaxError):  # a class without a file
        return found
    for node in ast.walk(tree):
        if not isinstance(node, ast.Attribute) or not isinstance(node.ctx, ast.Store):
            continue
        if isinstance(node.value, ast.Name) and node.value.id == "self":
            found.add(node.attr)
    return found


# -- The model


def _model(task: base.GoalTask) -> Iterator[Finding]:
    model = task.root_entity.mjcf_model
    sensors = model.find_all("sensor")
    if not sensors:
        yield Finding(
            "wrong",
            "the model has no sensors, so nothing can be observed",
            "add a <sensor> for all that the agent observes or that decides a goal: "
            '<jointpos joint="..."/>, <jointvel joint="..."/>, '
            '<framepos objtype="site" objname="..."/>',
        )
    else:
        yield Finding("good", f"the model has {len(sensors)} sensors")
    if model.option.integrator == "RK4":
        yield Finding(
            "wrong",
            "the model's integrator is RK4, which training steps differently than Composer",
            'use <option integrator="implicitfast"/>, or leave it out',
        )
    if not model.find_all("actuator"):
        yield Finding(
            "wrong",
            "the model has no actuators, so the agent cannot act",
            "add <motor joint=... ctrlrange=.../> for each driven joint",
        )


def _cameras(entry: registry.Entry) -> Iterator[Finding]:
    environment = entry.load(seed=0)  # kept: its model lives as long as it does
    model = environment.physics.model
    if not model.ncam:
        yield Finding(
            "wrong",
            "the model has no camera, so videos would be black",
            "add a <camera>, or build the arena with tasks.scenes.build(..., cameras={...})",
        )
    if not model.nlight:
        yield Finding(
            "doubtful",
            "the model has no light: videos are dark",
            "add a <light>, or build the arena with tasks.scenes.build, which has two",
        )
    if model.ncam:
        yield from _near_plane(environment)
    hinges = (model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE)) & (model.jnt_limited == 1)
    if (np.abs(model.jnt_range[hinges]) > 2 * _WHOLE_TURN).any():
        yield Finding(
            "doubtful",
            "hinges have ranges of several turns: they look like degrees, but are read as radians",
            'write angles in radians, and set <compiler angle="radian"/>',
        )
    if model.ncam and model.nlight:
        yield Finding("good", f"{model.ncam} camera(s) and {model.nlight} light(s)")


def _near_plane(environment: Any) -> Iterator[Finding]:
    """What is nearer to a camera than the near plane is not drawn."""
    environment.reset()
    model, data = environment.physics.model.ptr, environment.physics.data.ptr
    mujoco.mj_forward(model, data)
    bodies = model.geom_bodyid
    robot = (model.body_weldid[bodies] > 0) & (model.body_mocapid[bodies] < 0)
    ahead = -data.cam_xmat[0].reshape(3, 3)[:, 2]
    away = (data.geom_xpos[robot] - data.cam_xpos[0]) @ ahead
    near = model.vis.map.znear * model.stat.extent
    if ((away > 0) & (away < near)).any():
        yield Finding(
            "doubtful",
            f"the near plane is {near:.2g} m from the camera, and the robot nearer: pictures do "
            "not show it",
            'write <statistic extent="1" center="0 0 0.5"/> into the model, with the size and the '
            "middle of your scene in metres: MuJoCo measures hidden markers too, and the near "
            "plane's distance is a part of that",
        )


# -- What it does


def _shapes(entry: registry.Entry) -> Iterator[Finding]:
    """Functions of readings must work on arrays [..., R] and give what they give row by row."""
    environment = entry.load(seed=0)
    environment.reset()
    task = environment.task
    rows = np.stack([task.readings(environment.physics) + 0.01 * i for i in range(6)])
    good = True
    for name in ("observation", "achieved_goal", "achieved_subgoal", "event_mask"):
        function: Callable[[np.ndarray], Any] = getattr(task, name)
        alone = np.stack([function(row) for row in rows])
        try:
            together = np.asarray(function(rows.reshape(3, 2, -1)))
        except (ValueError, IndexError, TypeError):  # it was written for one row
            together = np.zeros(0)
        if together.shape != (3, 2, *alone.shape[1:]) or not np.array_equal(
            together.reshape(alone.shape), alone
        ):
            good = False
            yield Finding(
                "wrong",
                f"{name} gives different values for readings [3, 2, R] than for each of them alone",
                "index the last axis, as in readings[..., 0], and join with axis=-1",
            )
    if good:
        yield Finding("good", "functions of readings work on arrays")


def _hooks(entry: registry.Entry) -> Iterator[Finding]:
    """Markers, events and readings must do with MuJoCo's structures, which is what they get."""
    environment = entry.load(seed=0)
    environment.reset()
    task, spec = environment.task, entry.spec
    model, data = environment.physics.model.ptr, environment.physics.data.ptr
    bare = types.SimpleNamespace(model=model, data=data)
    inside = (spec.subgoal_space.low + spec.subgoal_space.high) / 2
    task.readings(bare)
    task.place_goal_marker(bare, task.goal)
    task.place_subgoal_markers(bare, [inside])
    task.place_subgoal_markers(bare, [])
    if task.has_event:
        task.apply_event(bare)
    yield Finding("good", "readings, markers and events do with MuJoCo's model and data")


def _actions(entry: registry.Entry, envs: int) -> np.ndarray:
    spec = entry.spec
    return np.random.RandomState(0).uniform(
        spec.action_low, spec.action_high, (_STEPS, envs, len(spec.action_low))
    )


def _same_as_composer(entry: registry.Entry) -> Iterator[Finding]:
    """The fast path and Composer must play the same episode, with rewards -1 and 0."""
    actions, space = _actions(entry, 1), entry.spec.goal_space
    env, environment = entry.load_vector(1), entry.load(seed=7)
    state, timestep = env.reset(np.array([7])), environment.reset()
    for action in actions:
        state, timestep = env.step(action), environment.step(action[0])
        if not np.array_equal(state.observation[0], entry.spec.flat(timestep.observation)):
            yield Finding(
                "wrong",
                "training and Composer play different episodes",
                "do not use Composer's hooks, and keep no state in the task object: all state "
                "must be in physics.data, and only readings of it are seen",
            )
            return
        held = bool(space.achieved(state.achieved_goal, state.desired_goal)[0])
        if timestep.reward != held - 1.0:
            yield Finding(
                "wrong",
                f"its reward was {timestep.reward}, but must be {held - 1.0}: 0 at the goal, and "
                "-1 elsewhere",
                "do not override get_reward of tasks.base.GoalTask",
            )
            return
        if timestep.last():
            break
    yield Finding("good", "training and Composer play the same episode, with rewards of -1 and 0")


def _deterministic(entry: registry.Entry) -> Iterator[Finding]:
    """A seed determines an episode, whatever was played before."""
    actions, seeds = _actions(entry, _ENVS), np.arange(_ENVS)
    first, second = entry.load_vector(_ENVS), entry.load_vector(_ENVS)
    second.reset(seeds + 100)
    runs = []
    for env in (first, second):
        states = [env.reset(seeds), *(env.step(action) for action in actions)]
        runs.append(states)
    for one, other in zip(*runs, strict=True):
        if not all(np.array_equal(a, b) for a, b in zip(one, other, strict=True)):
            yield Finding(
                "wrong",
                "two episodes of one seed differ",
                "use the random_state that sample_episode receives, not numpy's global generator, "
                "and reset in sample_episode everything that the last episode may have changed",
            )
            return
    if any(states[-1].diverged.any() for states in runs):
        yield Finding(
            "doubtful",
            "random actions make the simulation unstable",
            "use a smaller timestep or weaker motors, or add damping",
        )
    yield Finding("good", "a seed determines an episode")


def _starts(entry: registry.Entry) -> Iterator[Finding]:
    """Starts and goals lie in their spaces; tests do not begin at the goal."""
    env, spec = entry.load_vector(64), entry.spec
    good = True
    for test in (False, True):
        state = env.reset(np.arange(64), test=test)
        kind = "test" if test else "training"
        held = spec.goal_space.achieved(state.achieved_goal, state.desired_goal).mean()
        if held > 0.05:
            good = False
            yield Finding(
                "wrong" if test else "doubtful",
                f"{held:.0%} of {kind} episodes begin at their goal",
                "sample start and goal farther apart, or make the threshold smaller",
            )
        pairs = (
            ("goals", "goal", spec.goal_space, state.desired_goal, 1.0),
            ("starts", "goal", spec.goal_space, state.achieved_goal, 1.1),
            ("starts", "subgoal", spec.subgoal_space, state.achieved_subgoal, 1.1),
        )
        for what, which, space, points, most in pairs:
            outside = (np.abs(space.normalise(points)) > most).any(axis=0)
            for name in np.array(space.names)[outside]:
                good = False
                yield Finding(
                    "doubtful",
                    f"some {what} of {kind} episodes lie outside the {which} space in {name}",
                    "widen low and high of that dimension",
                )
    if good:
        yield Finding("good", "starts and goals are inside their spaces, and apart")


def _learnable(entry: registry.Entry) -> Iterator[Finding]:
    """Random episodes come to the goal now and then, and observations are about one."""
    about = fitted.about_task(entry)
    played = estimates.random_episodes(entry.load_vector, about)
    found = estimates.settings(about, played)
    said = list(cautions.warnings(about, played, played, found, entry.spec))
    for text in said:
        yield Finding("doubtful", text, "see docs/your_own_task.md and `python launch/fit.py`")
    share = cautions.shares(played).succeeded
    if not said:
        near = cautions.nearest(about, played, found)
        reach = (
            f"{share:.0%} of random episodes reach the goal"
            if share
            else f"no random episode reaches the goal, the nearest by {near:.1f} thresholds; can a "
            "robot get there?"
        )
        yield Finding("good", f"scales are right; {reach}")


_CHECKS: dict[str, Callable[[registry.Entry], Iterator[Finding]]] = {
    "cameras and lights": _cameras,
    "readings, markers and events in training": _hooks,
    "functions of readings": _shapes,
    "an episode as in training and in Composer": _same_as_composer,
    "the same episode twice": _deterministic,
    "starts and goals": _starts,
    "random episodes": _learnable,
}
