"""The run folder: what counts as finished, torn files, the lock, and staying below --out."""

import csv
import math
import multiprocessing
import os
from pathlib import Path

import numpy as np
import pytest

import hac_suite
from analysis.figures.success import write_figure
from analysis.program import CommandError
from analysis.reading import schema
from analysis.reading.results import load
from analysis.reading.schema import RESULTS_COLUMNS
from analysis.report.run_report import write_report
from hac_suite import policy_files
from launch.folder import manifest, results
from launch.folder.agents import Agent, Job
from launch.folder.layout import RunFolder
from launch.jobs import worker
from tests.launch import fake_jobs

AGENT = Agent("pick_place", 1)


def row(seed: int, period: int, layers: int = 1) -> dict:
    job = Job(Agent("pick_place", layers), (seed,))
    return {
        **fake_jobs.row(job, seed, period),
        "success_rate": np.float64(0.1) * period,
        "mean_steps_to_goal": math.nan,
    }


@pytest.fixture
def folder(tmp_path) -> RunFolder:
    folder = RunFolder(tmp_path, "pick_place")
    with folder.lock():
        folder.prepare({})
    return folder


def add_policy(folder: RunFolder, layers: int, seed: int, **more) -> None:
    described = {"task": folder.task, "subgoal_layers": layers, "seed": seed, "success_rate": 0.5}
    policy_files.write(folder.policy(layers, seed), {}, {**described, **more})


def test_rows_read_back_with_empty_cells_for_what_is_not_a_number(folder):
    results.append(folder.results, [row(0, 3)])
    with folder.results.open() as file:
        (read,) = csv.DictReader(file)
    assert tuple(read) == RESULTS_COLUMNS
    assert float(read["success_rate"]) == 0.1 * 3  # every digit
    assert read["mean_steps_to_goal"] == read["level2_q_mean"] == ""
    assert results.read(folder.results) == ([read], 0)


@pytest.mark.parametrize(
    ("extra", "lacking"),
    [({"level0_novel": 1.0}, "level1_tested"), ({"novel": 1}, "seed"), ({"level2_q_min": 0.0}, "")],
)
def test_a_column_that_only_one_side_knows_is_refused(folder, extra, lacking):
    names = [*extra, lacking] if lacking else [*extra]
    with pytest.raises(ValueError, match="columns that only") as caught:
        results.append(
            folder.results, [{k: v for k, v in row(0, 0).items() if k != lacking} | extra]
        )
    assert all(repr(name) in str(caught.value) for name in names)
    assert results.read(folder.results) == ([], 0)


