"""Measures how fast the suite is and writes analysis/data/bench.json: `python -m tests.bench`.

Takes up to a quarter of an hour on two cores, which should have nothing else to do.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

# Read when numpy, torch and mujoco are imported, here and in the processes to come.
os.environ["MUJOCO_GL"] = "disabled"
for library in ("OMP", "MKL", "OPENBLAS"):
    os.environ[f"{library}_NUM_THREADS"] = "1"

from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402

from analysis.reading.files import write_text  # noqa: E402
from launch.folder import manifest  # noqa: E402
from tests.bench import growth, learning, limits, panel, same_work, stepping  # noqa: E402
from tests.bench.peers import curves  # noqa: E402
from tests.bench.repeats import REPEATS  # noqa: E402

OUTPUT = Path(__file__).resolve().parents[2] / "analysis" / "data" / "bench.json"

Part = Callable[[Callable[[str], None]], dict[str, Any]]
PARTS: dict[str, Part] = {
    "stepping": stepping.stepping,
    "sb3": same_work.sb3,
    "plain_hac": same_work.plain_hac,
    "gemm": limits.gemm,
    "panel": panel.panel,
    "growth": growth.growth,
    "peers": curves.peers,
    "learning": learning.learning,
}
_ONLY_ASKED = ("peers",)  # `python -m tests.bench.peers` compares at length


def main() -> None:
    """Prints tables; writes them as JSON, but for parts alone, unless told where."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__)
    parser.add_argument(
        "--part", nargs="+", choices=PARTS, help="measure only these parts; default: all but peers"
    )
    parser.add_argument("--output", type=Path, help=f"default: {OUTPUT}, or nowhere with --part")
    arguments = parser.parse_args()
    output = arguments.output or (None if arguments.part else OUTPUT)
    console = Console()
    parts = arguments.part or [p for p in PARTS if p not in _ONLY_ASKED]
    report, failed = measure(parts, console, output)
    show(report, console)
    if output is not None and len(failed) < len(parts):
        console.print(f"wrote {output}", soft_wrap=True)
    if failed:
        sys.exit(f"failed, see above: {', '.join(failed)}")


def measure(
    parts: Sequence[str], console: Console, output: Path | None = None
) -> tuple[dict[str, Any], list[str]]:
    """What the parts measure, and the names of those that fail; the others go on.

    Args:
        output: gets what each part has measured once it has. What other parts left there stays.
    """
    start = time.monotonic()

    def say(text: str) -> None:
        minutes, seconds = divmod(int(time.monotonic() - start), 60)
        console.print(f"{minutes:2d}:{seconds:02d} {text}", highlight=False)

    about = {
        "commit": manifest.commit(),
        "machine": manifest.machine(),
        "versions": manifest.versions(),
        "repeats": REPEATS,
    }
    measured: dict[str, Any] = {}
    failed = []
    for part in parts:
        began = time.monotonic()
        try:
            found = PARTS[part](say)
        except Exception:
            console.print_exception()
            failed.append(part)
            continue
        measured |= found
        if output is not None:
            keep(output, part, found, {"seconds": round(time.monotonic() - began), **about})
    say("done")
    return measured, failed


def keep(output: Path, part: str, found: Mapping[str, Any], about: Mapping[str, Any]) -> None:
    """Writes what a part has found in place of what it found before: how, and then the figures."""
    held = json.loads(output.read_text()) if output.exists() else {}
    parts = held.pop("parts", None)
    if parts is None:  # nothing says which part measured what
        held, parts = {}, {}
    stale = parts.get(part, {}).get("figures", ())
    kept = {name: value for name, value in held.items() if name not in stale}
    parts |= {part: {**about, "figures": list(found)}}
    output.parent.mkdir(parents=True, exist_ok=True)
    write_text(output, json.dumps({"parts": parts, **kept, **found}, indent=2) + "\n")


def show(report: dict[str, Any], console: Console) -> None:
    """Prints the report's figures."""
    figures = {key: value for key, value in report.items() if f"{key}_ci" in report}
    table = _table("figure", "median", "95% interval")
    for key, value in figures.items():
        interval = report[f"{key}_ci"]
        if isinstance(value, dict):
            for name in value:
                table.add_row(f"{key}: {name}", f"{value[name]:g}", _range(interval[name]))
        else:
            table.add_row(key, f"{value:g}", _range(interval))
    if "peak_memory_gib" in report:
        table.add_row("peak_memory_gib", f"{report['peak_memory_gib']:g}", "")
    console.print(table)
    if "steps_per_second" in report:
        console.print(_by_task(report["steps_per_second"], "steps/s", ",.0f"))
    if "panel_shares" in report:
        console.print(_by_task(report["panel_shares"], "panel's time", ".1%"))
    if "growth" in report:
        console.print(_growth(report["growth"]))
    if "minutes_to_90" in report:
        console.print(_waits(report["minutes_to_90"], report["minutes_to_90_ratio"]))


def _by_task(rows: dict[str, dict[str, float]], heading: str, style: str) -> Table:
    table = _table(heading, *next(iter(rows.values())))
    for task, values in rows.items():
        table.add_row(task, *(format(value, style) for value in values.values()))
    return table


def _growth(growth: dict[str, Any]) -> Table:
    table = _table("growth with", "", "ms per seed-episode")
    for axis in ("seeds", "levels", "replay_rows"):
        for value, seconds in growth[axis]["seconds"].items():
            table.add_row(axis, f"{int(value):,}", f"{1e3 * seconds:.1f}")
    table.add_row("memory", "", f"{growth['memory']['mib_per_seed']:g} MiB a seed")
    return table


def _waits(minutes: dict[str, dict[str, float | None]], ratios: dict[str, float]) -> Table:
    table = _table("core-minutes of a seed to 90%", "")
    for task, agents in minutes.items():
        for agent, value in agents.items():
            table.add_row(f"{task}: {agent}", "-" if value is None else f"{value:g}")
        if task in ratios:
            table.add_row(
                f"{task}: fastest of the other library / fastest of ours", f"{ratios[task]:g}"
            )
    return table


def _table(*headings: str) -> Table:
    table = Table(box=None, pad_edge=False, collapse_padding=True, header_style="bold")
    for index, heading in enumerate(headings):
        table.add_column(heading, justify="right" if index else "left", no_wrap=True)
    return table


def _range(interval: list[float]) -> str:
    return f"{interval[0]:g} to {interval[1]:g}"


if __name__ == "__main__":
    main()
