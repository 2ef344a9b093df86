"""Making a Gymnasium environment: by id, and with what its package needs mended."""

import importlib
import importlib.util
import types
from collections.abc import Callable, Mapping
from typing import Any

import gymnasium
import mujoco
import numpy as np

_NO_MODULE = (
    "{word}: there is no module {module!r} to import, which should register {id!r}: {error}"
)
_NOT_MADE = "{word}: gymnasium.make({id!r}{args}) failed: {error}"
_UNKNOWN_HINT = "; name the module that registers it, as in gym:gymnasium_robotics:{id}"
_DISCRETE = (
    "{word}: its actions are {space}; HAC's actions are numbers in a range (a Box): "
    "discrete actions are not supported"
)
_UNBOUNDED = "{word}: its actions have no bounds ({space}); wrap it in gymnasium's RescaleAction"
_PACKAGES = ("gymnasium_robotics",)  # asked where no module is named


def maker(word: str, id: str, args: Mapping[str, Any]) -> Callable[[], gymnasium.Env]:
    """What makes copies of the environment of an id, `ID` or `module:ID`.

    They come without a time limit, which is for the engine to keep, and with frames where they can.

    Raises (when first called):
      ValueError: it cannot be made; one line says why.
    """

    def make() -> gymnasium.Env:
        _import(word, id)
        options = dict(args)
        if _renders(id) and "render_mode" not in options:
            options["render_mode"] = "rgb_array"
        try:
            return gymnasium.make(id, max_episode_steps=-1, disable_env_checker=True, **options)
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
            importlib.import_module(each)
        except Exception as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            raise ValueError(
                _NO_MODULE.format(word=word, module=each, id=name, error=reason)
            ) from error
        if each in _PACKAGES:
            mend_gymnasium_robotics()


def _installed(package: str) -> bool:
    return importlib.util.find_spec(package) is not None


def _why(word: str, id: str, args: Mapping[str, Any], error: Exception) -> str:
    reason = " ".join(f"{type(error).__name__}: {error}".split())
    if isinstance(error, gymnasium.error.UnregisteredEnv) and ":" not in id:
        reason += _UNKNOWN_HINT.format(id=id)
    given = "".join(f", {name}={value!r}" for name, value in args.items())
    return _NOT_MADE.format(word=word, id=id, args=given, error=reason)


def _renders(id: str) -> bool:
    """Whether the environment of a registered id can give frames."""
    try:
        entry: Any = gymnasium.spec(id.rpartition(":")[2]).entry_point
        if isinstance(entry, str):
            entry = gymnasium.envs.registration.load_env_creator(entry)
    except Exception:  # `make` says what is wrong
        return False
    return "rgb_array" in getattr(entry, "metadata", {}).get("render_modes", ())


def mend_gymnasium_robotics() -> None:
    """Lets gymnasium-robotics 1.4 run with mujoco 3.17 and later, in this process only.

    There MuJoCo's enumerations no longer equal numpy's integers: `mjtJoint.mjJNT_HINGE ==
    numpy.int32(3)` is False, and so is `numpy.int32(3) in (mjtJoint.mjJNT_HINGE,)`. The package's
    `mujoco_utils` compares them so: Fetch and HandReach fail an assertion when they are made, and
    welds to a mocap body would be passed over in silence. This module, and no file, is given a
    `mujoco` whose enumerations are plain integers.
    """
    hinge = mujoco.mjtJoint.mjJNT_HINGE
    if hinge == np.int32(int(hinge)):
        return
    utils = importlib.import_module("gymnasium_robotics.utils.mujoco_utils")
    if isinstance(getattr(utils, "mujoco", None), types.ModuleType):
        utils.mujoco = _PlainEnums()  # type: ignore[attr-defined]


class _PlainEnums:
    """The module `mujoco`, but for its enumerations: their members are integers."""

    def __getattr__(self, name: str) -> Any:
        value = getattr(mujoco, name)
        if not name.startswith("mjt"):
            return value
        return types.SimpleNamespace(**{key: int(own) for key, own in value.__members__.items()})


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