def lacking(table: Path, *columns: str) -> None:
    """Takes columns out of a file, as an earlier version would not have written them."""
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    with table.open("w", newline="") as file:
        kept = [name for name in rows[0] if name not in columns]
        writer = csv.DictWriter(file, kept, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


NEWEST = [schema.level_column(level, schema.LEVEL_FIELDS[-1]) for level in range(3)]


@pytest.mark.slow
def test_a_file_of_before_the_newest_diagnostic_is_gone_on_with(folder):
    results.append(folder.results, [row(0, period) for period in range(2)])
    lacking(folder.results, *NEWEST)
    add_policy(folder, 1, 0)
    assert folder.finished(AGENT, periods=1) == {0}
    assert load(folder.path)[NEWEST].isna().all().all()
    write_figure(folder.path)
    write_report(folder.path)
    with folder.lock():
        folder.prepare({(1, 1): []})
    results.append(folder.results, [{**row(1, 0), NEWEST[1]: 0.5}])
    table = load(folder.path)
    assert list(table.columns) == list(schema.RESULTS_COLUMNS)
    assert table[NEWEST[1]].isna().tolist() == [True, True, False]
    assert folder.finished(AGENT, periods=1) == {0}


def test_columns_of_a_later_version_are_kept(folder):
    results.append(folder.results, [row(0, 0)])
    header, line = folder.results.read_text().splitlines()
    folder.results.write_text(f"{header},level0_novel\n{line},0.25\n")
    with folder.lock():
        folder.prepare({(1, 1): []})
    results.append(folder.results, [row(1, 0)])
    assert load(folder.path)["level0_novel"].tolist()[0] == 0.25
    assert [r["level0_novel"] for r in results.read(folder.results)[0]] == ["0.25", ""]


def test_a_damaged_line_gets_the_same_verdict_from_both_sides(folder):
    results.append(folder.results, [row(0, 0), row(0, 1), row(0, 2)])
    lines = folder.results.read_text().splitlines()
    lines[2] = lines[2].rpartition(",")[0]
    folder.results.write_text("\n".join(lines) + "\n")
    for read in (load, lambda path: results.read(path)):
        with pytest.raises(
            (CommandError, ValueError), match=f"line 3: {len(RESULTS_COLUMNS) - 1} values where"
        ):
            read(folder.results)


def test_the_engine_measures_what_the_file_has_columns_for():
    assert hac_suite.DIAGNOSTICS == schema.LEVEL_FIELDS


@pytest.mark.parametrize(("column", "value"), [("seed", "1.5"), ("period", ""), ("seed", "-1")])
def test_a_bad_number_is_answered_with_its_line(folder, column, value):
    results.append(folder.results, [row(0, 0), {**row(0, 1), column: value}])
    with pytest.raises(CommandError, match=rf"results.csv, line 3: {column} is '{value}'"):
        folder.finished(AGENT, periods=1)


def test_a_seed_is_finished_with_all_its_rows_and_its_policy(folder):
    results.append(folder.results, [row(seed, period) for seed in (0, 1) for period in range(3)])
    results.append(folder.results, [row(2, 0), row(2, 2)])  # lacks period 1
    results.append(folder.results, [row(3, period, layers=0) for period in range(3)])
    for seed in (0, 2, 3):
        add_policy(folder, 1, seed)
    assert folder.finished(AGENT, periods=2) == {0}
    assert folder.finished(AGENT, periods=3) == set()
    assert folder.finished(Agent("pick_place", 0), periods=2) == set()


@pytest.mark.parametrize("cut", [1, 2, 10, 40])
def test_a_line_cut_short_is_dropped(folder, cut):
    results.append(folder.results, [row(0, 0), row(0, 1)])
    whole = folder.results.read_bytes()
    folder.results.write_bytes(whole[:-cut])
    rows, dropped = results.read(folder.results)
    assert ([r["period"] for r in rows], dropped) == (["0"], 1)
    with folder.lock():
        assert folder.prepare({}) == 1
    assert folder.results.read_bytes() == whole[: whole.rstrip().rfind(b"\n") + 1]


def test_preparing_drops_the_rows_of_seeds_trained_anew_and_no_others(folder):
    results.append(folder.results, [row(0, 0), row(1, 0), row(1, 0, layers=2)])
    for layers, seed in ((1, 0), (2, 1)):
        add_policy(folder, layers, seed)
    folder.failures.mkdir()
    (folder.failures / "old.txt").touch()
    with folder.lock():
        assert folder.prepare({(1, 1): []}) == 0
    kept = [(r["subgoal_layers"], r["seed"]) for r in results.read(folder.results)[0]]
    assert kept == [("1", "0"), ("2", "1")]
    assert [folder.has_policy(*run) for run in ((1, 0), (1, 1), (2, 1))] == [True, False, True]
    assert len(list(folder.policies.iterdir())) == 4
    assert not folder.failures.exists()


def test_preparing_an_extension_keeps_the_rows_until_the_policys_period_and_the_policy(folder):
    results.append(folder.results, [row(0, period) for period in range(4)])
    add_policy(folder, 1, 0, period=1)
    before = folder.results.read_text().splitlines()
    behind = [{**row(0, period), "wall_seconds": 99.0} for period in range(3)]
    with folder.lock():
        folder.prepare({(1, 0): behind})
    lines = folder.results.read_text().splitlines()
    assert lines[:3] == before[:3]  # as they were
    assert len(lines) == 4 and ",99.0," in lines[3]  # the checkpoint's, and no later one
    assert folder.ended(AGENT) == {0: (1, True)} and folder.has_policy(1, 0)


def test_rows_that_were_lost_are_noticed(folder):
    results.append(folder.results, [row(0, period) for period in (0, 1, 3)])
    assert folder.ended(AGENT) == {}  # no policy
    add_policy(folder, 1, 0, period=3)
    assert folder.ended(AGENT) == {0: (1, False)}
    add_policy(folder, 1, 0, period=1)  # period 3 is of an extension
    assert folder.ended(AGENT) == {0: (1, True)}


def test_preparing_removes_what_a_kill_left_half_written_and_nothing_else(folder):
    job = Job(AGENT, (0, 3))
    theirs = [
        ".gitignore",
        "policies/.keep",
        "videos/.DS_Store",
        "notes/.draft.log",
        ".figure.tmp",
        ".figure.tmp.png",
    ]
    for name in theirs:
        (folder.path / name).parent.mkdir(exist_ok=True)
        (folder.path / name).touch()
    for name in (".figure.12.tmp.png", "policies/.pick_place_1layers_seed0.7.tmp.json"):
        (folder.path / name).mkdir()
    folder.log(job).touch()
    folder.replays.mkdir(exist_ok=True)
    for name in (
        ".figure.123.tmp.png", ".results.9.tmp.csv", ".report.77.tmp.html", ".subgoals.7.tmp.csv",
        "policies/.pick_place_1layers_seed3.12.tmp.safetensors",
        "videos/.pick_place_1layers.55.tmp.mp4",
        "replays/.pick_place_1layers.55.tmp.html",
    ):  # fmt: skip
        (folder.path / name).touch()
    with folder.lock():
        folder.prepare({(1, 0): []})
    files = {str(p.relative_to(folder.path)) for p in folder.path.rglob(".*") if p.is_file()}
    assert files == {".lock", *theirs}


@pytest.mark.slow
def test_half_written_files_have_the_names_that_preparing_removes(folder, monkeypatch):
    def killed(*_):
        raise KeyboardInterrupt

    results.append(folder.results, [row(0, 0)])
    monkeypatch.setattr("os.replace", killed)
    monkeypatch.setattr("pathlib.Path.unlink", lambda *_, **__: None)
    for write in (
        lambda: manifest.write(folder.manifest, {}),
        lambda: results.rewrite(folder.results, [row(0, 0)]),
        lambda: write_report(folder.path),
        lambda: write_figure(folder.path),
        lambda: worker.save_policy(FakePolicy(), folder.policy(1, 0), {}),
    ):
        with pytest.raises(KeyboardInterrupt):
            write()
    monkeypatch.undo()
    assert len([p for p in folder.path.rglob(".*") if p.name != ".lock"]) == 6
    with folder.lock():
        folder.prepare({})
    assert [p.name for p in folder.path.rglob(".*")] == [".lock"]


class FakePolicy:
    def save(self, path, metadata) -> None:
        for suffix in (".json", ".safetensors"):
            path.with_name(path.name + suffix).touch()


def test_a_file_of_other_columns_is_refused_and_kept(folder):
    folder.results.write_text("a,b\n1,2\n")
    with pytest.raises(CommandError, match=r"lacks the column\(s\) task"):
        folder.finished(AGENT, periods=1)
    assert folder.results.read_text() == "a,b\n1,2\n"


def _hold(folder: RunFolder, locked, release) -> None:
    with folder.lock():
        locked.set()
        release.wait(60)


@pytest.mark.parametrize("killed", [False, True])
def test_a_second_launch_is_refused_until_the_first_ends_or_dies(folder, killed):
    context = multiprocessing.get_context("fork")
    locked, release = context.Event(), context.Event()
    first = context.Process(target=_hold, args=(folder, locked, release))
    first.start()
    assert locked.wait(60)
    with pytest.raises(CommandError, match=f"in use by process {first.pid}"), folder.lock():
        pass
    if killed:
        first.kill()
    else:
        release.set()
    first.join(30)
    with folder.lock():
        pass


@pytest.mark.parametrize("name", ["", ".", "..", "../up", "a/b", "/etc", "a\0b"])
def test_names_that_are_not_folder_names_are_refused(tmp_path, name):
    with pytest.raises(CommandError, match="cannot name a run folder"):
        RunFolder(tmp_path, name)


def test_out_may_have_spaces_and_any_letters(tmp_path):
    folder = RunFolder(tmp_path / "my runs é中", "pick_place")
    with folder.lock():
        folder.prepare({})
    assert folder.results.parent == tmp_path / "my runs é中" / "pick_place"


def test_an_out_that_is_a_file_is_answered(tmp_path):
    (tmp_path / "file").touch()
    with (
        pytest.raises(CommandError, match="cannot write to"),
        RunFolder(tmp_path / "file", "pick_place").lock(),
    ):
        pass


def test_a_manifest_survives_the_disk_and_keeps_earlier_launches(tmp_path):
    path = tmp_path / "manifest.json"
    first = manifest.add_launch(manifest.new("pick_place", 400, {"sizes": [1, 2]}), ["a"], 2, "cpu")
    manifest.write(path, first)
    second = manifest.add_launch(manifest.read(path), ["b"], 1, "cpu")
    assert second["command"] == ["python", "b"]
    assert [launch["command"] for launch in second["earlier_launches"]] == [["python", "a"]]
    assert second["versions"]["mujoco"] and second["machine"]["cores"] >= 1


def test_cores_are_counted_where_the_system_does_not_tell_which(monkeypatch):
    monkeypatch.delattr("os.sched_getaffinity")
    assert manifest.cores() == os.cpu_count()


def test_the_report_shows_the_commands_that_the_manifest_records(folder):
    results.append(folder.results, [row(0, 0)])
    recorded = manifest.new("pick_place", 400, {})
    for seeds in ("--seeds=1", "--seeds=2"):
        recorded = manifest.add_launch(recorded, ["launch/run.py", seeds], 2, "cpu")
    manifest.write(folder.manifest, recorded)
    shown = write_report(folder.path).read_text().replace("<span>", "").replace("</span>", "")
    for seeds in ("--seeds=1", "--seeds=2"):
        assert f"<pre>python launch/run.py {seeds}</pre>" in shown


@pytest.mark.parametrize("name", ["task", "max_steps", "horizons", "config", "jobs"])
@pytest.mark.parametrize(
    "value", [None, -1, 10**400, math.nan, True, [None], [[1]], {"0": None}, {"x": [1]}, [1, {}]]
)
def test_a_manifests_field_of_another_kind_is_named(folder, name, value):
    recorded = manifest.new("pick_place", 400, {})
    manifest.write(folder.manifest, {**recorded, name: value})
    if name == "config" and isinstance(value, dict):
        return  # what hyperparameters there are is compared, not read
    with pytest.raises(CommandError, match=rf"manifest.json: {name} is ") as caught:
        manifest.read(folder.manifest)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400


def test_another_configuration_is_refused_naming_what_differs(tmp_path):
    old = manifest.new("pick_place", 400, {"discount": 0.98, "batch_size": 256})
    new = manifest.new("pick_place", 400, {"discount": 0.9, "batch_size": 256})
    manifest.check_same(tmp_path / "manifest.json", old, dict(old))
    with pytest.raises(CommandError, match=r"\(discount is 0.98 there and 0.9 here\)"):
        manifest.check_same(tmp_path / "manifest.json", old, new)
    old["horizons"], new = {"1": [20, 20]}, {**old, "horizons": {"1": [40, 10], "2": [8, 8, 8]}}
    differs = r"\(horizons with 1 subgoal layer\(s\) is \[20, 20\] there and \[40, 10\] here\)"
    with pytest.raises(CommandError, match=differs):
        manifest.check_same(tmp_path / "manifest.json", old, new)


@pytest.mark.parametrize("text", ["{", "[]", "{}", '{"config": 1}'])
def test_a_file_that_is_no_manifest_is_refused(tmp_path, text):
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(CommandError, match="move the folder elsewhere"):
        manifest.read(tmp_path / "manifest.json")
