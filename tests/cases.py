"""Cases of a parametrised test of which the quick tests take some."""

from collections.abc import Iterable
from typing import Any

import pytest


def some_slow(cases: Iterable[Any], *slow: Any) -> list[Any]:
    """The cases, of which the slow ones are left to `make test-all`."""
    return [pytest.param(case, marks=pytest.mark.slow) if case in slow else case for case in cases]
