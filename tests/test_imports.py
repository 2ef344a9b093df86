"""The rooms' imports, walked: an arrow that the map does not have fails."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
# What a house may import beside itself and the standard library.
HOUSES = {
    "tasks": {"numpy", "dm_control", "dm_env", "mujoco"},
    "hac_suite": {"numpy", "torch", "safetensors"},
    "analysis": {"numpy", "pandas", "scipy", "matplotlib", "absl"},
    "launch": {
        "tasks", "hac_suite", "analysis",
        "numpy", "torch", "absl", "ml_collections", "rich", "imageio", "PIL",
    },
}  # fmt: skip
# Rooms that may import less than their house.
LESS = {"hac_suite/algorithm": {"numpy"}, "analysis/reading": {"numpy", "pandas"}}
# What a room may import of the other rooms of its house; "." is the house's own files.
ROOMS = {
    "hac_suite/algorithm": {"."},
    "hac_suite/learning": {".", "algorithm"},
    "hac_suite/training": {".", "algorithm", "learning"},
    "analysis/reading": set(),
    "analysis/statistics": {"reading"},
    "analysis/figures": {"reading", "statistics"},
    "analysis/verdicts": {"reading", "statistics"},
    "analysis/report": {"reading", "statistics", "figures", "verdicts"},
    "launch/asking": set(),
    "launch/configs": {"asking"},
    "launch/folder": {"asking"},
    "launch/jobs": {"asking", "folder"},
    "launch/tuning": {"asking", "folder", "jobs"},
    "launch/pictures": {"asking", "folder", "jobs"},
    "launch/drawing": {"pictures"},
    "launch/recording": {"asking", "folder", "pictures"},
    "launch/films": {"asking", "drawing", "pictures"},
    "launch/viewing": {"asking", "folder", "jobs", "pictures"},
    "tasks/families": {".", "robots"},
    "tasks/robots": {"."},
    "tasks/authoring": {".", "worlds"},
    "tasks/to_gymnasium": {"."},
    "tasks/worlds": {"."},
}
# What a house's own files may import of its rooms; everything, where a house is not named.
OWN_FILES = {
    "hac_suite/__init__.py": {"algorithm", "learning", "training"},
    "hac_suite/acting.py": {"algorithm"},
    "hac_suite/config.py": {"learning"},  # which learners there are
    "hac_suite/policy.py": {"learning"},  # networks
    "hac_suite/values.py": {"learning"},  # critics
    "hac_suite": set(),
}
EXCEPTIONS = {
    "tasks/worlds/copies.py": {"gymnasium"},
    "tasks/worlds/making.py": {"gymnasium"},
    "tasks/worlds/world.py": {"gymnasium"},
    "tasks/to_gymnasium/__init__.py": {"gymnasium"},
    "tasks/to_gymnasium/vector_env.py": {"gymnasium"},
    "tasks/to_gymnasium/env.py": {"gymnasium"},
    "tasks/to_gymnasium/shared.py": {"gymnasium"},
    "launch/jobs/on_ray.py": {"ray"},
    "launch/pictures/stage.py": {"mujoco"},  # bodies as they are compiled
    "launch/drawing/lens.py": {"mujoco"},  # renders
    "launch/drawing/view.py": {"mujoco"},  # where cameras stand
    "launch/films/files.py": {"av"},  # encodes
    "launch/viewing/live.py": {"glfw"},  # asked whether there is a display
    "launch/viewing/window.py": {"mujoco"},
    "launch/tuning/study.py": {"optuna"},
    "launch/tuning/worker.py": {"optuna"},
    "analysis/statistics/tuning.py": {"optuna"},
    "analysis/report/page.py": {"jinja2"},
    "analysis/report/__main__.py": {"analysis"},
    "analysis/report/index.py": {"analysis"},  # a program: it takes analysis.program
}
MOST_FILES = 9  # in a room; a house's own files in analysis and launch are programs


def imported(source: str, path: str) -> Iterator[str]:
    """Dotted names of all modules that the source imports, also inside functions."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = Path(path).parts[: -node.level] if node.level else ()
            module = ".".join(filter(None, [*above, node.module]))
            yield from (f"{module}.{alias.name}" for alias in node.names)


def room_of(module: str) -> str:
    """The folder that holds a module of ours, or a name in one; another's top-level name."""
    parts = module.split(".")
    folder = ROOT
    for part in parts:
        if not (folder / part).is_dir() or (folder == ROOT and part not in HOUSES):
            break
        folder = folder / part
    return str(folder.relative_to(ROOT)) if folder != ROOT else parts[0]


