"""A job whose machine died: where it begins again, and that no row is lost or counted twice."""

import io

import pytest
import torch

import hac_suite
from analysis.program import CommandError
from analysis.reading.results import load
from hac_suite import checkpoint
from hac_suite.state import SeedState
from launch.asking.console import Console
from launch.folder import manifest, results
from launch.folder.agents import Agent, Job
from launch.folder.layout import RunFolder
from launch.jobs import checkpointing, lost_jobs, messages, worker
from launch.jobs.messages import WorkerLost
from launch.jobs.progress import Board
from launch.jobs.recorder import Recorder
from tests.launch import fake_jobs

AGENT = Agent("pendulum_climb", 1)
JOB = Job(AGENT, (0, 1), 0, 16)
CONFIG = hac_suite.PRESETS["paper"]
HORIZONS = (18, 18)


@pytest.fixture
def folder(tmp_path):
    folder = RunFolder(tmp_path, AGENT.task)
    with folder.lock():
        yield folder


@pytest.fixture
def recorder(folder) -> Recorder:
    manifests = {folder.task: manifest.new(folder.task, 300, {})}
    recorder = Recorder({folder.task: folder}, manifests, Console(file=io.StringIO()))
    recorder.prepare(folder.task, {(1, seed): [] for seed in JOB.seeds})
    return recorder


def rows(seed: int, periods: int) -> list[dict]:
    return [fake_jobs.row(JOB, seed, period) for period in range(periods)]


def save(folder: RunFolder, seed: int, *episodes: int) -> None:
    """Checkpoints of a seed, a test period every 4 episodes."""
    about = checkpointing.Setup(AGENT, HORIZONS, CONFIG).about(seed)
    writer = checkpoint.Writer([folder.checkpoints_of(1, seed)], [about])
    for count in episodes:
        own = [
            {name: value for name, value in row.items() if name != "task"}
            for row in rows(seed, count // 4 + 1)
        ]
        writer.save([SeedState({"a": torch.zeros(1)}, {"train_episodes": count, "rows": own})])


def again(folder: RunFolder, recorder: Recorder) -> Job:
    plan = worker.Plan(AGENT.task, folder.path.parent, CONFIG, {1: HORIZONS}, 4)
    said: list[str] = []
    return lost_jobs.again(JOB, recorder=recorder, plans={AGENT.task: plan}, say=said.append)


def test_without_checkpoints_of_all_seeds_it_begins_from_nothing(folder, recorder):
    assert again(folder, recorder) == JOB
    save(folder, 0, 4)
    assert again(folder, recorder).start == 0


def test_it_begins_where_the_last_of_its_seeds_stands(folder, recorder):
    save(folder, 0, 4, 8)
    save(folder, 1, 4)  # the machine died between the two
    assert again(folder, recorder) == JOB._replace(start=4)


def test_of_seeds_that_failed_by_themselves_none_begins_again(folder, recorder):
    recorder.manifests[folder.task]["failures"] = []
    save(folder, 1, 4)
    with Board([JOB], 16, Console(file=io.StringIO())) as board:
        recorder.receive(board, JOB, messages.SeedFailed(0, "its weights are not finite"))
        assert again(folder, recorder) == JOB._replace(seeds=(1,), start=4)
        recorder.receive(board, JOB, messages.SeedFailed(1, "its weights are not finite"))
    with pytest.raises(CommandError, match="failed before: its weights are not finite"):
        again(folder, recorder)


def test_rows_that_only_checkpoints_have_are_recorded_and_none_is_recorded_twice(folder, recorder):
    with Board([JOB], 16, Console(file=io.StringIO())) as board:

        def tested(period: int) -> None:
            own = [fake_jobs.row(JOB, seed, period) for seed in JOB.seeds]
            recorder.receive(board, JOB, messages.Tested(period, own))

        tested(0)
        for seed in JOB.seeds:
            save(folder, seed, 4, 8)
        assert again(folder, recorder).start == 8  # the rows of periods 1 and 2 never came
        assert load(folder.path)["period"].tolist() == [0, 1, 2] * 2
        recorder.receive(board, JOB, WorkerLost("its machine died"))
        for period in (1, 2, 3):  # it repeats some, as if it had begun from nothing
            tested(period)
    assert load(folder.path)["period"].tolist() == [0, 1, 2, 3] * 2  # load refuses doubled rows
    assert len(results.read(folder.results)[0]) == 8
