"""The wheel, installed away from the checkout: its commands, policies, tasks and Gymnasium ids."""

import os
import shutil
import subprocess
import sys
import textwrap
from importlib import metadata
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parent.parent
ROOMS = ("analysis", "assets", "hac_suite", "launch", "tasks")
FILES = ("pyproject.toml", "README.md", "LICENSE")
COMMANDS = (
    "hac-run", "hac-play", "hac-doctor", "hac-status", "hac-view",
    "hac-fit", "hac-check-task", "hac-new-task",
)  # fmt: skip
TINY = (
    "--seeds=1", "--periods=1", "--workers=1", "--novideo",
    "--config.episodes_per_period=4", "--config.test_episodes=2",
)  # fmt: skip


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder into which the wheel, built from a copy of the sources, was installed."""
    folder = tmp_path_factory.mktemp("package")
    source, site = folder / "source", folder / "site"
    source.mkdir()
    for name in FILES:
        shutil.copy(ROOT / name, source)
    for room in ROOMS:
        ignored = shutil.ignore_patterns("__pycache__", "notebooks", "data")
        shutil.copytree(ROOT / room, source / room, ignore=ignored)
    # What builds it may be installed here; otherwise pip fetches it.
    at_hand = int(metadata.version("setuptools").split(".")[0]) >= 77
    building = ["--no-build-isolation", "--no-index"] if at_hand else []
    pip("wheel", "--no-deps", *building, "--wheel-dir", folder, source)
    (wheel,) = folder.glob("*.whl")
    pip("install", "--no-deps", "--no-index", "--target", site, wheel)
    return site


def pip(*words) -> None:
    command = [sys.executable, "-m", "pip", "--quiet", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.fixture
def away(site, tmp_path):
    """Runs a command in an empty folder, where only the installed package can be found."""
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONPATH", "MUJOCO_GL", "OMP_NUM_THREADS")
    }

    def run(*words) -> subprocess.CompletedProcess:
        return subprocess.run(
            [str(word) for word in words],
            env={**environment, "PYTHONPATH": str(site)},
            cwd=tmp_path,
            capture_output=True,
            text=True,
        )

    return run


def python(away, script: str) -> str:
    """What a script prints."""
    done = away(sys.executable, "-c", textwrap.dedent(script))
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_installed_package_is_what_is_imported(away, site):
    script = "import {0}; print(next(iter({0}.__path__)))"
    for room in ROOMS:
        assert Path(python(away, script.format(room)).strip()) == site / room


def test_the_commands_are_those_that_pyproject_declares(site):
    made = {path.name for path in (site / "bin").iterdir() if path.name.startswith("hac-")}
    assert made == set(COMMANDS)


@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "hac-doctor"])
def test_a_command_says_what_it_is_for(away, site, name):
    done = away(site / "bin" / name, "--help")
    assert (done.returncode, done.stderr) == (0, "")
    assert f"launch/{name.removeprefix('hac-').replace('-', '_')}.py" in done.stdout


def test_a_wrong_command_ends_with_2_and_creates_nothing(away, site, tmp_path):
    done = away(site / "bin" / "hac-run", "--task=pick_plce")
    assert (done.returncode, done.stdout) == (2, "")
    assert "did you mean 'pick_place'?" in done.stderr
    assert not list(tmp_path.iterdir())


def test_the_doctor_examines_this_machine(away, site):
    done = away(site / "bin" / "hac-doctor")
    assert done.returncode in (0, 1) and "ok   packages: " in done.stdout, done.stderr


def test_training_leaves_a_run_that_status_knows(away, site, tmp_path):
    trained = away(site / "bin" / "hac-run", "--task=pendulum_climb", "--subgoal_layers=1", *TINY)
    assert trained.returncode == 0, trained.stderr
    folder = tmp_path / "runs" / "pendulum_climb"
    assert len((folder / "results.csv").read_text().splitlines()) == 3  # a heading, two periods
    stands = away(site / "bin" / "hac-status", folder)
    assert stands.returncode == 0 and "1 of 1 runs done" in stands.stdout


def test_published_policies_are_found(away):
    found = python(
        away,
        """
        import tasks
        from launch.folder import policies
        for task in tasks.ALL:
            print(task, [found.subgoal_layers for found in policies.published(task)])
        """,
    )
    assert found.count("[0, 1, 2]\n") == 5 == len(found.splitlines())


def test_an_episode_is_written_as_a_page(away, site, tmp_path):
    pytest.importorskip("viser", exc_type=ImportError)
    words = ("--task=pendulum_climb", "--output=episode.html")
    played = away(site / "bin" / "hac-play", *words)
    assert played.returncode == 0, played.stderr
    assert "hac-lanes" in (tmp_path / "episode.html").read_text()


@pytest.mark.requires_gl
def test_a_published_policy_is_played(away, site, tmp_path):
    played = away(site / "bin" / "hac-play", "--task=pendulum_climb", "--output=strip.png")
    assert played.returncode == 0, played.stderr
    assert (tmp_path / "strip.png").stat().st_size > 10_000


def test_gymnasium_makes_a_task_without_an_import_of_ours(away):
    made = python(
        away,
        """
        import sys
        import gymnasium
        assert "tasks" not in sys.modules
        env = gymnasium.make("tasks:HACSuite/PickPlace-v0")
        observation, info = env.reset(seed=0)
        print(env.spec.max_episode_steps, len(observation["observation"]), info["is_success"])
        """,
    )
    assert made == "300 16 False\n"
