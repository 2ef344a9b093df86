"""The board: a line for each agent from the start, with its episodes, success and time left."""

import io

import pytest

from launch.asking.console import Console
from launch.folder.agents import Agent, Job
from launch.jobs import progress

FIRST = Job(Agent("ur5_reacher", 1), (0, 1, 2))
SECOND = Job(Agent("ur5_reacher", 1), (3,))
OTHER = Job(Agent("ur5_reacher", 2), (0,))


@pytest.fixture
def clock(monkeypatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def lines(board: progress.Board, output: io.StringIO, clock: list[float]) -> list[str]:
    """What the board prints next, where the output is no terminal."""
    output.truncate(0)
    output.seek(0)
    clock[0] += 100
    board.tick()
    return output.getvalue().splitlines()


def test_an_agent_is_followed_from_waiting_to_done(clock):
    output = io.StringIO()
    with progress.Board([FIRST, SECOND, OTHER], 400, Console(file=output, width=200)) as board:
        one, two = lines(board, output, clock)
        assert one == "ur5_reacher, 1 subgoal layer: 4 seed(s), episodes 0/400, success -, waiting"
        assert two == "ur5_reacher, 2 subgoal layers: 1 seed(s), episodes 0/400, success -, waiting"
        board.started(FIRST)
        board.started(SECOND)
        assert lines(board, output, clock)[0].endswith("success -, training")
        board.progressed(FIRST, 100, 1.0)
        board.progressed(SECOND, 200, 0.0)
        (one, _) = lines(board, output, clock)
        # 200 s for a quarter of it, and 3 of the 4 seeds at 100%.
        assert one.endswith("episodes 100/400, success 75%, 10 min left")
        board.ended(SECOND, "failed")
        board.ended(FIRST, "done")
        assert lines(board, output, clock)[0].endswith("failed")


def test_where_output_is_a_file_an_agent_that_ends_has_a_line_at_once(clock):
    output = io.StringIO()
    with progress.Board([FIRST, SECOND, OTHER], 400, Console(file=output, width=200)) as board:
        board.progressed(FIRST, 400, 1.0)
        board.ended(FIRST, "done")
        assert not output.getvalue()  # other seeds of the agent still train
        board.ended(SECOND, "done")
    (line,) = output.getvalue().splitlines()
    assert line.startswith("ur5_reacher, 1 subgoal layer: 4 seed(s)") and line.endswith("done")


def test_lines_are_not_printed_at_every_tick(clock):
    output = io.StringIO()
    with progress.Board([FIRST], 400, Console(file=output, width=200)) as board:
        for _ in range(5):
            board.tick()
            clock[0] += 1
    assert output.getvalue().count("\n") == 1


def test_a_terminal_gets_a_live_table(clock):
    output = io.StringIO()
    console = Console(file=output, force_terminal=True, width=100)
    with progress.Board([FIRST], 400, console) as board:
        board.progressed(FIRST, 40, 0.5)
    assert "40/400" in output.getvalue() and "50%" in output.getvalue()


@pytest.mark.parametrize(
    ("seconds", "text"), [(0, "0 s"), (89, "89 s"), (100, "2 min"), (3900, "1 h 05 min")]
)
def test_durations(seconds, text):
    assert progress.duration(seconds) == text
