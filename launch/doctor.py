"""Checks this machine, and says how to fix what fails: `python launch/doctor.py`."""

import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

    from launch.asking import start

    start.without_display()

from absl import flags

from analysis import program
from launch.folder import manifest
from launch.pictures import video

_HELP = """Checks what training and rendering need on this machine, and says how to fix what fails.

  python launch/doctor.py

Flags:
{flags}

Exit status: 0 everything works; 1 something does not; 2 the command was wrong."""

_PROBE_SECONDS = 60.0
_REINSTALL = "install the pinned packages again: rm -r .venv && make setup"


class Finding(NamedTuple):
    """What a check found."""

    good: bool
    text: str
    remedy: str = ""


def check_packages() -> Finding:
    """Versions of the packages that results depend on, and whether they import together."""
    try:
        versions = manifest.versions()
        import hac_suite  # noqa: F401  (that it can be imported is what is asked)
        import tasks  # noqa: F401
    except Exception as error:
        return Finding(False, f"packages: {type(error).__name__}: {error}", _REINSTALL)
    listed = ", ".join(f"{name} {version}" for name, version in versions.items())
    return Finding(True, f"packages: {listed}")


def check_cores() -> Finding:
    """The number of cores for workers of one thread each, and whether they have bfloat16."""
    machine = manifest.machine()
    return Finding(
        True,
        f"processor: {machine['cpu']}, {machine['cores']} cores: "
        f"{machine['cores']} workers of one thread train at a time; "
        f"--precision=bf16 is {'possible' if _has_bf16() else 'not for it'}",
    )


def _has_bf16() -> bool:
    try:
        from hac_suite.learning import mixed
    except Exception:  # which `check_packages` tells
        return False
    return mixed.has_bf16()


def check_rendering() -> list[Finding]:
    """Which backend renders off-screen, by rendering a frame with each; one is enough."""
    problems = {
        backend: video.run_renderer(backend, "{}", timeout=_PROBE_SECONDS)
        for backend in video.BACKENDS
    }
    one_works = None in problems.values()
    return [
        Finding(
            one_works or problem is None,
            f"rendering with {backend}: " + ("works" if problem is None else f"no ({problem})"),
            video.REMEDY,
        )
        for backend, problem in problems.items()
    ]


def check_mp4() -> Finding:
    """Whether a video can be written, by writing one and reading it back."""
    try:
        import imageio.v3 as iio
        import numpy as np

        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "probe.mp4"
            frames = np.zeros((10, 48, 64, 3), np.uint8)
            iio.imwrite(path, frames, plugin="pyav", codec="libx264", fps=30)
            read = iio.imread(path, plugin="pyav").shape
        if read != frames.shape:
            raise RuntimeError(f"wrote frames {frames.shape}, read {read}")
    except Exception as error:
        return Finding(False, f"mp4: {type(error).__name__}: {error}", _REINSTALL)
    return Finding(True, "mp4: written and read back (H.264)")


def check_needs() -> list[Finding]:
    """Memory and disk for a run without flags, of the task that needs most of them."""
    try:
        import tasks
        from launch import experiment
        from launch.asking import request
        from launch.folder import needs

        asked = request.parse(["doctor"])
        found = [experiment.need(asked._replace(tasks=(task,))) for task in tasks.ALL]
    except Exception as error:
        return [Finding(False, f"needs: {type(error).__name__}: {error}", _REINSTALL)]
    memory, disk = max(need.memory for need in found), max(need.disk for need in found)
    (_, free), room = needs.memory(), needs.free_disk(Path.cwd())
    run = f"a run of {len(asked.seeds)} seeds needs up to"
    return [
        Finding(
            memory <= free,
            f"memory: {needs.told(free)} free; {run} {needs.told(memory)}",
            "give fewer --workers",
        ),
        Finding(
            disk <= room,
            f"disk: {needs.told(room)} free in {Path.cwd()}; {run} {needs.told(disk)}",
            "free some disk space, give another --out, or use --keep_final=false",
        ),
    ]


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    doctor = program.Program(_HELP, flags.FlagValues())
    return program.carry_out(doctor, argv, lambda _: check_all())


def check_all() -> int:
    """Prints every finding; returns 0 if all that is needed works, else 1."""
    checks: list[Callable[[], Finding | list[Finding]]] = [
        check_packages,
        check_cores,
        check_rendering,
        check_mp4,
        check_needs,
    ]
    all_good = True
    for check in checks:
        found = check()
        for finding in found if isinstance(found, list) else [found]:
            print(f"{'ok  ' if finding.good else 'FAIL'} {finding.text}", flush=True)
            if not finding.good:
                print(f"     remedy: {finding.remedy}")
                all_good = False
    return 0 if all_good else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv))
