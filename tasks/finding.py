"""Finds tasks by a word: a registered name, a user's file, or a Gymnasium environment."""

import difflib
import functools
import importlib.util
import re
import sys
import traceback
import zlib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from dm_control import composer

# Importing a task's module registers it; this order is the order of `ALL`.
# isort: off
from tasks.errors import one_line
from tasks.families import pendulum  # noqa: F401
from tasks.families import ur5_reacher  # noqa: F401
from tasks.families import cartpole  # noqa: F401
from tasks.families import pick_place  # noqa: F401

# isort: on
from tasks import registry
from tasks.task_spec import TaskSpec
from tasks.vector import VectorEnv
from tasks.worlds import fitted, settings, words

ALL: tuple[str, ...] = tuple(registry.names())

_UNKNOWN = "unknown task {word!r}: {remedy}"
_ANY = "it is one of {names}, path/to/file.py:name, gym:ID, gym:module:ID, or settings.toml"
_NO_NAME = "task file {path}: add the name of its task, as in {path}:{name}"
_NO_FILE = "task file {path}: there is no such file"
_BROKEN = "task file {path}{where}: {error}"
_NO_SETTINGS = (
    "settings {path}: there is no such file; `python launch/fit.py --task=...` writes one"
)
_SETTINGS_NAME = (
    "settings {path}: {name!r} is the name of a task of the suite; give the file another name"
)
_NOT_THERE = "task file {path} registers no task {name!r}: {remedy}"


def find(word: str) -> registry.Entry:
    """The task that a word names.

        task = tasks.find("pick_place")
        task.spec.max_steps, task.load(seed=0), task.load_vector(64)

    Args:
      word: the name of a registered task; `gym:ID` or `gym:module:ID`, a Gymnasium environment (see
        `tasks.from_gymnasium`); `path/to/settings.toml`, which `launch/fit.py` writes for a task;
        or `path/to/file.py:name`, a task that a Python file of
        one's own registers as the suite's files do, with `tasks.registry.add`. The file is run
        once in a process. Its tasks cannot collide with the suite's: their name is the file's, a
        dash, and their own. In that process the name then finds the task as well.

    Raises:
      ValueError: there is no such task, or its file does not run; one line says what to do.
    """
    for look in _LOOKS:
        entry = look(word)
        if entry is not None:
            return entry
    remedy = _did_you_mean(word, registry.names()) or _ANY.format(names=", ".join(registry.names()))
    raise ValueError(_UNKNOWN.format(word=word, remedy=remedy))


def spec(word: str) -> TaskSpec:
    """The spaces, steps and scales of the task that a word names (see `find`).

    No physics is compiled for it.
    """
    return find(word).spec


def load(word: str, seed: int | None = None, *, test: bool = False) -> composer.Environment:
    """Loads a task as a Composer environment with the `dm_env` interface.

    Args:
      word: one of `ALL`, or any other that `find` knows.
      seed: decides all randomness of the environment; None takes one from the system.
      test: whether episodes begin from the test starts rather than the training starts.

    Raises:
      ValueError: there is no such task; the message names the closest.
    """
    return find(word).load(seed, test=test)


def load_vector(word: str, num_envs: int, seed: int = 0) -> VectorEnv:
    """Loads a task as `num_envs` environments stepped together (see `tasks.vector`).

    Args:
      word: one of `ALL`, or any other that `find` knows.
      num_envs: how many environments, at least 1.
      seed: decides the episodes of resets that are given no seeds.

    Raises:
      ValueError: there is no such task, or fewer than one environment.
    """
    return find(word).load_vector(num_envs, seed)


def _in_a_file(word: str) -> registry.Entry | None:
    """The task of `path/to/file.py:name`; None for words of another form."""
    path, _, name = word.rpartition(":")
    if word.endswith(".py"):
        path, name = word, ""
    if not path.endswith(".py"):
        return None
    if not Path(path).is_file():
        raise ValueError(_NO_FILE.format(path=path))
    found = _tasks_of(Path(path).resolve())
    if name in found:
        return _remembered(found[name])
    if not name and found:
        raise ValueError(_NO_NAME.format(path=path, name=next(iter(found))))
    remedy = _did_you_mean(name, found) or (
        f"it registers {', '.join(found)}"
        if found
        else "it registers no task with tasks.registry.add"
    )
    raise ValueError(_NOT_THERE.format(path=path, name=name, remedy=remedy))


