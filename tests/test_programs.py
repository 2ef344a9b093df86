"""Every program answers alike: --help, one error line, an exit status."""

import importlib
import re
from pathlib import Path

import pytest
from absl import flags

from analysis import program
from analysis.program import CommandError

ROOT = Path(__file__).resolve().parents[1]
PROGRAMS = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for room in ("analysis", "launch")
    for path in (ROOT / room).rglob("*.py")
    if "\ndef main(argv: Sequence[str]" in path.read_text()
)


def main(name: str):
    return importlib.import_module(name).main


def test_the_programs_are_found():
    assert {"analysis.table", "analysis.report.__main__", "launch.run", "launch.doctor"} <= {
        *PROGRAMS
    }
    assert len(PROGRAMS) >= 15


@pytest.mark.parametrize("name", PROGRAMS)
def test_help_shows_an_example_the_flags_and_the_exit_statuses(name, capsys):
    for word in ("--help", "-h"):
        assert main(name)(["program", word]) == 0
        printed = capsys.readouterr()
        assert re.search(r"^  python (-m analysis\.|launch/)\w+", printed.out, re.MULTILINE)
        assert "\n\nFlags:\n" in printed.out and "Exit status: " in printed.out
        assert not printed.err


@pytest.mark.parametrize("name", PROGRAMS)
def test_an_unknown_flag_is_answered_in_one_line(name, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for words in (["--otput=x"], ["runs/pick_place", "--otput=x"]):
        assert main(name)(["program", *words]) == 2
        printed = capsys.readouterr()
        assert re.fullmatch(r"error: unknown flag 'otput': .*\n", printed.err) and not printed.out
    assert list(tmp_path.iterdir()) == []


def test_flags_may_come_after_words_and_words_are_counted():
    values = flags.FlagValues()
    flags.DEFINE_string("output", None, "", values)
    seen = []
    one = program.Program("{flags}", values, words="one folder")
    assert program.carry_out(one, ["", "a", "--output", "b"], seen.extend) == 0
    assert (seen, values.output) == (["a"], "b")
    for words in ([], ["a", "b"]):
        assert program.carry_out(one, ["", *words], seen.extend) == 2
    assert seen == ["a"]
    several = one._replace(several_words=True)
    assert program.carry_out(several, ["", "b", "c"], seen.extend) == 0
    assert seen == ["a", "b", "c"]


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (CommandError("no such task"), 2, "error: no such task\n"),
        (CommandError("no task\n\x1b[1m\udcff"), 2, "error: no task\\n\\x1b[1m\\udcff\n"),
        (OSError("no space left"), 1, "error: no space left; finished results are kept\n"),
        (KeyboardInterrupt(), 130, "error: interrupted; finished results are kept\n"),
    ],
)
def test_what_goes_wrong_is_one_line_and_a_status(error, status, line, capsys):
    def work():
        raise error

    assert program.answer(work, str) == status
    assert capsys.readouterr().err == line


def test_a_program_that_only_reads_was_told_to_read_the_wrong_file(capsys):
    assert program.over_a_folder("", ["", "nowhere"], Path.read_bytes) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_an_error_of_ours_is_not_hidden():
    with pytest.raises(ZeroDivisionError):
        program.answer(lambda: 1 // 0, str)
