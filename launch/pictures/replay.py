"""An episode as one web page that needs no server: bodies, subgoals and outcomes over time.

viser's offline player holds the recorded scene; `replay.html`, which is put into its page, has the
timeline, the key and the marks of outcomes, and says to the player which moment to show.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from analysis.program import CommandError
from analysis.reading import paper
from analysis.reading.files import write_text
from launch.pictures import scene
from launch.pictures.choosing import choose
from launch.pictures.course import Course, record
from launch.pictures.outcomes import COLOURS, SIGNS
from launch.pictures.stage import Poses, Stage
from launch.pictures.subgoal_log import WORDS
from launch.pictures.video import RenderingError
from tasks.worlds.making import NoFrames

_LEAST_SECONDS = 5.0  # that an episode plays for at first, slowed down for it
_SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0)  # times real time
_SECONDS_AFTER = 1.0  # of the recording: the player begins anew where it ends
_DIGITS = 4  # of positions and quaternions in the file: a tenth of a millimetre
_OVERLAY = Path(__file__).with_name("replay.html")
_LIGHT, _AS_WANTED = "darkMode:false", "darkMode:matchMedia('(prefers-color-scheme: dark)').matches"
_EMPTY = "#9aa0a6"  # the colour of a level whose subgoals have no marker


def write(course: Course, path: Path) -> None:
    """Writes the page.

    Raises:
      scene.ViewerMissing: the extra is not installed.
    """
    write_text(path, page(_film(course), overlay(course)))


def _film(course: Course) -> str:
    """viser's page of the recording."""
    # Recording takes a server; nobody is told of it, and it is gone at once.
    server = scene.private("127.0.0.1", 0)
    try:
        drawn = scene.Scene(server, course.stage)
        drawn.draw(_rounded(course.poses[0]))
        drawn.draw_here(course.trail[0].round(_DIGITS))
        recording = server.get_scene_serializer()
        for poses, here in zip(course.poses[1:], course.trail[1:], strict=True):
            recording.insert_sleep(course.control_timestep)
            drawn.draw(_rounded(poses))
            drawn.draw_here(here.round(_DIGITS))
        recording.insert_sleep(_SECONDS_AFTER)
        return recording.as_html()
    finally:
        scene.stop(server)


def _rounded(poses: Poses) -> Poses:
    return Poses(
        poses.position.round(_DIGITS),
        poses.quaternion.round(_DIGITS),
        poses.seen,
    )


def page(film: str, over: dict[str, Any]) -> str:
    """viser's page with the overlay in it, fed with what `overlay` says.

    It is light or dark, as the person wants pages to be; viser's own is told once and for all.
    """
    data = json.dumps(over, ensure_ascii=False).replace("</", "<\\/")
    added = _OVERLAY.read_text(encoding="utf-8").replace("/*DATA*/null", data)
    before, head, after = film.replace(_LIGHT, _AS_WANTED).partition("<head>")
    return f"{before}{head}{added}{after}"


def overlay(course: Course) -> dict[str, Any]:
    """All that the page says about the episode beside the picture."""
    policy, stage = course.policy, course.stage
    task, top = policy.metadata["task"], policy.subgoal_layers
    lanes = [
        {
            "name": f"level {level}'s subgoals",
            "colour": _colour(stage, level - 1),
            "attempts": [
                [subgoal.step, subgoal.end_step, subgoal.outcome]
                for subgoal in sorted(course.subgoals, key=lambda subgoal: subgoal.step)
                if subgoal.level == level
            ],
        }
        for level in range(top, 0, -1)
    ]
    return {
        "title": f"{paper.title(task)}, {paper.agent_name(top)}, seed {policy.metadata['seed']}",
        "todo": course.title,
        "episode": course.seed,
        "success": course.success,
        "steps": course.steps,
        "timestep": course.control_timestep,
        "goal": stage.colour(stage.goal) or _EMPTY,
        "here": f"rgb{scene.HERE}" if course.trail.shape[1] else None,
        "lanes": lanes,
        "outcomes": {
            word: {"colour": COLOURS[outcome], "sign": SIGNS[outcome]}
            for outcome, word in WORDS.items()
        },
        "speeds": list(_SPEEDS),
        "speed": _speed(course.steps * course.control_timestep),
        "camera": {
            "position": stage.camera.position.round(_DIGITS).tolist(),
            "lookAt": stage.camera.look_at.round(_DIGITS).tolist(),
        },
    }


def _colour(stage: Stage, level: int) -> str:
    """The colour of the marker of what a level pursues."""
    shown = level < len(stage.subgoals)
    return (stage.colour(stage.subgoals[level]) if shown else None) or _EMPTY


def _speed(seconds: float) -> float:
    """Real time, or slower for what would be over too soon."""
    return max([speed for speed in _SPEEDS[:4] if seconds / speed >= _LEAST_SECONDS], default=0.1)


def render(policies: Sequence[Path], output: Path) -> None:
    """Writes the page of the episode that a video would show first.

    Args:
      policies: their paths without a suffix. The first one that succeeds in a test episode is
        shown; if none does, the first.

    Raises:
      RenderingError: the extra is not installed, a policy is bad, or the file cannot be written;
        `output` is untouched.
    """
    try:
        scene.load()
        choice = choose([str(path) for path in policies], 1)
        course = record(choice.policy, choice.episodes[0])
        if not course.poses:
            raise RenderingError(
                f"{course.title}: it renders its own frames, so there is no 3-D replay"
            )
        output.parent.mkdir(parents=True, exist_ok=True)
        write(course, output)
    except (scene.ViewerMissing, NoFrames, OSError) as error:
        raise RenderingError(str(error)) from error
    except (CommandError, KeyError, TypeError, ValueError) as error:
        what = f"lacks the entry {error}" if isinstance(error, KeyError) else str(error)
        raise RenderingError(f"policy: {what}") from error
