"""Curves as files, one for each peer and seed, and the benchmark's short run of peers."""

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from analysis.reading.files import write_atomically
from analysis.statistics.peers import COLUMNS, load_curve

TASK = "ur5_reacher"
MINUTES = 0.25  # core-minutes of each run of the benchmark


class Run(NamedTuple):
    """One peer with one seed."""

    task: str
    agent: str
    settings: str
    seed: int

    @property
    def name(self) -> str:
        return f"{self.task}-{self.agent}-{self.settings}-{self.seed}"


def train_all(
    runs: Iterable[Run], folder: Path, *, episodes: int, minutes: float, test_every: int
) -> Iterator[tuple[Run, bool, list[dict[str, Any]]]]:
    """Trains what is not there yet, one after another; yields each run, whether trained, its rows.

    A curve that reached the episodes or the minutes is not trained again; a shorter one is, whole.
    """
    from tests.bench.peers.training import train  # in [dev] only

    folder.mkdir(parents=True, exist_ok=True)
    for run in runs:
        path = folder / f"{run.name}.csv"
        rows = load_curve(path).to_dict("records") if path.exists() else []
        trained = not finished(rows, episodes, minutes)
        if trained:
            rows = train(
                run.agent, run.settings, run.task, run.seed,
                episodes=episodes, minutes=minutes, test_every=test_every,
            )  # fmt: skip
            write(path, rows)
        yield run, trained, rows


def finished(rows: Sequence[dict[str, Any]], episodes: int, minutes: float) -> bool:
    """Whether a curve reached the end that is asked for."""
    if not rows:
        return False
    return rows[-1]["train_episodes"] >= episodes or rows[-1]["core_minutes"] >= minutes


def write(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Writes a whole curve, or nothing."""

    def put(temporary: Path) -> None:
        with temporary.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)

    write_atomically(path, put)


def peers(say: Callable[[str], None]) -> dict[str, Any]:
    """Each peer's success after a few core-seconds; no curve is written."""
    from tests.bench.peers.training import train  # in [dev] only

    report = {}
    for agent in ("sac", "td3"):
        for settings in ("zoo", "ours20"):
            say(f"peers: {agent}, {settings}, {MINUTES} core-minutes of {TASK}")
            last = train(agent, settings, TASK, 0, episodes=3000, minutes=MINUTES)[-1]
            say(f"peers: {last['success_rate']:.0%} after {last['train_steps']:,} steps")
            report[f"{agent} {settings}"] = last
    return {"peers": report}
