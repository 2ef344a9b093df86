"""Finding and parsing the MJCF files of `assets/mjcf/`."""

import os
import pathlib

import numpy as np
from dm_control import mjcf

# Beside this package, in the repository and in an installation alike.
MJCF_DIRECTORY = pathlib.Path(__file__).resolve().parent.parent / "assets" / "mjcf"

_MISSING = "the MJCF file {path!r} is missing; reinstall the project or restore it with git"
_BROKEN = "the MJCF file {path!r} could not be parsed: {error}"
_NO_RANGE = (
    "actuator {name} of {filename!r} needs a ctrlrange, because a task's actions must be bounded"
)


def load_mjcf(filename: str) -> mjcf.RootElement:
    """Parses `assets/mjcf/<filename>`, or the file at an absolute path.

    Raises:
      FileNotFoundError: there is no such file; the message names it.
      ValueError: the file is not valid MJCF; the message names it and says where.
    """
    path = MJCF_DIRECTORY / filename
    if not os.path.isfile(path):  # Path.is_file raises for names that are too long
        raise FileNotFoundError(_MISSING.format(path=str(path)))
    try:
        return mjcf.from_path(str(path))
    except Exception as error:  # the parser raises lxml's, KeyError and others besides ValueError
        reason = " ".join(str(error).split())
        raise ValueError(_BROKEN.format(path=str(path), error=reason)) from error


def action_bounds(filename: str) -> tuple[np.ndarray, np.ndarray]:
    """The least and the most that the actuators in an MJCF file take, [A] each.

    The file is parsed and not compiled. Its actuators are the task's, in their order.

    Raises:
      FileNotFoundError, ValueError: as `load_mjcf`, or there is no actuator, or one without a
        control range.
    """
    actuators = load_mjcf(filename).find_all("actuator")
    if not actuators:
        raise ValueError(f"{filename} has no actuators, so there is nothing to act with")
    ranges = np.array([_control_range(*own, filename) for own in enumerate(actuators)])
    return ranges[:, 0], ranges[:, 1]


def _control_range(index: int, actuator, filename: str) -> np.ndarray:
    """An actuator's control range [2]: its own, or that of the nearest of its default classes."""
    given, defaults = actuator.ctrlrange, actuator.dclass or actuator.root.default
    while given is None and defaults.tag == "default":
        given, defaults = getattr(defaults, actuator.tag).ctrlrange, defaults.parent
    if given is None:
        name = repr(actuator.name) if actuator.name else f"{index} ({actuator.tag} without a name)"
        raise ValueError(_NO_RANGE.format(name=name, filename=filename))
    return np.array(given)
