"""Between `hac_suite.Config`, which the engine takes, and the ConfigDict of the command line."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ml_collections import ConfigDict

import hac_suite
from analysis import program


def from_preset(name: str) -> ConfigDict:
    """The named preset of `hac_suite.PRESETS` as an editable ConfigDict."""
    return ConfigDict(dataclasses.asdict(hac_suite.PRESETS[name]))


def field_names() -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(hac_suite.Config))


def to_config(settings: Mapping[str, Any]) -> hac_suite.Config:
    """The engine's config with these settings: a ConfigDict, or what `as_json` made.

    Raises:
      CommandError: a name that the engine does not have, or a value that it refuses.
    """
    for name in settings:
        if name not in field_names():
            raise program.CommandError(program.unknown("config key", name, field_names()))
    values = {name: _value(name, value) for name, value in settings.items()}
    try:
        return hac_suite.Config(**values)
    except ValueError as error:
        raise program.CommandError(f"config: {error}") from error


def _value(name: str, value: Any) -> Any:
    """The value in the field's type: dataclasses do not look at types themselves."""
    default = getattr(hac_suite.PRESETS["paper"], name)
    wanted = type(default)
    if wanted is tuple and isinstance(value, list | tuple):
        element = type(default[0])
        if all(type(item) is element for item in value):
            return tuple(value)
        raise program.CommandError(f"config: {name} takes a tuple like {default}, not {value!r}")
    if wanted is float and type(value) is int:
        return float(value)
    if type(value) is not wanted:
        raise program.CommandError(f"config: {name} takes a value like {default!r}, not {value!r}")
    return value


def as_json(config: hac_suite.Config) -> dict[str, Any]:
    """The config in the types that JSON knows, so that a manifest's copy compares equal to it."""
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in dataclasses.asdict(config).items()
    }


def anywhere(config: hac_suite.Config) -> hac_suite.Config:
    """The config for workers in other folders: a learner's file is named with its own."""
    file, colon, name = config.learner.rpartition(":")
    if not colon:
        return config
    return dataclasses.replace(config, learner=f"{Path(file).resolve()}:{name}")