def allowed(path: str) -> set[str]:
    """Rooms, and packages of others, that the file at `path` may import."""
    house, room = path.split("/")[0], path.rpartition("/")[0]
    others = LESS.get(room, HOUSES[house]) | EXCEPTIONS.get(path, set())
    if room == house:
        every = {name.split("/")[1] for name in ROOMS if name.startswith(f"{house}/")}
        inside = OWN_FILES.get(path, OWN_FILES.get(house, every))
    else:
        inside = ROOMS[room]
    return others | {room} | {house if name == "." else f"{house}/{name}" for name in inside}


def wrong_arrows(source: str, path: str) -> set[str]:
    """Rooms and packages that the file at `path` imports and may not."""
    house = path.split("/")[0]
    found = {room_of(module) for module in imported(source, path)} - sys.stdlib_module_names
    # Into another house, any room of it will do.
    found = {room if room.split("/")[0] == house else room.split("/")[0] for room in found}
    return found - allowed(path)


def files() -> list[str]:
    """All but data: the task files there are as launch/new_task.py writes them for anybody."""
    found = [path.relative_to(ROOT) for house in HOUSES for path in (ROOT / house).rglob("*.py")]
    return sorted(str(path) for path in found if path.parts[:2] != ("analysis", "data"))


@pytest.mark.parametrize("path", files())
def test_a_file_imports_only_what_its_room_may(path):
    assert wrong_arrows((ROOT / path).read_text(encoding="utf-8"), path) == set()


@pytest.mark.parametrize(
    ("path", "source", "wrong"),
    [
        ("tasks/families/pendulum.py", "import hac_suite", "hac_suite"),
        ("tasks/families/pendulum.py", "import gymnasium", "gymnasium"),
        ("hac_suite/training/loop.py", "from tasks import vector", "tasks"),
        ("hac_suite/training/loop.py", "def f():\n    import scipy.stats", "scipy"),
        ("analysis/reading/results.py", "from launch.folder.results import read", "launch"),
        ("analysis/reading/results.py", "import torch", "torch"),
        ("analysis/reading/results.py", "import matplotlib", "matplotlib"),
        ("analysis/reading/results.py", "from analysis import program", "analysis"),
        ("analysis/statistics/seeds.py", "import analysis.figures.success", "analysis/figures"),
        ("analysis/figures/success.py", "from analysis.report import page", "analysis/report"),
        ("launch/asking/request.py", "from launch.folder import layout", "launch/folder"),
        ("launch/folder/layout.py", "from launch.jobs.local import execute", "launch/jobs"),
        ("launch/folder/layout.py", "from ..jobs import local", "launch/jobs"),
        ("launch/jobs/local.py", "def f():\n    from launch.pictures import video",
         "launch/pictures"),
        ("launch/jobs/worker.py", "from launch import experiment", "launch"),
        ("hac_suite/types.py", "from hac_suite.learning import ddpg", "hac_suite/learning"),
        ("hac_suite/config.py", "from hac_suite.training import loop", "hac_suite/training"),
        ("hac_suite/algorithm/record.py", "import hac_suite.learning.replay",
         "hac_suite/learning"),
        ("hac_suite/algorithm/record.py", "import torch", "torch"),
    ],
)  # fmt: skip
def test_a_wrong_arrow_is_seen(path, source, wrong):
    assert wrong_arrows(source, path) == {wrong}


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("launch/jobs/worker.py", "from hac_suite.training import loop\nimport os.path"),
        ("launch/jobs/worker.py", "from launch.folder.layout import RunFolder"),
        ("launch/jobs/worker.py", "from launch.jobs import local\nfrom . import planning"),
        ("analysis/claims.py", "from analysis.verdicts import evidence"),
        ("hac_suite/training/loop.py", "from hac_suite import types"),
    ],
)
def test_a_right_arrow_is_none_of_these(path, source):
    assert wrong_arrows(source, path) == set()


def test_every_room_was_walked():
    rooms = {path.rpartition("/")[0] for path in files()}
    assert rooms == {*HOUSES, *ROOMS}


@pytest.mark.parametrize("room", [*ROOMS, "hac_suite"])
def test_a_room_can_be_held_in_mind(room):
    assert len(list((ROOT / room).glob("[!_]*.py"))) <= MOST_FILES
