"""The rooms' imports, walked: an arrow that the map does not have fails."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
ROOMS = {
    "tasks": {"numpy", "dm_control", "dm_env", "mujoco"},
    "hac_suite": {"numpy", "torch", "safetensors"},
    "analysis": {"numpy", "pandas", "scipy", "matplotlib", "absl"},
    "launch": {
        "tasks", "hac_suite", "analysis",
        "numpy", "torch", "absl", "ml_collections", "rich", "imageio", "PIL",
    },
}  # fmt: skip
# Rooms within a room that may import less than it.
SUB_ROOMS = {"hac_suite/algorithm": {"numpy"}}
EXCEPTIONS = {
    "tasks/to_gymnasium.py": {"gymnasium"},
    "launch/jobs/on_ray.py": {"ray"},
    "launch/tuning/study.py": {"optuna"},
    "launch/tuning/worker.py": {"optuna"},
    "analysis/tuning.py": {"optuna"},
}
# What nothing but the standard library gives.
STANDARD = __import__("sys").stdlib_module_names


def imported(source: str, room: str) -> Iterator[str]:
    """Top-level names of all modules that the source imports, also inside functions."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield room if node.level else (node.module or "").split(".")[0]


def wrong_arrows(source: str, path: str) -> set[str]:
    """Modules that the file at `path` imports and may not."""
    room = path.split("/")[0]
    allowed = SUB_ROOMS.get(path.rpartition("/")[0], ROOMS[room])
    allowed = allowed | EXCEPTIONS.get(path, set()) | {room} | STANDARD
    return set(imported(source, room)) - allowed


def files() -> list[str]:
    return sorted(
        str(path.relative_to(ROOT)) for room in ROOMS for path in (ROOT / room).rglob("*.py")
    )


@pytest.mark.parametrize("path", files())
def test_a_file_imports_only_what_its_room_may(path):
    assert wrong_arrows((ROOT / path).read_text(encoding="utf-8"), path) == set()


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("tasks/pendulum.py", "import hac_suite"),
        ("tasks/pendulum.py", "import gymnasium"),
        ("hac_suite/training/loop.py", "from tasks import vector"),
        ("hac_suite/algorithm/exploration.py", "import torch"),
        ("hac_suite/training/loop.py", "def f():\n    import scipy.stats"),
        ("analysis/reading/results.py", "from launch.folder.results import read"),
        ("analysis/reading/results.py", "import torch"),
    ],
)
def test_a_wrong_arrow_is_seen(path, source):
    assert wrong_arrows(source, path)


def test_every_room_was_walked():
    assert {path.split("/")[0] for path in files()} == set(ROOMS)
    assert {path.rpartition("/")[0] for path in files()} >= set(SUB_ROOMS)
