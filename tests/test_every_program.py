"""Every program, whatever is typed and whatever is in the files that it reads: one clear line."""

import contextlib
import functools
import importlib
import io
import json
import re
import warnings
from pathlib import Path

import pytest
from hypothesis import strategies as st

import hac_suite
from analysis import program
from analysis.reading import grid
from hac_suite import policy_files
from tests import generated
from tests.cases import published, some_slow
from tests.test_programs import PROGRAMS

TASK = "pendulum_climb"

# Where a program's work begins. It begins with an error here, so that words in order come as far.
WORK = {
    "launch.ablate": ["launch.ablate._train"],
    "launch.check_task": ["launch.check_task.findings"],
    "launch.doctor": ["launch.doctor.check_all"],
    "launch.final_success": ["launch.final_success.measure"],
    "launch.fit": ["launch.fit.fit"],
    "launch.play": [
        "launch.play.video.render",
        "launch.play.replay.render",
        "launch.play.live.play",
    ],
    "launch.publish": ["launch.publish.publish"],
    "launch.record_episodes": ["launch.record_episodes.record"],
    "launch.record_subgoals": ["launch.record_subgoals.record"],
    "launch.run": ["launch.experiment.run"],
    "launch.side_by_side": ["launch.side_by_side.video.render_side_by_side"],
    "launch.site": ["launch.site.build"],
    "launch.tune": ["launch.tune.tune"],
    "launch.view": ["launch.view.serving.serve"],
}
# Without these words they would read, and write into, what is published.
ELSEWHERE = {
    "analysis.ablations": ["--data=nowhere"],
    "analysis.anatomy": ["--data=nowhere"],
    "analysis.claims": ["--data=nowhere"],
    "analysis.depth": ["--data=nowhere"],
    "analysis.figure5": ["--data=nowhere"],
    "analysis.peers": ["--data=nowhere", "--peers=nowhere"],
    "analysis.tuning": ["--data=nowhere"],
}
# Programs that read a run folder, with the words that name it.
READERS = {
    "analysis.anatomy": ["--data=."],
    "analysis.calibration": [TASK],
    "analysis.claims": ["--data=."],
    "analysis.explain": [TASK],
    "analysis.figure": [TASK],
    "analysis.figure5": ["--data=."],
    "analysis.report.__main__": [TASK],
    "analysis.report.index": ["."],
    "analysis.table": [TASK],
    "analysis.verdict": [TASK],
    "launch.publish": [f"--task={TASK}", "--runs=.", "--data=data", "--policies=chosen"],
    "launch.status": [TASK],
}


def test_the_thorough_run_is_of_twenty_five_thousand_inputs():
    """A number of the docs; a strategy that several properties share counts for each."""
    each = generated.THOROUGH
    of_programs = len(PROGRAMS) * each["programs"] + len(READERS) * each["readers"]
    shared = each["words"] + (len(hac_suite.PRESETS) - 1) * each["overrides"]
    others = sum(each.values()) - each["programs"] - each["readers"]
    assert others + shared + of_programs >= 25_000


def carried_out(name: str, words: list[str]) -> int:
    """The exit status; what is printed is no traceback, and one line if something is wrong."""
    said = io.StringIO()
    main = importlib.import_module(name).main
    with (
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(said),
        warnings.catch_warnings(action="ignore"),
    ):
        status = main(["program", *words])
    if status:
        assert re.fullmatch(r"error: [^\n]+\n", said.getvalue()), (words, said.getvalue())
    return status


@functools.cache
def flags_of(name: str) -> tuple[str, ...]:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        importlib.import_module(name).main(["program", "--help"])
    return tuple(re.findall(r"^  --(\w+)=", printed.getvalue(), re.MULTILINE)) or ("help",)


@pytest.mark.parametrize("name", PROGRAMS)
def test_words(try_all, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def begin(*args, **keywords):
        raise program.CommandError("in order")

    for place in WORK.get(name, []):
        monkeypatch.setattr(place, begin)
    flag = st.one_of(st.sampled_from(flags_of(name)), generated.misspelt(flags_of(name)))
    values = st.one_of(generated.values, st.sampled_from([".", "nowhere", "/dev/null", TASK, "1"]))
    word = st.one_of(
        st.tuples(st.sampled_from(["--", "-", "--no"]), flag, st.just("="), values).map("".join),
        st.tuples(st.just("--"), flag).map("".join),
        values,
    )
    first = ELSEWHERE.get(name, [])  # last, --output could take it for its value

    def check(words: list[str]) -> None:
        assert carried_out(name, [*first, *words]) in (0, 2)

    try_all("programs", st.lists(word, max_size=4), check)


@pytest.fixture
def run(tmp_path, monkeypatch) -> Path:
    """A run folder of published results in the folder that is worked in."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / TASK
    (folder / "policies").mkdir(parents=True)
    lines = (grid.FOLDER / TASK / "results.csv").read_text().splitlines(keepends=True)
    (folder / "results.csv").write_text("".join([lines[0], *lines[1:24], *lines[111:134]]))
    lines = (grid.FOLDER / TASK / "subgoals.csv").read_text().splitlines(keepends=True)
    (folder / "subgoals.csv").write_text("".join(lines[:40]))
    for name in ("manifest.json", "anatomy.json"):
        (folder / name).write_bytes((grid.FOLDER / TASK / name).read_bytes())
    for file in policy_files.paths(published(TASK, 1)):
        (folder / "policies" / file.name).write_bytes(file.read_bytes())
    return folder


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", some_slow(READERS, "analysis.anatomy"))
def test_files(try_all, name, run, monkeypatch):
    monkeypatch.setattr("launch.publish.record_subgoals.record", lambda *args: [])
    files = {
        file: file.read_bytes()
        for file in (run / "results.csv", run / "manifest.json", run / "subgoals.csv",
                     run / "anatomy.json", *(run / "policies").glob("*.json"))
    }  # fmt: skip
    assert len(files) == 5

    def check(changed: tuple[Path, bytes]) -> None:
        file, content = changed
        file.write_bytes(content)
        try:
            assert carried_out(name, READERS[name]) in (0, 2)
        finally:
            file.write_bytes(files[file])

    inputs = [
        st.tuples(st.just(file), inputs)
        for file, whole in files.items()
        for inputs in (generated.damaged(whole), _entries(file, whole))
    ]
    try_all("readers", st.one_of(inputs), check)


def _entries(file: Path, whole: bytes) -> st.SearchStrategy:
    """The file with an entry or a cell changed, so that it is one of its kind still."""
    if file.suffix == ".json":
        return generated.other_entries(json.loads(whole))
    return generated.other_cells(whole.decode())
