"""results.csv is read whole, or refused in words that name the fault."""

import warnings
from pathlib import Path

import pandas as pd
import pytest

from analysis.reading import grid, results, schema
from analysis.reading.results import load

CURVES = {0: [[0.0, 0.25]], 1: [[0.0, 0.5], [0.25, 1.0]]}


def test_reads_every_row_with_its_types(make_run, make_results):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        results = load(make_run(CURVES))
    expected = make_results(CURVES)
    assert list(results.columns) == list(schema.RESULTS_COLUMNS)
    pd.testing.assert_frame_equal(results, expected, check_dtype=False)
    for column in schema.WHOLE_NUMBERS:
        assert results[column].dtype == "int64"
    assert results["success_rate"].dtype == "float64"
    assert results["level2_q_mean"].isna().all()


def test_takes_a_file_a_folder_or_several(make_run):
    first = make_run(CURVES)
    second = make_run(CURVES, task="ur5_reacher")
    assert len(load(first / "results.csv")) == 6
    both = load([first, second / "results.csv"])
    assert both["task"].value_counts().to_dict() == {"pick_place": 6, "ur5_reacher": 6}


def test_rows_come_sorted_whatever_their_order(make_run):
    folder = make_run(CURVES)
    path = folder / "results.csv"
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header, *reversed(rows)]) + "\n")
    keys = load(folder)[list(schema.KEY)]
    assert keys.equals(keys.sort_values(list(schema.KEY), ignore_index=True))


@pytest.mark.parametrize("cut", [1, 5, 60])
def test_a_cut_last_line_is_dropped_with_a_warning(make_run, cut):
    folder = make_run(CURVES)
    path = folder / "results.csv"
    path.write_text(path.read_text()[:-cut])
    with pytest.warns(UserWarning, match=r"results\.csv: the last line .* incomplete"):
        results = load(folder)
    assert len(results) == 5
    assert not ((results["seed"] == 1) & (results["period"] == 1)).any()


def test_extra_columns_are_kept(make_run):
    folder = make_run(CURVES)
    table = pd.read_csv(folder / "results.csv").assign(level3_q_mean=-1.5, note="a, b")
    table.to_csv(folder / "results.csv", index=False)
    results = load(folder)
    assert (results["level3_q_mean"] == -1.5).all()
    assert (results["note"] == "a, b").all()


def test_windows_line_ends_and_blank_lines_are_read(make_run):
    folder = make_run(CURVES)
    path = folder / "results.csv"
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n") + b"\r\n")
    assert len(load(folder)) == 6


@pytest.mark.parametrize("folder", sorted(grid.FOLDER.glob("*/")), ids=lambda path: path.name)
def test_the_quick_reading_equals_the_careful_one(folder, monkeypatch):
    monkeypatch.setattr(results, "_PART", 20_000)  # several parts
    found = load(folder)
    monkeypatch.setattr(results, "_load_file", results._load_lines)
    pd.testing.assert_frame_equal(found, load(folder), check_exact=True)


def test_a_large_table_is_read_quickly_only(make_run, monkeypatch):
    monkeypatch.setattr(results, "_load_lines", None)
    assert len(load(make_run(CURVES))) == 6


@pytest.mark.parametrize(
    "changed",
    [
        lambda line: line.rsplit(",", 1)[0],
        lambda line: f"{line},1",
        lambda line: f'"{line}"',
        lambda line: f"{line}\r",
        lambda line: f"{line}\n",
        lambda line: f"{line}x",
    ],
    ids=["short", "long", "quoted", "windows", "blank", "words"],
)
def test_what_is_unusual_is_not_read_quickly(make_run, changed):
    path = make_run(CURVES) / "results.csv"
    *lines, last = path.read_text().splitlines()
    path.write_text("\n".join([*lines, changed(last)]) + "\n")
    with pytest.raises(ValueError):
        results._read_plain(path)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=f"{tmp_path}.*results.csv: no results.csv"):
        load(tmp_path)
    with pytest.raises(ValueError, match="no run folder given"):
        load([])


def _error(path: Path, text: str | bytes) -> str:
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(ValueError, match=str(path)) as raised:
        load(path)
    return str(raised.value)


