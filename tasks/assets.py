"""Finding and parsing the MJCF files of `assets/mjcf/`."""

import os
import pathlib

from dm_control import mjcf

# Beside this package, in the repository and in an installation alike.
MJCF_DIRECTORY = pathlib.Path(__file__).resolve().parent.parent / "assets" / "mjcf"

_MISSING = "the MJCF file {path!r} is missing; reinstall the project or restore it with git"
_BROKEN = "the MJCF file {path!r} could not be parsed: {error}"


def load_mjcf(filename: str) -> mjcf.RootElement:
    """Parses `assets/mjcf/<filename>`.

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
