"""A live page of a trained policy: `python launch/view.py --task=pick_place`."""

import sys
from collections.abc import Sequence
from pathlib import Path

from absl import flags

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

    from launch.asking import start

    start.for_training()

from analysis import program
from launch.asking import lists
from launch.folder import policies
from launch.jobs.local import StopSignal
from launch.viewing import serving

_HELP = """Serves a page that plays a trained policy live and lets you move the goal.

  python launch/view.py --task=pick_place --subgoal_layers=2

The page shows the bodies, the end goal and every level's subgoal in 3-D. Play, pause, step, choose
another episode, policy or agent, and drag the end goal: a new episode begins from the current
state. Beside the picture it shows attempts left, Q and outcomes of every level. If you have not
trained an agent, it shows the published policies. Over ssh, forward the port with the line that it
prints. Ctrl-C stops it.

Flags:
{flags}

Exit status: 0 it was stopped; 2 the command was wrong, or the extra [viewer] is not installed."""


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = _flags()
    return program.carry_out(program.Program(_HELP, values), argv, lambda _: _view(values))


def _view(values: flags.FlagValues) -> int:
    serving.check()
    word = lists.task_word(values)
    task = lists.task(word)
    run = None if values.run is None else Path(values.run)
    typed = values["task"].present
    found, where = policies.of_task(task, run, typed=bool(typed))
    chosen = policies.choose(found, where, values.subgoal_layers, values.seed)[0]
    with StopSignal(b"\n") as stop:
        serving.serve(
            found,
            chosen,
            word=word if chosen.task == task else lists.task(chosen.task),
            address=serving.Address(values.host, values.port),
            stop=stop,
        )
    return 0


def _flags() -> flags.FlagValues:
    values = flags.FlagValues()
    lists.define_task(values, "pick_place", lists.ANY_TASK)
    program.define_count(
        values, "subgoal_layers", 2, "number of subgoal layers of the agent to show first", least=0
    )
    lists.define_run(values)
    program.define_count(
        values, "seed", None, "seed of the policy to show first; default: the median seed", least=0
    )
    flags.DEFINE_string(
        "host",
        serving.LOOPBACK,
        "address to listen on; any other address admits other machines, without a password",
        values,
    )
    program.define_count(
        values, "port", serving.PORT, "port, or the next free one", least=1024,
        most=65535,
    )  # fmt: skip
    return values


if __name__ == "__main__":
    sys.exit(main(sys.argv))
