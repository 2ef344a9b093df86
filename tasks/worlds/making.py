"""Makes Gymnasium environments by id, fixed where needed, and checks what they are made of."""

import contextlib
import copy
import importlib
import importlib.util
import inspect
import io
import random
import re
import sys
import traceback
import types
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

import gymnasium
import mujoco
import numpy as np

from tasks.errors import one_line

_NO_MODULE = (
    "{word}: there is no module {module!r} to import, which should register {id!r}; name a file "
    "of your own without .py, and put its folder on PYTHONPATH"
)
_BROKEN_MODULE = "{word}: importing {module!r}, which should register {id!r}, failed: {error}"
_NOT_MADE = "{word}: gymnasium.make({id!r}{args}) failed: {error}"
_UNKNOWN_HINT = "; name the module that registers it, as in gym:gymnasium_robotics:{id}"
_DISCRETE = (
    "{word}: its actions are {space}; HAC's actions are numbers in a range (a Box): "
    "discrete actions are not supported"
)
_UNBOUNDED = "{word}: its actions have no bounds ({space}); wrap it in gymnasium's RescaleAction"
_ODD_GOALS = (
    "{word}: its {key} is {space}; goals must be arrays of numbers (a Box): wrap the environment "
    "so that it has one"
)
_UNLIKE_GOALS = (
    "{word}: its achieved_goal has the shape {achieved} and its desired_goal {desired}: they must "
    "be the same, because hindsight replaces one by the other"
)
GOAL_KEYS = ("observation", "achieved_goal", "desired_goal")
_PACKAGES = ("gymnasium_robotics",)  # asked where no module is named
_COMPILERS = ("from_xml_path", "from_xml_string")
_COMPARED = 2  # copies of the environment that compile, to see whether they get the same models

_BAD_INDEX = (
    "{what}={text}: give elements of the observation, as in obs[0:2] or obs[0,3]{more}; there are "
    "{size}"
)
_PICTURES = (
    "{word}: its observations have {count} numbers, as images do, but these networks suit a few "
    "hundred: choose what to observe, as with gymnasium's FilterObservation"
)
_MOST_NUMBERS, _MANY_NUMBERS = 5000, 500
_MANY = (
    "its observations have {count} numbers; the networks suit up to a few hundred, so choose what "
    "to observe, as with gymnasium's FilterObservation"
)
_OF_OTHERS = re.compile(
    re.escape(str(Path(__file__).parent)) + r"|.*[\\/](site-packages|python[\d.]+)[\\/]"
)

T = TypeVar("T")


class NoFrames(RuntimeError):
    """The environment cannot render frames."""


def maker(word: str, id: str, args: Mapping[str, Any]) -> Callable[[], gymnasium.Env]:
    """What makes copies of the environment of an id, `ID` or `module:ID`.

    They have no time limit, since the engine keeps it, and render frames if they can.

    Raises (when first called):
      ValueError: it cannot be made; one line says why.
    """

    def make() -> gymnasium.Env:
        _import(word, id)
        mend_gymnasium_robotics()
        frames = {"render_mode": "rgb_array"} if _renders(id) else {}
        try:
            return gymnasium.make(
                id, max_episode_steps=-1, disable_env_checker=True, **{**frames, **args}
            )
        except Exception as error:  # another's constructor can raise anything
            raise ValueError(_why(word, id, args, error)) from error

    return make


def _import(word: str, id: str) -> None:
    """Imports what registers the id: the module named, or packages that are known."""
    module, _, name = id.rpartition(":")
    if not module:
        modules = [] if id in gymnasium.registry else [p for p in _PACKAGES if _installed(p)]
    else:
        modules = [module]
    for each in modules:
        try:
            with _without_notices_of_others(id):
                importlib.import_module(each)
        except Exception as error:  # another's module can raise anything
            reason = one_line(error)
            missing = isinstance(error, ModuleNotFoundError) and error.name in _parents(each)
            why = _NO_MODULE if missing else _BROKEN_MODULE
            raise ValueError(why.format(word=word, module=each, id=name, error=reason)) from error