@pytest.mark.filterwarnings("ignore:.*cut short")
def test_files_without_a_row_say_so(make_run):
    path = make_run(CURVES) / "results.csv"
    header, first, *_ = path.read_text().splitlines()
    for text in ("", "\n", header[:30], header, header + "\n", f"{header}\n{first}"):
        assert "holds no results" in _error(path, text)


def test_missing_columns_are_all_named(make_run):
    path = make_run(CURVES) / "results.csv"
    table = pd.read_csv(path).drop(columns=["seed", "success_rate"])
    assert "lacks the column(s) seed, success_rate" in _error(path, table.to_csv(index=False))


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("success_rate", "1.5", "success_rate is '1.5', not a rate from 0 to 1"),
        ("success_rate", "", "success_rate is '', not a rate"),
        ("success_rate", "good", "success_rate is 'good', not a number"),
        ("seed", "1.5", "seed is '1.5', not a whole number"),
        ("period", "-1", "period is '-1', not a whole number"),
        ("period", "inf", "period is 'inf', not a whole number"),
        ("train_episodes", "1e300", "train_episodes is '1e300', not a whole number"),
        ("level1_q_mean", "x", "level1_q_mean is 'x', not a number"),
        ("level1_achieved", "200", "level1_achieved is '200', not empty or a share of 1"),
        ("task", " ", "task is ' ', not a task's name"),
    ],
)
def test_impossible_values_are_named_with_their_line(make_run, column, value, words):
    path = make_run(CURVES) / "results.csv"
    table = pd.read_csv(path, dtype=str, keep_default_na=False)
    table.loc[2, column] = value
    message = _error(path, table.to_csv(index=False))
    assert "line 4" in message
    assert words in message


def test_a_line_of_another_length_is_named(make_run):
    path = make_run(CURVES) / "results.csv"
    lines = path.read_text().splitlines()
    lines[3] = lines[3].rsplit(",", 2)[0]
    columns = len(schema.RESULTS_COLUMNS)
    wrong = f"line 4: {columns - 2} values where the header names {columns} columns"
    assert wrong in _error(path, "\n".join(lines) + "\n")


def test_a_repeated_header_or_column_is_refused(make_run):
    path = make_run(CURVES) / "results.csv"
    header, *rows = path.read_text().splitlines()
    doubled = "\n".join([header, rows[0], header, *rows[1:]]) + "\n"
    assert "line 3: subgoal_layers is 'subgoal_layers'" in _error(path, doubled)
    twice = "\n".join(f"{line},{line.split(',')[1]}" for line in [header, *rows]) + "\n"
    assert "names the column(s) subgoal_layers twice" in _error(path, twice)


@pytest.mark.filterwarnings("ignore:.*cut short")
@pytest.mark.parametrize("content", [b"\x89PNG\xff\xfe\n", b"\x00\x00\n", b'"open\nquote\n'])
def test_what_is_no_table_is_refused(tmp_path, content):
    _error(tmp_path / "results.csv", content)


def test_doubled_rows_are_refused(make_run):
    folder = make_run(CURVES)
    with pytest.raises(ValueError, match="pick_place, 0 subgoal layers, seed 0, period 0"):
        load([folder, folder])
    path = folder / "results.csv"
    path.write_text(path.read_text() + path.read_text().splitlines()[-1] + "\n")
    with pytest.raises(ValueError, match="1 subgoal layer, seed 1, period 1; was"):
        load(folder)


@pytest.mark.parametrize(
    ("config", "of_no_layer", "of_one"),
    [
        ('{"updates_per_episode": 20, "upper_updates_per_episode": 10}', 20, 30),
        ('{"updates_per_episode": 20}', 20, 40),
        ("[]", 20, 40),  # nobody says: as by default, so that folders can be compared
    ],
)
def test_updates_are_those_of_all_levels(make_run, config, of_no_layer, of_one):
    folder = make_run(CURVES)
    (folder / "manifest.json").write_text(f'{{"config": {config}}}')
    found = results.with_updates(load(folder), folder)
    ratio = found["updates"] / found["train_episodes"]
    last = ratio[found["period"] == 1].groupby(found["subgoal_layers"]).first()
    assert last.tolist() == [of_no_layer, of_one]
