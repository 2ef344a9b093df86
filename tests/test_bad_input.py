"""Property tests: whatever a person types or puts into a file, the answer is one clear line."""

import io
import json
import math
import shutil
import warnings
from pathlib import Path

import pytest
import safetensors.torch
import torch
from hypothesis import strategies as st

import hac_suite
import tasks
from analysis import program
from analysis.reading.results import load
from hac_suite.learning.networks import StackedMLP
from launch import play, status
from launch.asking import lists, request
from launch.asking.console import Console
from launch.asking.settings import field_names
from launch.folder import policies, results, states
from launch.folder.agents import Agent, Job
from launch.folder.layout import RunFolder
from tasks import assets
from tests.generated import (
    answered,
    damaged,
    keys,
    misspelt,
    numbers,
    other_cells,
    other_entries,
    typed,
    values,
)
from tests.launch import fake_jobs

AGENT = Agent("pendulum_climb", 1)
ASKED = {"subgoal_layers": [0, 1], "seeds": [0, 1], "periods": 2}
FAILURE = {"subgoal_layers": 0, "seeds": [1], "reason": "x"}
LAUNCH = {
    "task": AGENT.task, "max_steps": 1, "horizons": {}, "config": {}, "jobs": [],
    "earlier_launches": [], "asked": ASKED, "failures": [FAILURE], "workers": 2,
    "command": ["python", "x"], "finished": None,
    "planned": [{"subgoal_layers": 0, "seeds": [0, 1]}],
}  # fmt: skip


FLAGS = tuple(request.define_flags())
flag = st.one_of(st.sampled_from(FLAGS), misspelt(FLAGS), st.sampled_from(["config", "help", ""]))
word = st.one_of(
    st.tuples(st.sampled_from(["--", "-", "--no"]), flag, st.just("="), values).map("".join),
    st.tuples(st.sampled_from(["--", "-", "--no"]), flag).map("".join),
    values,
)


def check_words(argv: list[str]) -> None:
    try:
        found = request.parse(["launch/run.py", *argv])
    except program.HelpRequested:
        return
    except program.CommandError as error:
        return answered(error)
    assert set(found.tasks) <= set(tasks.ALL) and found.tasks
    assert found.seeds and found.periods > 0 and found.workers >= 0
    assert set(found.subgoal_layers) <= {0, 1, 2} and found.subgoal_layers
    assert str(found.out).isprintable()  # else printing the summary would fail


def test_words_of_the_training_command(try_all):
    try_all("words", st.lists(word, max_size=4), check_words)


