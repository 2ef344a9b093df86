"""Generated inputs: what people type, and files that somebody damaged."""

import json
from collections.abc import Callable

import torch
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from launch.asking.settings import field_names

# Inputs of each property in `make test-all`; `make test` takes a few of each.
THOROUGH = {
    "words": 2500,
    "overrides": 2000,
    "counts": 1000,
    "results": 2000,
    "names": 1000,
    "manifests": 1000,
    "descriptions": 1000,
    "weights": 1000,
    "models": 1000,
    "programs": 200,
    "readers": 40,
}
QUICK = {"readers": 2, "results": 10, "manifests": 10}
FEW = 25


def trial(*, quick: bool) -> Callable[[str, st.SearchStrategy, Callable], None]:
    """What calls a function with generated inputs; the quick ones are the same each time."""

    def run(name: str, strategy: st.SearchStrategy, check: Callable) -> None:
        torch.set_flush_denormal(False)  # tests of workers turn it on, and inputs have such numbers
        count, tried = QUICK.get(name, FEW) if quick else THOROUGH[name], [0]

        def counted(value) -> None:
            tried[0] += 1
            check(value)

        limits = settings(
            max_examples=count,
            derandomize=quick,
            database=None,
            deadline=None,
            phases=(Phase.generate, Phase.shrink),
            suppress_health_check=list(HealthCheck),
        )
        limits(given(strategy)(counted))()
        assert tried[0] >= count

    return run


def answered(error: BaseException) -> None:
    """One line that says something."""
    assert str(error).strip()
    assert len(str(error).splitlines()) == 1, str(error)


# What the shell can pass on: any character but NUL, and bytes that are no text.
typed = st.text(
    st.one_of(
        st.characters(exclude_characters="\0", exclude_categories=["Cs"]),
        st.sampled_from("0123456789-+.,=()[]'\"\\/ \n\t\u0660\udcff"),
    ),
    max_size=30,
)
numbers = st.one_of(
    st.integers(-3, 40), st.integers(), st.floats(), st.sampled_from(["1e3", "0x10", "1_0", "٣"])
).map(str)
words = ("pick_place", "all", "paper", "local", "ray", "auto", "cpu", "cuda", "true", "None", "")
values = st.one_of(typed, numbers, st.sampled_from(words))
keys = st.one_of(st.sampled_from(field_names()), typed)


@st.composite
def misspelt(draw, names: tuple[str, ...]) -> str:
    """One of the names, often with a character more, less or other."""
    name = draw(st.sampled_from(names))
    place = draw(st.integers(0, len(name)))
    put = draw(st.sampled_from(["", "", "x", "_", name[place : place + 1] * 2]))
    return name[:place] + put + name[place + draw(st.integers(0, 1)) :]


@st.composite
def damaged(draw, whole: bytes) -> bytes:
    """The bytes with a few of them changed, gone, doubled or cut off; or others altogether."""
    data = bytearray(whole)
    for _ in range(draw(st.integers(0, 3))):
        place = draw(st.integers(0, max(0, len(data) - 1)))
        length = draw(st.integers(0, 40))
        extra = draw(
            st.one_of(st.binary(max_size=8), st.sampled_from([b",", b"\n", b'"', b"9" * 5000]))
        )
        data[place : place + length] = extra + data[place : place + draw(st.integers(0, length))]
    if draw(st.integers(0, 9)) == 0:
        return draw(st.binary(max_size=200))
    return bytes(data[: draw(st.integers(0, len(data)))] if draw(st.booleans()) else data)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=5,
)


@st.composite
def other_entries(draw, whole: dict) -> bytes:
    """A JSON object with some entries of other kinds, or missing."""
    changed = dict(whole)
    for name in draw(st.lists(st.sampled_from(sorted(whole)), max_size=3)):
        changed[name] = draw(json_values)
    for name in draw(st.lists(st.sampled_from(sorted(whole)), max_size=1)):
        del changed[name]
    return json.dumps(changed).encode()


cell = st.one_of(numbers, typed, st.sampled_from(["", "nan", "inf", "-1", "1e400", "9" * 5000]))


@st.composite
def other_cells(draw, whole: str) -> bytes:
    """A table with one cell changed, of the first ones of a line half the time."""
    lines = whole.splitlines()
    line = draw(st.integers(0, len(lines) - 1))
    cells = lines[line].split(",")
    column = draw(st.one_of(st.integers(0, 3), st.integers(0, len(cells) - 1)))
    cells[min(column, len(cells) - 1)] = draw(cell)
    changed = "\n".join([*lines[:line], ",".join(cells), *lines[line + 1 :], ""])
    return changed.encode(errors="surrogateescape")
