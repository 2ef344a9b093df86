"""What a launch writes while it trains a panel: results, figures, policies, the report."""

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import hac_suite
from analysis.figures.success import write_figure
from analysis.report.run_report import write_report
from launch.folder import results
from launch.folder.layout import RunFolder
from launch.jobs.worker import save_policy
from tests.bench.team import held_memory


class Written(NamedTuple):
    """What the launcher's own process needs."""

    seconds: float
    gib: float


class Writing:
    """The launcher's part of a panel, in a folder that is thrown away."""

    def __init__(self, task: str):
        self._task = task
        import launch.experiment  # noqa: F401  # what a launcher holds in memory

    def __call__(self, agents: Sequence[Sequence[dict]], periods: int) -> Written:
        """Writes what a panel has written; a figure is drawn anew after each test period.

        Args:
          agents: per job the rows of one test period.
        """
        with tempfile.TemporaryDirectory() as out:
            folder = RunFolder(Path(out), self._task)
            folder.path.mkdir()
            results.rewrite(folder.results, [])
            seconds = 0.0
            for period in range(periods):
                start = time.perf_counter()
                for rows in agents:
                    own = [{**row, "task": self._task, "period": period} for row in rows]
                    results.append(folder.results, own)
                seconds += time.perf_counter() - start
            seconds += periods * len(agents) * _seconds(write_figure, folder)
            seconds += _seconds(write_report, folder)
        return Written(seconds, held_memory())


def _seconds(write, folder: RunFolder) -> float:
    write(folder.path)  # the first draws slowly
    start = time.perf_counter()
    write(folder.path)
    return time.perf_counter() - start


def save_policies(policies: Sequence[hac_suite.Policy]) -> float:
    """Seconds to save a job's policies."""
    with tempfile.TemporaryDirectory() as out:
        start = time.perf_counter()
        for seed, policy in enumerate(policies):
            save_policy(policy, Path(out) / str(seed), {})
        return time.perf_counter() - start
