"""Renders test episodes in this process, whose MUJOCO_GL is set: run by `launch.pictures.video`.

MUJOCO_GL=egl python -m launch.films.rendering '{"films": [...], "output": ...}'
"""

import itertools
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import hac_suite
import tasks
from analysis import program
from analysis.reading.files import write_atomically
from launch.asking import start
from launch.drawing import pacing
from launch.films.board import board
from launch.films.columns import Columns
from launch.films.files import TooLarge, write_animation, write_mp4
from launch.films.sheet import Sheet
from launch.pictures import video
from launch.pictures.choosing import choose
from launch.pictures.course import Course, record
from tasks.worlds.making import NoFrames

_ANIMATIONS = (".webp", ".gif")
_PROBE = (64, 48)


def main(argument: str) -> None:
    """Writes what the JSON object `argument` asks for; without films, only tries to render.

    Raises:
      SystemExit: with video.BAD_REQUEST, after a line that says what is wrong with it.
    """
    request = json.loads(argument)
    if not request:
        _probe()
        return
    if request.get("task"):
        tasks.find(request["task"])
    try:
        courses = _played(request)
    except NoFrames as error:
        _refuse(str(error))
    except (program.CommandError, KeyError, TypeError, ValueError) as error:
        what = f"lacks the entry {error}" if isinstance(error, KeyError) else str(error)
        _refuse(f"policy: {what}")  # nothing is rendered yet
    try:
        _render(courses, request, lambda number, count: print(number, count, flush=True))
    except (program.CommandError, TooLarge) as error:
        _refuse(str(error))


def render_here(policies: Sequence[Path], output: Path, episodes: int = 1) -> None:
    """As `video.render`, of tasks that only this process has; MUJOCO_GL must render."""
    request = video.film(policies, output, episodes=episodes)
    _render(_played(request), request, lambda *_: None)


def _render(courses: list[Course], request: dict[str, Any], tell: video.Tell) -> None:
    output = Path(request["output"])
    output.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(output, lambda path: _write(courses, request, path, tell))


def _refuse(why: str) -> None:
    print(why, file=sys.stderr)
    sys.exit(video.BAD_REQUEST)


def _played(request: dict[str, Any]) -> list[Course]:
    """The episodes to show: of one policy, or one of each of several."""
    columns = request["columns"]
    if columns:
        shown = map(hac_suite.Policy.load, request["films"])
        return [record(policy, request["seed"], filmed=True) for policy in shown]
    count = 1 if request["output"].endswith(".png") else request["episodes"]
    choice = choose(request["films"], count)
    return [record(choice.policy, seed, filmed=True) for seed in choice.episodes]


def _write(courses: list[Course], request: dict[str, Any], path: Path, tell: video.Tell) -> None:
    size, camera = tuple(request["size"]), request["camera"]
    if path.suffix == ".png":
        Image.fromarray(board(courses[0], size[0], camera)).save(path)
        return
    if request["columns"]:
        columns = Columns(
            courses, request["columns"], size, camera, request["speed"], request["said"]
        )
        frames: Iterable[np.ndarray] = _telling(columns.frames(), len(columns.moments), tell)
    else:
        frames = _one_after_another(courses, request, size, tell)
    if path.suffix in _ANIMATIONS:
        write_animation(list(frames), path, request["most_bytes"])
    else:
        write_mp4(frames, path)


def _one_after_another(
    courses: Sequence[Course], request: dict[str, Any], size: tuple[int, int], tell: video.Tell
) -> Iterator[np.ndarray]:
    paces = [
        pacing.pace(course.steps, course.control_timestep, request["speed"]) for course in courses
    ]
    sheets = (
        Sheet(course, pace, size, request["camera"], _label(number, len(courses)))
        for number, (course, pace) in enumerate(zip(courses, paces, strict=True), start=1)
    )
    frames = itertools.chain.from_iterable(_closing(sheet) for sheet in sheets)
    return _telling(frames, sum(len(pace.moments) for pace in paces), tell)


def _label(number: int, count: int) -> str:
    return f"episode {number} of {count}" if count > 1 else ""


def _closing(sheet: Sheet) -> Iterator[np.ndarray]:
    yield from sheet.frames()
    sheet.close()


def _telling(frames: Iterable[np.ndarray], count: int, tell: video.Tell) -> Iterator[np.ndarray]:
    """The frames; each is told of."""
    for number, frame in enumerate(frames, start=1):
        tell(number, count)
        yield frame


def _probe() -> None:
    """Renders one frame, to find out whether this backend works."""
    env = tasks.load_vector(tasks.ALL[0], 1)
    env.reset(np.array([0]))
    picture = env.render(0, width=_PROBE[0], height=_PROBE[1])
    env.close()
    if not picture.any():
        raise RuntimeError("the rendered frame is black")


if __name__ == "__main__":
    start.die_with_the_parent()
    main(sys.argv[1])