def test_words_of_the_other_commands(try_all, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def check(argv: list[str]) -> None:
        flags = play._flags()
        try:
            program.parse(flags, ["launch/play.py", *argv])
            task = lists.task(lists.task_word(flags))
            play._output(flags)
            shown = play._choose(flags, task)
        except program.HelpRequested:
            return
        except program.CommandError as error:
            return answered(error)
        # There are no runs here; without --run it may play what is published.
        assert flags.run is None
        assert shown and all(found.path.parent == policies.PUBLISHED for found in shown)

    check([])  # no words at all: the published policy
    try_all("words", st.lists(word, max_size=4), check)


@pytest.mark.parametrize("preset", sorted(hac_suite.PRESETS))
def test_overrides_of_hyperparameters(try_all, preset):
    file = f"--config={request.CONFIGS / preset}.py"
    override = st.tuples(
        st.sampled_from(["--config.", "--noconfig.", "-config."]),
        st.one_of(keys, misspelt(field_names())),
        st.sampled_from(["=", "", " "]),
        st.one_of(
            values,
            st.lists(numbers, max_size=4).map(lambda items: f"({', '.join(items)})"),
            st.recursive(st.integers() | st.text(max_size=3) | st.none(), st.lists).map(repr),
        ),
    ).map("".join)
    try_all("overrides", st.lists(override, min_size=1, max_size=2).map(lambda o: [file, *o]),
            check_words)  # fmt: skip


def test_counts_are_understood_or_refused(try_all):
    def check(text: str) -> None:
        try:
            found = request.parse(["launch/run.py", f"--periods={text}"])
        except program.CommandError as error:
            return answered(error)
        assert found.periods == int(text)

    try_all("counts", st.one_of(numbers, typed, st.integers(1, 50).map(str)), check)


def rows() -> list[dict]:
    jobs = [Job(Agent(AGENT.task, layers), (0, 1)) for layers in (0, 1)]
    return [
        fake_jobs.row(job, seed, period) for job in jobs for seed in (0, 1) for period in range(3)
    ]


def show(state: states.FolderState) -> None:
    status.show(Path("runs"), state, Console(file=io.StringIO(), width=120))


def test_results_that_somebody_edited(try_all, tmp_path):
    folder = RunFolder(tmp_path, AGENT.task)
    folder.path.mkdir()
    results.rewrite(folder.results, rows())
    folder.manifest.write_text(json.dumps({**LAUNCH, "asked": None}))
    whole = folder.results.read_bytes()

    def check(data: bytes) -> None:
        folder.results.write_bytes(data)
        for read in (
            lambda: folder.finished(AGENT, 2),
            lambda: show(states.read(folder.path)),
            lambda: results.read(folder.results),
        ):
            try:
                read()
            except program.CommandError as error:
                answered(error)
        with warnings.catch_warnings(action="ignore"):
            try:
                load(folder.path)
            except ValueError as error:
                answered(error)

    try_all("results", st.one_of(other_cells(whole.decode()), damaged(whole)), check)


def test_names_of_run_folders_stay_below_the_output_folder(try_all, tmp_path):
    def check(name: str) -> None:
        try:
            folder = RunFolder(tmp_path, name)
            with folder.lock():
                assert folder.path.resolve().parent == tmp_path.resolve()
                shutil.rmtree(folder.path)
        except program.CommandError as error:
            answered(error)
        assert list(tmp_path.iterdir()) == []

    names = st.one_of(typed, st.sampled_from(["..", "../x", "a/b", "\0", "x" * 300, "~", "-"]))
    try_all("names", names, check)


def test_manifests_that_somebody_edited(try_all, tmp_path):
    folder = RunFolder(tmp_path, AGENT.task)
    folder.path.mkdir()
    results.rewrite(folder.results, rows())

    def check(data: bytes) -> None:
        folder.manifest.write_bytes(data)
        try:
            state = states.read(folder.path)
        except program.CommandError as error:
            return answered(error)
        show(state)
        assert {run.state for run in state.runs} <= set(states.STATES)

    @st.composite
    def other_request(draw) -> bytes:
        return json.dumps({**LAUNCH, "asked": json.loads(draw(other_entries(ASKED)))}).encode()

    text = json.dumps(LAUNCH).encode()
    deep = st.just(b"[" * 100_000)
    inputs = st.one_of(other_entries(LAUNCH), other_request(), damaged(text), deep)
    try_all("manifests", inputs, check)


@pytest.fixture
def policy(tmp_path) -> Path:
    """A small policy's path, without suffix."""
    network = StackedMLP(1, (3, 2, 2))
    network.initialise(0, torch.Generator().manual_seed(0), last=0.5)
    metadata = {"task": AGENT.task, "subgoal_layers": 0, "seed": 0, "success_rate": 0.5}
    hac_suite.Policy.of_seed([network], 0, (4,)).save(tmp_path / "policy", metadata)
    return tmp_path / "policy"


def check_policy(path: Path) -> None:
    try:
        loaded = hac_suite.Policy.load(path)
    except ValueError as error:
        answered(error)
    else:
        assert all(torch.isfinite(network.parameters).all() for network in loaded.networks)
    try:
        found = policies.find(path.parent)
    except program.CommandError as error:
        return answered(error)
    assert all(math.isfinite(policy.success_rate) for policy in found)


def test_descriptions_of_policies_that_somebody_edited(try_all, policy):
    file = policy.with_suffix(".json")
    whole = file.read_bytes()

    def check(data: bytes) -> None:
        file.write_bytes(data)
        check_policy(policy)

    deep = st.just(b"[" * 100_000)
    inputs = st.one_of(other_entries(json.loads(whole)), damaged(whole), deep)
    try_all("descriptions", inputs, check)


def test_weights_of_policies_that_somebody_edited(try_all, policy):
    file = policy.with_suffix(".safetensors")
    whole = file.read_bytes()

    @st.composite
    def other_tensors(draw) -> bytes:
        names = st.sampled_from(["level0.layer0", "level0.layer1", "level0.layer2", "x"])
        shapes = st.lists(st.integers(0, 4), max_size=3)
        kinds = st.sampled_from([torch.float32, torch.float64, torch.int64, torch.bool])
        made = draw(st.dictionaries(names, st.tuples(shapes, kinds), max_size=3))
        return safetensors.torch.save(
            {name: torch.zeros(shape, dtype=kind) for name, (shape, kind) in made.items()}
        )

    def check(data: bytes) -> None:
        file.write_bytes(data)
        check_policy(policy)

    try_all("weights", st.one_of(damaged(whole), other_tensors()), check)


def test_models_that_somebody_edited(try_all, tmp_path):
    file = tmp_path / "model.xml"
    whole = (assets.MJCF_DIRECTORY / "pendulum.xml").read_bytes()

    def check(given: tuple[str, bytes]) -> None:
        name, data = given
        file.write_bytes(data)
        try:
            assets.load_mjcf(str(tmp_path / name))
        except (FileNotFoundError, ValueError) as error:
            answered(error)

    names = st.one_of(st.just(file.name), st.just(file.name), typed, st.just("x" * 300))
    try_all("models", st.tuples(names, damaged(whole)), check)
