"""manifest.json: how a run folder's results were made, and by which commands."""

import contextlib
import functools
import hashlib
import importlib.metadata
import json
import os
import platform
import subprocess
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from analysis.program import CommandError
from analysis.reading.files import read_text, write_text
from hac_suite.config import completed
from launch.folder.agents import Agent, Job

Manifest = dict[str, Any]

_MOST = 10**9  # of anything that is counted here
_ROOT = Path(__file__).resolve().parents[2]
_OF_A_LAUNCH = (
    "command", "asked", "planned", "failures", "started", "finished", "workers", "device",
    "commit", "versions", "machine",
)  # fmt: skip
_PACKAGES = ("dm-control", "gymnasium", "mujoco", "numpy", "pandas", "scipy", "torch")
_DIFFERENCE = "{name} is {old!r} there and {new!r} here"
_OTHER_TASK = "{path} was trained on another version of the task ({differences})"
_DIFFERS = (
    "{path} holds runs of another configuration ({differences}); "
    "repeat its configuration, or give another --out"
)


def new(task: str, max_steps: int, config: Mapping[str, Any]) -> Manifest:
    """A manifest before its first launch; `config` in JSON's own types."""
    return {
        "task": task,
        "max_steps": max_steps,
        "horizons": {},  # attempts (T_0, ..., T_n) of each level, by number of subgoal layers
        "config": dict(config),
        "jobs": [],  # trainings that ended well: subgoal_layers, seeds, periods, seconds...
        "earlier_launches": [],  # oldest first; the latest is at the top level
    }


def add_launch(
    manifest: Manifest,
    command: Sequence[str],
    workers: int,
    device: str,
    asked: Mapping[str, Any] | None = None,
    planned: Sequence[Job] = (),
) -> Manifest:
    """The manifest with a launch that begins now: its command, versions and machine.

    Args:
      asked: what is to be in the folder in the end: subgoal_layers, seeds and periods.
      planned: the jobs that are to see to it; those of other tasks are left out.
    """
    launch = {
        "command": ["python", *command],
        "asked": asked,
        "planned": [_as_record(job) for job in planned if job.agent.task == manifest["task"]],
        "failures": [],  # of trainings: subgoal_layers, seeds, reason
        "started": now(),
        "finished": None,  # stays None where a signal, a kill or a full disk ended the launch
        "workers": workers,
        "device": device,
        "commit": commit(),
        "versions": versions(),
        "machine": machine(),
    }
    assert tuple(launch) == _OF_A_LAUNCH
    return {**manifest, **launch, "earlier_launches": _launches(manifest)}


def _launches(manifest: Manifest) -> list[dict[str, Any]]:
    """What the manifest says of each launch so far, oldest first."""
    if "command" not in manifest:
        return manifest["earlier_launches"]
    latest = {name: manifest.get(name) for name in _OF_A_LAUNCH}
    return [*manifest["earlier_launches"], latest]


def joined(published: Manifest, piece: Manifest) -> Manifest:
    """The manifest of what is published and of a piece of the same experiment beside it.

    The launches of the piece are the latest ones.
    """
    return {
        **piece,
        "horizons": {**published["horizons"], **piece["horizons"]},
        "jobs": [*published["jobs"], *piece["jobs"]],
        "earlier_launches": [*_launches(published), *piece["earlier_launches"]],
    }


def portable(manifest: Manifest) -> Manifest:
    """The manifest without the folders of the machine: those of --out, and of a learner's file."""
    launches = [_portable(launch) for launch in manifest["earlier_launches"]]
    config = manifest["config"]
    if "learner" in config:
        config = without_folders(config)
    return {**_portable(manifest), "config": config, "earlier_launches": launches}


def _portable(launch: dict[str, Any]) -> dict[str, Any]:
    command = launch.get("command")
    if not isinstance(command, list):  # somebody edited it
        return launch
    kept, folder = [], False
    for word in map(str, command):
        if not folder and not word.startswith("--out=/"):
            kept.append(word)
        folder = word == "--out"
    return {**launch, "command": [word for word in kept if word != "--out"]}


