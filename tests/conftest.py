"""Settings that every test needs before anything imports MuJoCo; what to do where none renders."""

import os
import subprocess
import sys

import pytest

# One thread each, as workers have it: more only fight over the cores with tiny products.
os.environ.setdefault("OMP_NUM_THREADS", "1")


def _renders() -> bool:
    """Whether MuJoCo makes a GL context; asked of another process, since a failure stays."""
    probe = "import mujoco; mujoco.GLContext(8, 8).make_current()"
    return subprocess.run([sys.executable, "-c", probe], capture_output=True).returncode == 0


os.environ.setdefault("MUJOCO_GL", "egl")
RENDERS = _renders()
if not RENDERS:
    # With a backend whose library is missing, MuJoCo cannot even be imported.
    os.environ["MUJOCO_GL"] = "disabled"


def pytest_configure(config):
    config.addinivalue_line("markers", "requires_gl: renders; skipped where no GL library works")


def pytest_collection_modifyitems(items):
    if RENDERS:
        return
    from launch.pictures.video import REMEDY

    skip = pytest.mark.skip(reason=f"rendering does not work here; {REMEDY}")
    for item in items:
        if item.get_closest_marker("requires_gl"):
            item.add_marker(skip)


@pytest.fixture(params=["quick", pytest.param("thorough", marks=pytest.mark.slow)])
def try_all(request):
    """Calls a function with generated inputs, a few of them or a great many."""
    from tests import generated  # imports much: not what every test needs

    return generated.trial(quick=request.param == "quick")