def _in_gymnasium(word: str) -> registry.Entry | None:
    """The environment of `gym:ID`; None for words of another form."""
    entry = words.look(word)
    return entry and _remembered(entry)


def _with_settings(word: str) -> registry.Entry | None:
    """The task of a file of settings, `NAME.toml`; None for words of another form."""
    if not word.endswith(".toml"):
        return None
    path = Path(word)
    if not path.is_file():
        raise ValueError(_NO_SETTINGS.format(path=word))
    own, found = settings.from_toml(path.read_text(encoding="utf-8"), word)
    if path.stem in registry.names():
        raise ValueError(_SETTINGS_NAME.format(path=word, name=path.stem))
    try:
        if words.is_one(own):
            return _remembered(
                words.with_settings(own, found, name=path.stem, source=str(path.resolve()))
            )
        return _remembered(
            fitted.of_task(find(own), found, name=path.stem, word=str(path.resolve()))
        )
    except ValueError as error:
        raise ValueError(f"{word}: {error}") from error


def unfitted(word: str) -> fitted.Unfitted:
    """The task that a word names, before spaces are estimated for it: what `launch/fit.py` takes.

    Raises:
      ValueError: as `find`.
    """
    if word.endswith(".toml") and Path(word).is_file():
        word, _ = settings.from_toml(Path(word).read_text(encoding="utf-8"), word)
    if words.is_one(word):
        return words.unfitted(word)
    return fitted.unfitted_task(find(word))


def _remembered(entry: registry.Entry) -> registry.Entry:
    _FOUND[entry.name] = entry
    return entry


_FOUND: dict[str, registry.Entry] = {}  # in files of one's own, by name
# What can answer a word, asked in turn. Words of another form get a function of their own here,
# which returns None for words that are not of its form.
_LOOKS: tuple[Callable[[str], registry.Entry | None], ...] = (
    registry.get,
    _in_gymnasium,
    _in_a_file,
    _with_settings,
    _FOUND.get,
)


@functools.cache
def _tasks_of(path: Path) -> Mapping[str, registry.Entry]:
    """Runs a task file and returns what it registers, by the name that the file gave it.

    Raises:
      ValueError: it cannot be run; the message says where and why, in one line.
    """
    stem = re.sub(r"\W", "_", path.stem, flags=re.ASCII)
    # A name that no other module has, so that two files may be called alike.
    name = f"{stem}_{zlib.crc32(str(path).encode()):08x}"
    module_spec = importlib.util.spec_from_file_location(name, path)
    assert module_spec and module_spec.loader  # there is one for every .py
    module = importlib.util.module_from_spec(module_spec)
    sys.modules[name] = module  # as for an import: what is pickled looks for its module there
    try:
        with registry.collecting() as found:
            module_spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # a file of one's own can raise anything
        del sys.modules[name]
        raise ValueError(_broken(path, error)) from error
    return {
        own: registry.Entry(f"{stem}-{own}", f"{path}:{own}", entry.spec, entry.factory)
        for own, entry in found.items()
    }


def _broken(path: Path, error: BaseException) -> str:
    """What went wrong in a task file, and in which of its lines, in one line of text."""
    if isinstance(error, SyntaxError) and error.filename == str(path):
        line, reason = error.lineno, f"it is not Python: {error.msg}"
    else:
        line = line_in(str(path), error)
        reason = one_line(error)
    return _BROKEN.format(path=path, where=f", line {line}" if line else "", error=reason)


def line_in(path: str, error: BaseException) -> int | None:
    """The last line of a file that an error came through; None if it did not."""
    steps = traceback.extract_tb(error.__traceback__)
    return next((step.lineno for step in reversed(steps) if step.filename == path), None)


def _did_you_mean(word: str, valid: Iterable[str]) -> str | None:
    closest = difflib.get_close_matches(word, list(valid), n=1, cutoff=0.5)
    return f"did you mean {closest[0]!r}?" if closest else None
