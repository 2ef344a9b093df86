"""The word `gym:ID` or `gym:module:ID`, with all that other processes need to make the task."""

import dataclasses
import functools
import hashlib
import importlib.metadata
import inspect
import json
import re
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tasks import registry
from tasks.worlds import fitted, making, settings
from tasks.worlds.copies import Options
from tasks.worlds.world import World

_PREFIX = "gym:"
_OPTIONS = {
    "args": dict,
    "goal": str,
    "subgoal": str,
    "goal_threshold": list,
    "max_steps": int,
    "train_options": dict,
    "test_options": dict,
}
_ESTIMATED = (
    "its spaces are estimated from random episodes; `python launch/fit.py` shows them, and writes "
    "them to a file to edit"
)
_NOT_JSON = "{word}: the text after the ? is not a JSON object: {error}"
_NO_OPTION = "{word}: there is no option {name!r}; there are {names}"
_WRONG = "{word}: its option {name} is {value!r}; it takes {wanted}"
_WANTED = {
    dict: "a JSON object", str: "text", list: "a list of numbers", int: "a count"
}  # fmt: skip


def is_one(word: str) -> bool:
    """Whether a word means a Gymnasium environment."""
    return word.startswith(_PREFIX)


def compose(word: str, options: Mapping[str, Any]) -> str:
    """The word `gym:ID` with options, which it then carries to wherever it is found again."""
    given = {name: value for name, value in options.items() if value not in (None, "", [], {})}
    if not given:
        return word
    return f"{word}?{json.dumps(given, sort_keys=True, separators=(',', ':'))}"


def look(word: str) -> registry.Entry | None:
    """The environment of the word; None for words of another form.

    Its entry's own word has the spaces in it that were estimated here, so that every process of a
    launch works with the same numbers.

    Raises:
      ValueError: it cannot be made, or HAC cannot train on it; one line says why.
    """
    return _entry(word) if is_one(word) else None


@functools.cache
def _entry(word: str) -> registry.Entry:
    plain, options, given = _parsed(word)
    fixed = settings.read(given, plain) if given else None
    world = _world(plain, options)
    entry = fitted.of_world(world, fixed)
    whole = compose(plain, {**options, "settings": entry.settings.as_json()})
    return _named(entry, world, plain, options, word=whole)


def with_settings(word: str, own: settings.Settings, *, name: str, source: str) -> registry.Entry:
    """The environment of a word with settings of a file; `name` and `source` are the file's."""
    plain, options, _ = _parsed(word)
    world = _world(plain, options)
    origin = _origin(world, plain, options)
    return fitted.of_world(world, own, name=name, word=source, origin=origin)


def unfitted(word: str) -> fitted.Unfitted:
    """The environment of a word, before its spaces are known."""
    plain, options, _ = _parsed(word)
    world = _world(plain, options)

    def fit(own: settings.Settings) -> fitted.FittedEntry:
        return fitted.of_world(world, own, name=_name(plain, options))

    return fitted.Unfitted(
        word=compose(plain, options),
        name=_name(plain, options),
        about=world.about(),
        env_of=world.adapter,
        fit=fit,
        notes=tuple(world.pool.notes),
    )


def _world(plain: str, options: Mapping[str, Any]) -> World:
    id = plain.removeprefix(_PREFIX)
    own = Options(
        goal=options.get("goal", ""),
        subgoal=options.get("subgoal", ""),
        threshold=tuple(map(float, options.get("goal_threshold", ()))),
        train=options.get("train_options"),
        test=options.get("test_options"),
    )
    make = making.maker(plain, id, options.get("args", {}))
    return World(plain, make, own, max_steps=options.get("max_steps"), title=f"Gymnasium's {id}")


def _named(
    entry: fitted.FittedEntry,
    world: World,
    plain: str,
    options: Mapping[str, Any],
    *,
    word: str,
) -> registry.Entry:
    origin = {**_origin(world, plain, options), "settings": entry.settings.as_json()}
    return dataclasses.replace(
        entry,
        name=_name(plain, options),
        word=word,
        origin=origin,
        notes=(*entry.notes, _ESTIMATED),
    )


def _origin(world: World, plain: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """What a run folder's manifest compares: the word, the package, and its source without one."""
    package, source = _package(world), inspect.getsourcefile(type(world.pool.env.unwrapped))
    found = {"task": compose(plain, options), "package": package}
    if " " not in package and source:  # no version that says what it holds
        found["source"] = hashlib.sha256(Path(source).read_bytes()).hexdigest()[:16]
    return found


def _name(plain: str, options: Mapping[str, Any]) -> str:
    """What folders and tables call it: the id, and a mark that differs with the options."""
    id = re.sub(r"[^\w.-]+", "-", plain.rpartition(":")[2].rpartition("/")[2]).strip("-.")
    if not options and registry.get(id) is None:
        return id
    return f"{id}-{zlib.crc32(compose(plain, options).encode()) & 0xFFFFFF:06x}"


def _package(world: World) -> str:
    """The installed package that the environment's class is of, with its version."""
    module = type(world.pool.env.unwrapped).__module__.partition(".")[0]
    found = importlib.metadata.packages_distributions().get(module)
    return f"{found[0]} {importlib.metadata.version(found[0])}" if found else module


def _parsed(word: str) -> tuple[str, dict[str, Any], dict[str, Any] | None]:
    """The word without options, its options, and the settings among them."""
    plain, _, text = word.partition("?")
    try:
        options = json.loads(text) if text else {}
    except ValueError as error:
        raise ValueError(_NOT_JSON.format(word=plain, error=error)) from error
    if not isinstance(options, dict):
        raise ValueError(_NOT_JSON.format(word=plain, error=f"{text} is not one"))
    given = options.pop("settings", None)
    for name, value in options.items():
        if name not in _OPTIONS:
            raise ValueError(_NO_OPTION.format(word=plain, name=name, names=", ".join(_OPTIONS)))
        wanted: type = _OPTIONS[name]
        if type(value) is not wanted:
            raise ValueError(
                _WRONG.format(word=plain, name=name, value=value, wanted=_WANTED[wanted])
            )
    return plain, options, given