def _as_record(job: Job) -> dict[str, Any]:
    return {"subgoal_layers": job.agent.subgoal_layers, "seeds": list(job.seeds)}


def planned(manifest: Manifest) -> list[Job]:
    """The jobs of the latest launch and of those that ended well, where the manifest says so."""
    found = manifest.get("planned")
    latest: list[Any] = found if isinstance(found, list) else []
    jobs = []
    for record in (*latest, *reversed(manifest["jobs"])):
        with contextlib.suppress(KeyError, OverflowError, TypeError, ValueError):
            agent = Agent(manifest["task"], int(record["subgoal_layers"]))
            jobs.append(Job(agent, tuple(map(int, record["seeds"]))))
    return jobs


def read(path: Path) -> Manifest | None:
    """The manifest, or None where there is none yet.

    Raises:
      CommandError: the file is not a manifest.
    """
    if not path.exists():
        return None
    try:
        manifest = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise CommandError(f"{path} cannot be read ({error}); move the folder elsewhere") from error
    if not isinstance(manifest, dict) or not new("", 0, {}).keys() <= manifest.keys():
        raise CommandError(f"{path} is not a run folder's manifest; move the folder elsewhere")
    for name, (wanted, holds) in _FIELDS.items():
        if not holds(manifest[name]):
            raise CommandError(
                f"{path}: {name} is {manifest[name]!r:.40}, not {wanted}; repair it, or move the "
                "folder elsewhere"
            )
    return manifest


def _is_object(value: Any) -> bool:
    return isinstance(value, dict)


def _are_objects(value: Any) -> bool:
    return isinstance(value, list) and all(map(_is_object, value))


def _is_count(value: Any) -> bool:
    return type(value) is int and 0 < value < _MOST


def _are_horizons(value: Any) -> bool:
    return _is_object(value) and all(
        isinstance(attempts, list)
        and all(map(_is_count, attempts))
        and layers == str(len(attempts) - 1)
        for layers, attempts in value.items()
    )


# What a manifest's fields must be for anyone to work with them; others are shown, and no more.
_FIELDS: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "task": ("a name", lambda value: isinstance(value, str)),
    "max_steps": ("a count", _is_count),
    "horizons": ("lists of counts by number of subgoal layers", _are_horizons),
    "config": ("an object of hyperparameters", _is_object),
    "jobs": ("a list of objects", _are_objects),
    "earlier_launches": ("a list of objects", _are_objects),
}


def write(path: Path, manifest: Manifest) -> None:
    write_text(path, json.dumps(manifest, indent=2) + "\n")


def check_same(path: Path, manifest: Manifest, wanted: Manifest) -> None:
    """Refuses to mix results: curves in one figure are of one configuration.

    Raises:
      CommandError: names every setting that differs, with both values.
    """
    differences = [
        _DIFFERENCE.format(name=name, old=old, new=new)
        for name, old, new in _pairs(manifest, wanted)
        if old != new
    ]
    if differences:
        raise CommandError(_DIFFERS.format(path=path.parent, differences="; ".join(differences)))


def check_same_task(path: Path, task: Any) -> None:
    """Refuses to go on with a task that is no longer what it was: its file was edited.

    Args:
      path: the manifest of a run folder; nothing is checked where there is none.
      task: what `tasks.find` gives.

    Raises:
      CommandError: it names what differs.
    """
    manifest = read(path)
    own = task_file(task)
    if manifest is None or own is None:
        return
    differences = [
        _DIFFERENCE.format(name=name, old=old, new=new)
        for name, old, new in _origin_pairs(manifest.get("task_file"), own)
        if old != new
    ]
    if differences:
        raise CommandError(_OTHER_TASK.format(path=path.parent, differences="; ".join(differences)))


