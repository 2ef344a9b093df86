"""Shows a trained policy: `python launch/play.py --task=pick_place --output=video.mp4`."""

import sys
from collections.abc import Sequence
from pathlib import Path

from absl import flags

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

    from launch.asking import start

    start.without_display()

import tasks
from analysis import program
from analysis.program import CommandError
from launch.asking import lists, looks
from launch.folder import policies
from launch.pictures import replay, video
from launch.viewing import live, serving

_SUFFIXES = (".mp4", ".png", ".html")
_HELP = """Renders test episodes of a trained policy into a file, or plays them live with --viewer.

  python launch/play.py --task=pick_place --subgoal_layers=1 --output=video.mp4
  python launch/play.py --task=pick_place --output=strip.png --camera=side
  python launch/play.py --task=pick_place --output=episode.html
  python launch/play.py --task=pick_place --viewer=auto

Below the picture of a video or strip is a lane for the end goal and one for each level's subgoals:
green ones were achieved, red ones missed, grey ones cut short because a level above achieved its
goal or the episode ended.

An .html is one episode in 3-D that you can turn and scrub, in one file that needs no server (extra
[viewer]). --viewer writes no file: `window` is MuJoCo's own window, `page` that of launch/view.py,
and `auto` the window if there is a display, else the page. If you have not trained an agent, it
plays the published policy of the task.

Flags:
{flags}

Exit status: 0 the file is written; 1 rendering failed; 2 the command was wrong."""


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = _flags()
    return program.carry_out(program.Program(_HELP, values), argv, lambda _: _play(values))


def _play(values: flags.FlagValues) -> int:
    task = lists.task(lists.task_word(values))
    output = _output(values)
    look = video.Look(values.speed, values.camera, looks.size(values.size))
    found = _choose(values, task)
    word = tasks.find(lists.task(found[0].task)).word
    if values.viewer != "none":
        return live.play(found, word, values.viewer)
    shown = [policy.path for policy in found]
    try:
        if output.suffix == ".html":
            replay.render(shown, output)
        else:
            with looks.telling() as tell:
                notes = video.render(
                    shown, output, episodes=values.episodes, look=look, task=word, tell=tell
                )
            for note in notes:
                print(note)
    except video.RenderingError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(output)
    return 0


def _flags() -> flags.FlagValues:
    values = flags.FlagValues()
    lists.define_task(values, "pick_place", lists.ANY_TASK)
    program.define_count(
        values, "subgoal_layers", 2, "number of subgoal layers of the agent", least=0
    )
    lists.define_run(values)
    program.define_count(
        values,
        "seed",
        None,
        "seed of the policy; default: the median seed, or the best if that one never succeeds",
        least=0,
    )
    flags.DEFINE_string(
        "output",
        "video.mp4",
        ".mp4: a video; .png: a strip of frames; .html: an episode in 3-D",
        values,
    )
    program.define_count(values, "episodes", 1, "number of episodes in a video", least=1)
    looks.define(values, "1280x720")
    flags.DEFINE_enum(
        "viewer", "none", ["none", *live.VIEWERS], "watch it live instead of writing a file", values
    )
    return values


def _choose(values: flags.FlagValues, task: str) -> list[policies.Found]:
    """The policies that the flags name, in the order to show them."""
    run = None if values.run is None else Path(values.run)
    found, where = policies.of_task(task, run, typed=bool(values["task"].present))
    chosen = policies.choose(found, where, values.subgoal_layers, values.seed)
    if where == policies.PUBLISHED:
        print(f"{policies.lacking(Path('runs', task))}: playing the published policy")
    return chosen


def _output(values: flags.FlagValues) -> Path:
    """Where the picture goes."""
    output = Path(values.output)
    if output.suffix not in _SUFFIXES:
        raise CommandError(f"flag --output={output}: give a name that ends in .mp4, .png or .html")
    if output.suffix == ".html":
        serving.check()
    return output


if __name__ == "__main__":
    sys.exit(main(sys.argv))
