"""The table of where agents stand."""

from analysis.reading.results import load
from analysis.table import main, tabulate


def test_a_row_by_hand(make_results):
    results = make_results({1: [[0.0, 0.5], [0.9, 1.0]]}, task="pick_place", steps=110)
    (row,) = tabulate(results).itertuples(index=False)
    # Seeds take 110 and 111 steps; one of two reaches 80%, at once: the median seed never does.
    assert row[:5] == ("pick_place", "1", "2", "300", "75.0%")
    assert row[6:] == ("-", "110", "110", "0.2")  # side by side until 12.5 s


def test_one_seed_has_no_interval_and_no_success_no_steps(make_results):
    (row,) = tabulate(make_results({0: [[0.0]]}, task="stack")).itertuples(index=False)
    assert row[4:9] == ("0.0%", "-", "-", "-", "-")


def test_tasks_come_in_the_papers_order_and_others_last(make_run):
    names = ["aardvark", "pick_place", "ur5_reacher"]
    results = load([make_run({2: [[1.0]], 0: [[1.0]]}, task=name) for name in names])
    shown = tabulate(results)[["task", "layers"]].to_numpy().tolist()
    assert shown == [[name, layers] for name in reversed(names) for layers in "02"]


def test_command_line_prints_markdown(make_run, capsys, tmp_path):
    assert main(["", str(make_run({0: [[0.0, 1.0]], 2: [[0.0, 1.0]]}))]) == 0
    heading, rule, flat, deep = capsys.readouterr().out.splitlines()
    assert heading.startswith("| task | layers | n |") and set(rule) <= set("| -")
    assert flat.startswith("| pick_place | 0 |") and deep.startswith("| pick_place | 2 |")
    assert main(["", str(tmp_path / "none")]) == 2