def _pairs(manifest: Manifest, wanted: Manifest) -> list[tuple[str, Any, Any]]:
    old, new = (without_folders(completed(own["config"])) for own in (manifest, wanted))
    pairs = [(name, old.get(name), new.get(name)) for name in sorted({*old, *new})]
    pairs += [
        (f"horizons with {layers} subgoal layer(s)", manifest["horizons"][layers], attempts)
        for layers, attempts in wanted["horizons"].items()
        if layers in manifest["horizons"]
    ]
    # Where the task is one of the suite's, the commit says which it was.
    origins = [found.get("task_file") for found in (manifest, wanted)]
    then, now = (found.get("learner_file") for found in (manifest, wanted))
    if then and now:  # earlier versions did not write it
        pairs.append(("the learner's file", then, now))
    return [
        *pairs,
        *_origin_pairs(*origins),
        ("max_steps", manifest["max_steps"], wanted["max_steps"]),
    ]


def _origin_pairs(old: Any, new: Any) -> list[tuple[str, Any, Any]]:
    """Where a task is from, there and here; the spaces that were estimated for it one by one."""
    spaces = [(own or {}).get("settings", {}) for own in (old, new)]
    pairs = [
        (f"{name} (estimated)", spaces[0].get(name), spaces[1].get(name))
        for name in sorted({*spaces[0], *spaces[1]})
    ]
    drop = {"settings"}
    for name in ("of", "source", "model"):  # which earlier versions did not write
        if not all(isinstance(own, dict) and name in own for own in (old, new)):
            drop.add(name)
    return [*pairs, ("task_file", *(_origin(own, drop) for own in (old, new)))]


def _origin(own: Any, drop: Collection[str]) -> Any:
    if not own:
        return own
    here = {key: value for key, value in own.items() if key not in drop}
    # Earlier versions wrote the file's whole path.
    return {**here, "task": Path(own["task"]).name} if "sha256" in own else here


def task_file(task: Any) -> dict[str, Any] | None:
    """Where a task of one's own is from (what `tasks.find` gave); None for the suite's.

    That is its file's name and what the file and its model hold; or a Gymnasium environment, its
    package and its spaces. A file of settings has the same of the task that they are for, as `of`.
    """
    word, origin = task.word, getattr(task, "origin", None)
    if word.endswith(".toml"):
        composer = getattr(task, "composer", None)
        of = origin if composer is None else task_file(composer)
        return {"task": Path(word).name, "sha256": _digest(word), **({"of": of} if of else {})}
    if origin:
        return origin
    path = word.rpartition(":")[0]
    if not path:
        return None
    return {"task": Path(word).name, "sha256": _digest(path), **_model(task)}


def _model(task: Any) -> dict[str, str]:
    """A digest of the task's model with all files that it is made of; nothing if it is broken."""
    try:
        xml = task.factory().root_entity.mjcf_model.to_xml_string()
    except Exception:  # a file of one's own can raise anything, and is refused elsewhere
        return {}
    return {"model": hashlib.sha256(xml.encode()).hexdigest()[:16]}


def learner_file(word: str) -> str | None:
    """What the file of a learner of one's own holds, as a digest; None for the suite's."""
    path = word.rpartition(":")[0]
    return _digest(path) if path else None


def without_folders(config: Mapping[str, Any]) -> dict[str, Any]:
    """A config whose learner is the same from whatever folder its file is named."""
    return {**config, "learner": Path(str(config["learner"])).name}


def _digest(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]


def now() -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S%z")


def versions() -> dict[str, str]:
    """Python's version and those of the packages that results depend on."""
    return {"python": platform.python_version(), **_versions_of_packages()}


@functools.cache
def _versions_of_packages() -> dict[str, str]:
    return {name: importlib.metadata.version(name) for name in _PACKAGES}


def machine() -> dict[str, Any]:
    return {"cpu": _cpu_model(), "cores": cores(), "system": platform.platform()}


def cores() -> int:
    """Cores this process may use, which a container can make fewer than the machine's."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1  # macOS cannot say more


def _cpu_model() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def commit() -> str | None:
    """The checked-out commit, with `+changes` where the files differ from it; None outside git."""
    try:
        described = subprocess.run(
            ["git", "describe", "--always", "--abbrev=40", "--dirty=+changes", "--exclude=*"],
            cwd=_ROOT,
            capture_output=True,
            text=True,
            timeout=10,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return described.stdout.strip()
