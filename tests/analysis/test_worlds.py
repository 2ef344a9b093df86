"""Worlds that others made: every folder is shown and judged, whatever its name."""

import shutil

import matplotlib.image
import pytest

from analysis import worlds

CURVES = {
    0: [[0.0, 0.1, 0.2, 0.2]] * 7,
    1: [[0.0, 0.8, 0.9, 0.9 + 0.01 * seed] for seed in range(7)],
}


@pytest.fixture
def folder(make_run):
    """Two worlds; the second has a TD3 agent that is better than all."""
    make_run(CURVES, task="Maze_U-v3_fit")
    data = make_run(CURVES, task="reacher").parent
    td3 = data.parent / f"{data.name}_td3"
    td3.mkdir()
    strong = make_run({0: [[0.0, 1.0, 1.0, 1.0]] * 7}, task="strong")
    shutil.move(strong, td3 / "reacher")
    results = td3 / "reacher" / "results.csv"
    results.write_text(results.read_text().replace("strong", "reacher"))
    return data


def test_all_worlds_are_printed_and_judged_against_the_strongest_flat_agent(folder, capsys):
    assert worlds.main(["", "--data", str(folder), "--output", str(folder / "shown")]) == 0
    printed = capsys.readouterr().out
    assert (folder / "shown" / "worlds.md").read_text() in printed
    lines = [line for line in printed.splitlines() if line.startswith("- ")]
    assert [line.partition(",")[0] for line in lines] == ["- Maze U-v3", "- Reacher"]
    assert "it helps" in lines[0] and "TD3" not in lines[0]
    assert "it loses" in lines[1] and "TD3+HER" in lines[1]
    assert printed.count("| reacher |") == 3 and "TD3+HER, without" in printed
    assert matplotlib.image.imread(folder / "shown" / "worlds.png").std() > 0.05


def test_a_panel_for_each_world_with_its_td3_curve(folder):
    found = worlds.load_worlds(folder)
    maze, reacher = worlds.draw(found, worlds.load_td3(folder)).axes
    assert (maze.get_title(), reacher.get_title()) == ("Maze U-v3", "Reacher")
    assert (len(maze.lines), len(reacher.lines)) == (2, 3)
    more = worlds.draw({**found, "third": found["reacher"], "fourth": found["reacher"]}, {}).axes
    assert [ax.axison for ax in more] == [True] * 4 + [False] * 2  # two rows of three


def test_a_folder_without_worlds_is_refused_in_one_line(tmp_path, capsys):
    assert worlds.main(["", "--data", str(tmp_path)]) == 2
    assert "holds no run folders" in capsys.readouterr().err
