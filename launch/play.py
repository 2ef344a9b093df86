"""Renders a trained policy: `python launch/play.py --task=pick_place --output=video.mp4`."""

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
from analysis.reading import names
from launch.asking import lists
from launch.folder import policies
from launch.pictures import video

_HELP = """Renders test episodes of a trained policy into a file; opens no window.

  python launch/play.py --task=pick_place --subgoal_layers=1 --output=video.mp4

Without a run of your own it plays the published policy of the task.

Flags:
{flags}

Exit status: 0 the file is written; 1 rendering failed; 2 the command was wrong."""


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = _flags()
    return program.carry_out(program.Program(_HELP, values), argv, lambda _: _play(values))


def _play(values: flags.FlagValues) -> int:
    task = lists.task(lists.task_word(values))
    shown, output = _choose(values, task)
    word = tasks.find(task).word
    try:
        for note in video.render(shown, output, episodes=values.episodes, task=word):
            print(note)
    except video.RenderingError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(output)
    return 0


def _flags() -> flags.FlagValues:
    values = flags.FlagValues()
    lists.define_task(values, "pick_place", lists.ANY_TASK)
    program.define_count(values, "subgoal_layers", 2, "which agent", least=0)
    flags.DEFINE_string(
        "run", None, "run folder; if not given, runs/TASK, or published policies", values
    )
    program.define_count(
        values,
        "seed",
        None,
        "if not given, the median seed, or the best if it never succeeds",
        least=0,
    )
    flags.DEFINE_string("output", "video.mp4", ".mp4: a video; .png: a strip of frames", values)
    program.define_count(values, "episodes", 2, "how many a video shows", least=1)
    return values


def _choose(values: flags.FlagValues, task: str) -> tuple[list[Path], Path]:
    """The policies that the flags name, in the order to show them; where their picture goes."""
    output = Path(values.output)
    if output.suffix not in (".mp4", ".png"):
        raise CommandError(f"flag --output={output}: its name ends in .mp4 or .png")
    where = Path("runs", task) if values.run is None else Path(values.run)
    found = policies.find(where / names.POLICIES)
    if values.run is None and not found and (published := policies.published(task)):
        found, where = published, policies.PUBLISHED
        print(f"{Path('runs', task)} holds no policies: playing the published one")
    chosen = policies.choose(found, where, values.subgoal_layers, values.seed)
    if (values.run is None or values["task"].present) and chosen[0].task != task:
        raise CommandError(f"flag --task={task}: {where} holds policies of {chosen[0].task}")
    return [policy.path for policy in chosen], output


if __name__ == "__main__":
    sys.exit(main(sys.argv))