@contextlib.contextmanager
def _without_notices_of_others(id: str) -> Iterator[None]:
    """Drops what gymnasium-robotics 1.4 prints of Adroit's rewards whatever one imports it for."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            yield
    finally:
        for line in said.getvalue().splitlines(keepends=True):
            if "Adroit" in id or not line.startswith("Adroit"):
                sys.stderr.write(line)


def _parents(module: str) -> list[str]:
    """The module `a.b.c` and the packages that it is in: a, a.b."""
    parts = module.split(".")
    return [".".join(parts[: i + 1]) for i in range(len(parts))]


def _installed(package: str) -> bool:
    return importlib.util.find_spec(package) is not None


def _why(word: str, id: str, args: Mapping[str, Any], error: Exception) -> str:
    reason = one_line(error)
    if isinstance(error, gymnasium.error.UnregisteredEnv) and ":" not in id:
        reason += _UNKNOWN_HINT.format(id=id)
    given = "".join(f", {name}={value!r}" for name, value in args.items())
    return _NOT_MADE.format(word=word, id=id, args=given, error=reason)


def _renders(id: str) -> bool:
    """Whether the environment of a registered id can give frames, and be asked for them."""
    try:
        entry: Any = gymnasium.spec(id.rpartition(":")[2]).entry_point
        if isinstance(entry, str):
            entry = gymnasium.envs.registration.load_env_creator(entry)
    except Exception:  # `make` says what is wrong
        return False
    modes = (getattr(entry, "metadata", None) or {}).get("render_modes", ())
    return "rgb_array" in modes and _takes(entry, "render_mode")


def _takes(function: Callable, keyword: str) -> bool:
    parameters = inspect.signature(function).parameters.values()
    return any(own.name == keyword or own.kind is own.VAR_KEYWORD for own in parameters)


def mend_gymnasium_robotics() -> None:
    """Lets gymnasium-robotics 1.4, if it is imported, run with mujoco 3.17 and later.

    There MuJoCo's enumerations no longer equal numpy's integers: `mjtJoint.mjJNT_HINGE ==
    numpy.int32(3)` is False, and so is `numpy.int32(3) in (mjtJoint.mjJNT_HINGE,)`. The package's
    `mujoco_utils` compares them so: Fetch and HandReach fail an assertion when they are made, and
    welds to a mocap body would be passed over in silence. This module, in this process only, is
    given a `mujoco` whose enumerations are plain integers.
    """
    hinge = mujoco.mjtJoint.mjJNT_HINGE
    if "gymnasium_robotics" not in sys.modules or hinge == np.int32(int(hinge)):
        return
    utils = importlib.import_module("gymnasium_robotics.utils.mujoco_utils")
    if isinstance(getattr(utils, "mujoco", None), types.ModuleType):
        utils.mujoco = _PlainEnums()  # type: ignore[attr-defined]


class _PlainEnums:
    """The module `mujoco`, but for its enumerations: their members are integers."""

    def __getattr__(self, name: str) -> Any:
        value = getattr(mujoco, name)
        if name.startswith("mjt"):
            members = {key: int(own) for key, own in value.__members__.items()}
            value = types.SimpleNamespace(**members)
        setattr(self, name, value)  # every step asks for it some hundred times
        return value


def check_actions(word: str, space: gymnasium.Space) -> gymnasium.spaces.Box:
    """The space of actions, if it is one that HAC can act in.

    Raises:
      ValueError: it is discrete, or without bounds; one line says so.
    """
    if not isinstance(space, gymnasium.spaces.Box) or not np.issubdtype(space.dtype, np.floating):
        raise ValueError(_DISCRETE.format(word=word, space=space))
    if not (np.isfinite(space.low).all() and np.isfinite(space.high).all()):
        raise ValueError(_UNBOUNDED.format(word=word, space=space))
    return space


def check_goals(word: str, parts: Mapping[str, gymnasium.Space]) -> None:
    """Checks that goals are arrays of numbers, of one shape.

    Raises:
      ValueError: they are not; one line says so.
    """
    for key in GOAL_KEYS[1:]:
        if parts[key].shape is None:
            raise ValueError(_ODD_GOALS.format(word=word, key=key, space=kind(parts[key])))
    achieved, desired = (parts[key].shape for key in GOAL_KEYS[1:])
    if achieved != desired:
        raise ValueError(_UNLIKE_GOALS.format(word=word, achieved=achieved, desired=desired))


def has_goals(space: gymnasium.Space) -> bool:
    """Whether observations are dictionaries with goals."""
    return isinstance(space, gymnasium.spaces.Dict) and set(GOAL_KEYS) <= set(space.keys())


def indices(what: str, text: str, size: int, more: str = "") -> np.ndarray:
    """The numbers that `obs[0:2]` or `obs[0,3]` chooses of an observation of this size."""
    found: list[int] = []
    match = re.fullmatch(r"obs\[([\d:, ]*)\]", text.strip())
    for part in match[1].split(",") if match else []:
        span = re.fullmatch(r"\s*(\d+)(?:(:)(\d+))?\s*", part)
        if not span:
            found = []
            break
        first = int(span[1])
        found += range(first, int(span[3]) if span[2] else first + 1)
    if not found or max(found) >= size or len(set(found)) < len(found):
        raise ValueError(_BAD_INDEX.format(what=what, text=text, size=size, more=more))
    return np.array(found)


def check_size(word: str, size: int) -> list[str]:
    """Notes on observations of so many numbers.

    Raises:
      ValueError: there are as many as in images.
    """
    if size > _MOST_NUMBERS:
        raise ValueError(_PICTURES.format(word=word, count=size))
    return [_MANY.format(count=size)] if size > _MANY_NUMBERS else []


def place(error: Exception) -> str:
    """The last line of the environment's own code that an error came through, if it is known."""
    steps = traceback.extract_tb(error.__traceback__)
    own = [step for step in steps if not _OF_OTHERS.match(step.filename)]
    return f" ({own[-1].filename}, line {own[-1].lineno})" if own else ""


