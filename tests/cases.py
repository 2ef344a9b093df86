"""What tests are given: cases of which the quick tests take some, and published policies."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

_POLICIES = Path(__file__).parents[1] / "assets" / "policies"


def some_slow(cases: Iterable[Any], *slow: Any) -> list[Any]:
    """The cases, of which the slow ones are left to `make test-all`."""
    return [pytest.param(case, marks=pytest.mark.slow) if case in slow else case for case in cases]


def published(task: str, subgoal_layers: int) -> Path:
    """An agent's published policy, of whichever seed."""
    (found,) = _POLICIES.glob(f"{task}_{subgoal_layers}layers_seed*.json")
    return found.with_suffix("")
