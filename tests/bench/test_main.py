"""What a run of the benchmark leaves in its file."""

import json

from rich.console import Console

from tests.bench import __main__ as bench


def parts(monkeypatch, **found):
    """Makes these the parts: each returns its figures, or raises them."""

    def part(figures):
        def measure(say):
            if isinstance(figures, Exception):
                raise figures
            return figures

        return measure

    monkeypatch.setattr(bench, "PARTS", {name: part(own) for name, own in found.items()})


def test_each_part_is_kept_whatever_happens_to_the_next(tmp_path, monkeypatch):
    parts(monkeypatch, stepping={"a": 1}, sb3=RuntimeError("no such peer"), gemm={"b": 2})
    output, console = tmp_path / "bench.json", Console(quiet=True)
    measured, failed = bench.measure(["stepping", "sb3", "gemm"], console, output)
    assert (measured, failed) == ({"a": 1, "b": 2}, ["sb3"])
    held = json.loads(output.read_text())
    assert (held["a"], held["b"]) == (1, 2)
    assert set(held["parts"]) == {"stepping", "gemm"}
    assert held["parts"]["gemm"]["figures"] == ["b"] and "cpu" in held["parts"]["gemm"]["machine"]


def test_a_part_that_is_measured_again_replaces_its_own_figures_alone(tmp_path, monkeypatch):
    output, console = tmp_path / "bench.json", Console(quiet=True)
    output.write_text('{"of": "an older version, which did not say what measured it"}')
    parts(monkeypatch, stepping={"a": 1}, gemm={"b": 2, "b_bf16": 3})
    bench.measure(["stepping", "gemm"], console, output)
    parts(monkeypatch, gemm={"b": 4})
    bench.measure(["gemm"], console, output)
    held = json.loads(output.read_text())
    del held["parts"]
    assert held == {"a": 1, "b": 4}