def kind(space: gymnasium.Space) -> str:
    """What a message calls a space."""
    if isinstance(space, gymnasium.spaces.Dict):
        return f"a dictionary of {', '.join(space.keys())}"
    return str(space)


def random_states() -> tuple:
    """The states of numpy's and Python's global random generators."""
    return np.random.get_state(), random.getstate()


def same_states(one: tuple, other: tuple) -> bool:
    """Whether nothing was drawn from the global generators between these states."""
    (kind, keys, *more), python = one
    (other_kind, other_keys, *other_more), other_python = other
    same = (kind, more, python) == (other_kind, other_more, other_python)
    return same and bool(np.array_equal(keys, other_keys))


@contextlib.contextmanager
def global_random(states: tuple | None) -> Iterator[None]:
    """Lends the process's global generators to an environment, and puts them back."""
    before = random_states()
    try:
        if states is not None:
            np.random.set_state(states[0])
            random.setstate(states[1])
        yield
    finally:
        np.random.set_state(before[0])
        random.setstate(before[1])


def method(env: gymnasium.Env, name: str) -> Callable | None:
    """A method of the environment or of a wrapper around it."""
    try:
        return env.get_wrapper_attr(name)
    except AttributeError:
        return None


class CompiledOnce(Generic[T]):
    """Makes copies of an environment; from the third on they get copies of the models.

    Compiling takes up to a tenth of a second and copying a few milliseconds. The first two copies
    both compile. Where their models are not equal, byte for byte, the environment draws its model
    at random or takes it from a file that changes: then each copy compiles.
    """

    def __init__(self, make: Callable[[], T]):
        self._make = make
        self._compiled: list[list[mujoco.MjModel]] = []  # by the first copies, in order
        self._same = False

    def __call__(self) -> T:
        mend_gymnasium_robotics()
        if len(self._compiled) < _COMPARED:
            models: list[mujoco.MjModel] = []
            with _compilers(lambda compiled: lambda *a, **k: _kept(compiled(*a, **k), models)):
                made = self._make()
            self._compiled.append(models)
            self._same = len(self._compiled) == _COMPARED and _equal(*self._compiled)
            return made
        if not self._same:
            return self._make()
        known = iter(self._compiled[0])

        def instead(compiled: Callable) -> Callable:
            def copied(*args: Any, **kwargs: Any) -> mujoco.MjModel:
                model = next(known, None)
                return compiled(*args, **kwargs) if model is None else copy.copy(model)

            return copied

        with _compilers(instead):
            return self._make()


def _kept(model: mujoco.MjModel, models: list[mujoco.MjModel]) -> mujoco.MjModel:
    """Keeps a copy of the model as it was compiled: its environment may change its own."""
    models.append(copy.copy(model))
    return model


@contextlib.contextmanager
def _compilers(replaced: Callable[[Callable], Callable]) -> Iterator[None]:
    """Temporarily replaces MuJoCo's compilers of XML."""
    own = {name: getattr(mujoco.MjModel, name) for name in _COMPILERS}
    try:
        for name, compiled in own.items():
            setattr(mujoco.MjModel, name, staticmethod(replaced(compiled)))
        yield
    finally:
        for name, compiled in own.items():
            setattr(mujoco.MjModel, name, staticmethod(compiled))


def _equal(first: list[mujoco.MjModel], second: list[mujoco.MjModel]) -> bool:
    return list(map(_bytes, first)) == list(map(_bytes, second))


def _bytes(model: mujoco.MjModel) -> bytes:
    buffer = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def fitted_into(picture: np.ndarray, height: int, width: int) -> np.ndarray:
    """The picture as large as fits, its proportions kept, on black."""
    ratio = min(height / picture.shape[0], width / picture.shape[1])
    rows, columns = (max(1, int(size * ratio)) for size in picture.shape[:2])
    at = [
        np.minimum((np.arange(new) + 0.5) * old / new, old - 1).astype(int)
        for new, old in ((rows, picture.shape[0]), (columns, picture.shape[1]))
    ]
    framed = np.zeros((height, width, 3), np.uint8)
    top, left = (height - rows) // 2, (width - columns) // 2
    framed[top : top + rows, left : left + columns] = picture[at[0]][:, at[1]]
    return framed
