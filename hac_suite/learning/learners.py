"""The learners by name: the values of `Config.learner` and their classes."""

import difflib
import functools
import importlib
import importlib.util
import sys
import traceback
import zlib
from pathlib import Path
from types import ModuleType
from typing import Any

# A name, and the module and class that are imported once it is asked for.
LEARNERS = {
    "ddpg": ("hac_suite.learning.ddpg", "DDPG"),
    "td3": ("hac_suite.learning.td3", "TD3"),
}


def check(word: str) -> None:
    """Checks that a word can name a learner.

    Raises:
        ValueError: it is neither one of the names nor of the form FILE.py:CLASS.
    """
    file, _, name = word.rpartition(":")
    if word in LEARNERS or (file.endswith(".py") and name.isidentifier()):
        return
    near = difflib.get_close_matches(word, LEARNERS, n=1, cutoff=0.0)
    raise ValueError(
        f"learner is {word!r}; did you mean {near[0]!r}? It is one of {', '.join(LEARNERS)}, or "
        "a class of your own, as in path/to/my_learner.py:MyLearner."
    )


def find(word: str) -> type[Any]:  # of Learner, which needs the config, which needs the names
    """The learner of that name, or the user's class in FILE.py:CLASS.

    Raises:
        ValueError: there is none, or its file cannot be run.
    """
    check(word)
    if word in LEARNERS:
        module, name = LEARNERS[word]
        return getattr(importlib.import_module(module), name)
    file, _, name = word.rpartition(":")
    found = getattr(_loaded(Path(file)), name, None)
    if not isinstance(found, type):
        raise ValueError(f"learner is {word!r}, but {file} has no class {name!r}.")
    from hac_suite.learning.learner import Learner  # which needs the config, as above

    wanted = sorted({*Learner.__abstractmethods__, "on_gpu"})
    if missing := [own for own in wanted if not hasattr(found, own)]:
        raise ValueError(
            f"learner is {word!r}, but the class lacks {', '.join(missing)}; derive it from "
            "hac_suite.learning.learner.Learner, or from DDPG."
        )
    return found


def _loaded(file: Path) -> ModuleType:
    if not file.is_file():
        raise ValueError(f"learner is in {str(file)!r}, and there is no such file.")
    return _run(file.resolve())


@functools.cache
def _run(file: Path) -> ModuleType:
    # A name that no other module has, so that two files may be called alike.
    name = f"{file.stem}_{zlib.crc32(str(file).encode()):08x}"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # as for an import: dataclasses look for their module there
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # a file of one's own can raise anything
        del sys.modules[name]
        steps = traceback.extract_tb(error.__traceback__)
        line = next((step.lineno for step in reversed(steps) if step.filename == str(file)), None)
        where = f", line {line}" if line else ""
        why = " ".join(f"{type(error).__name__}: {error}".split())
        raise ValueError(f"learner is in {str(file)!r}{where}, which fails: {why}") from error
    return module
