"""README, WORKSPACE.md and docs/: what they name exists, and what they say to type works."""

import contextlib
import dataclasses
import functools
import importlib.util
import io
import os
import re
import runpy
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

import hac_suite
from analysis import program
from analysis.reading import schema
from launch.asking import request

ROOT = Path(__file__).resolve().parent.parent
PAGES = ["README.md", "WORKSPACE.md", *(f"docs/{p.name}" for p in sorted(ROOT.glob("docs/*.md")))]
ROOMS = ("analysis", "assets", "docs", "hac_suite", "launch", "tasks", "tests")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

# Pages whose Python runs here, and how long it takes; the others' is compiled.
RUN = [
    "docs/results.md",
    "docs/tuning_log.md",
    "docs/troubleshooting.md",
    "docs/your_own_task.md",
    pytest.param("docs/your_own_environment.md", marks=pytest.mark.slow),
]
_NOT_OURS = {"apt-get", "cd", "export", "git", "pip", "ray"}  # whose words nobody checks here


def text(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def prose(page: str) -> str:
    return re.sub(r"^```.*?^```", "", text(page), flags=re.DOTALL | re.MULTILINE)


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text(page), flags=re.DOTALL | re.MULTILINE)


def code(page: str) -> list[str]:
    """Words of code in running text."""
    return [" ".join(found.split()) for found in re.findall(r"`([^`]+)`", prose(page))]


def typed(page: str) -> Iterator[list[str]]:
    """The words of every command that the page shows."""
    lines = [
        line for block in blocks(page, "bash") for line in block.replace("\\\n", "").split("\n")
    ]
    lines += [found for found in code(page) if found.startswith(("python ", "make "))]
    yield from filter(None, (shlex.split(line, comments=True) for line in lines))


# -- What is named exists


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if link.startswith(("http://", "https://")):
            continue
        name, _, anchor = link.partition("#")
        target = (ROOT / page).parent / name if name else ROOT / page
        assert target.is_file(), f"{page}: {link}"
        if anchor:
            assert anchor in anchors(target), f"{page}: {link}"


def anchors(page: Path) -> set[str]:
    """What links to its headings end with."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES)
def test_files_exist(page):
    for word in code(page):
        if re.fullmatch(rf"({'|'.join(ROOMS)})/[\w./*-]*", word):
            assert list(ROOT.glob(word.rstrip("/"))), f"{page}: {word}"
        elif re.fullmatch(r"\w+\.py", word):
            assert any(next((ROOT / room).rglob(word), None) for room in ROOMS), f"{page}: {word}"


# -- What is to be typed works


@pytest.mark.parametrize("page", PAGES)
def test_commands_are_understood(page, monkeypatch):
    monkeypatch.chdir(ROOT)  # where people type them
    for words in typed(page):
        try:
            check(words)
        except Exception as error:
            raise AssertionError(f"{page}: {shlex.join(words)}: {error}") from error


def check(words: list[str]) -> None:
    program, *rest = words
    if program == "make":
        targets = re.findall(r"^([\w-]+):", text("Makefile"), flags=re.MULTILINE)
        assert rest[0] in targets, f"no target {rest[0]}"
    elif program == "sbatch":
        script = next(index for index, word in enumerate(rest) if not word.startswith("--"))
        assert Path(rest[script]).is_file()
        request.parse(rest[script:])
    elif program == "python" and rest[0] == "-m":
        check_module(rest[1], rest[2:])
    elif program == "python":
        check_file(rest[0], rest[1:])
    elif program in PROJECT.get("scripts", {}):
        function = PROJECT["scripts"][program].partition(":")[2]  # of launch/commands.py
        check_file(f"launch/{function}.py", rest)
    else:
        assert program in _NOT_OURS, "nobody knows how to check this"


def check_module(name: str, words: list[str]) -> None:
    if name == "pip":
        for extras in re.findall(r"\.\[([\w,]+)\]", " ".join(words)):
            assert set(extras.split(",")) <= PROJECT["optional-dependencies"].keys(), extras
        return
    assert importlib.util.find_spec(name), f"no module {name}"
    check_words(name, words)


def check_file(path: str, words: list[str]) -> None:
    assert Path(path).is_file(), f"no file {path}"
    words = [word for word in words if not is_a_readers_own(word)]
    if path == "launch/run.py" and "--help" not in words:
        request.parse([path, *words])
    else:
        check_words(path, words)


def is_a_readers_own(word: str) -> bool:
    """Whether a word names a file that only the reader has, in a form that the pages explain."""
    own = r"--(config\.learner|task)=(path/to/\w+\.py|FILE\.py):\w+"
    begun = r"(--task=)?arm_reach\.py:arm_reach|path/to/\w+\.(xml|py:\w+)|--task=[\w-]+_fit\.toml"
    return bool(re.fullmatch(f"{own}|{begun}", word))


def check_words(program: str, words: list[str]) -> None:
    """Flags are in the program's help, and its input files are there unless a run makes them."""
    names = [word.split("=")[0] for word in words if word.startswith("--")]
    known = help_of(program) if names else ""
    if program == "launch/ablate.py":  # which takes the flags of run.py as well
        known += help_of("launch/run.py")
    for name in names:
        assert re.search(rf"{name}\b", known) or name == "--help", f"no flag {name}"
    for word in words:
        if "/" in word and not word.startswith(("-", "runs/")):
            assert list(ROOT.glob(word.rstrip("/"))), f"no file {word}"


@functools.cache
def help_of(program: str) -> str:
    """What the program, a file or a module, prints for --help."""
    printed, argv, path = io.StringIO(), sys.argv, list(sys.path)
    environment = dict(os.environ)
    sys.argv = [program, "--help"]
    try:
        with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
            if program.endswith(".py"):
                runpy.run_path(str(ROOT / program), run_name="__main__")
            else:
                runpy.run_module(program, run_name="__main__", alter_sys=True)
    finally:
        sys.argv, sys.path[:] = argv, path
        os.environ.clear()
        os.environ.update(environment)
    return printed.getvalue()


@pytest.mark.parametrize("page", PAGES)
def test_flags_of_the_launcher_are_understood(page, monkeypatch):
    monkeypatch.chdir(ROOT)
    # Those of the launcher, or of a program that the page names.
    programs = {"launch/run.py", *re.findall(r"launch/\w+\.py", text(page))}
    known = "".join(help_of(name) for name in sorted(programs) if (ROOT / name).is_file())
    flags = [word for found in code(page) if found.startswith("--") for word in found.split()]
    for flag in flags:
        if is_a_readers_own(flag):
            continue
        name = flag.split("=")[0].replace("--no", "--")
        if flag.startswith(("--config.", "--seeds=", "--T=")) and name != "--config.KEY":
            request.parse(["launch/run.py", flag])
        elif name != "--help":
            assert f"{name.split('.')[0]}=" in known, f"{page}: {flag}"


@pytest.mark.parametrize(
    "wrong",
    [
        "python launch/run.py --sedes=3",
        "python launch/run.py --config.discont=0.9",
        "python launch/run.py --T=7,7,7 --subgoal_layers=0",
        "python launch/play.py --tsk=pick_place",
        "python launch/nothing.py",
        "python -m analysis.figure5 --output_folder=x",
        "python -m analysis.figure6",
        "python -m analysis.table analysis/data/gird/*/",
        "python -m pip install '.[clutser]'",
        "make everything",
        "train --task=pick_place",
    ],
)
def test_a_wrong_command_is_seen(wrong, monkeypatch):
    monkeypatch.chdir(ROOT)
    with pytest.raises((AssertionError, program.CommandError)):
        check(shlex.split(wrong))


@pytest.mark.parametrize("page", PAGES)
def test_python_compiles(page):
    for block in blocks(page, "python"):
        compile(block, page, "exec")


@pytest.mark.parametrize("page", RUN)
def test_python_runs(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "docs"}
    assert blocks(page, "python")
    for block in blocks(page, "python"):
        exec(compile(block, page, "exec"), names)


# -- What is promised about the pages


def test_readme_and_map_are_short():
    assert len(text("README.md").split()) < 900
    assert len(text("WORKSPACE.md").split()) < 900


@pytest.mark.parametrize("page", PAGES)
def test_lines_wrap_at_100(page):
    for number, line in enumerate(text(page).split("\n"), start=1):
        cannot_wrap = line.startswith(("|", "![")) or " " not in line.strip()
        assert len(line) <= 100 or cannot_wrap, f"{page}, line {number}"


def test_every_hyperparameter_is_explained():
    explained = re.findall(r"^\| `(\w+)` \|", text("docs/concepts.md"), flags=re.MULTILINE)
    assert {field.name for field in dataclasses.fields(hac_suite.Config)} <= set(explained)


def test_every_column_is_explained():
    explained = set(code("docs/operations.md"))
    assert {*schema.CORE_COLUMNS, *schema.LATER_COLUMNS, *schema.LEVEL_FIELDS} <= explained


def test_published_files_name_no_folder_of_a_machine():
    absolute = re.compile(r"[\"' =](/[a-z]+/[^\"' ]*)")
    for file in sorted((ROOT / "analysis" / "data").rglob("*.json")):
        assert not absolute.search(file.read_text()), file


def test_the_citation_is_of_this_version():
    citation = yaml.safe_load(text("CITATION.cff"))
    assert citation["version"] == PROJECT["version"]
    assert citation["license"] == PROJECT["license"]
    authors = [author["family-names"] for author in citation["preferred-citation"]["authors"]]
    assert authors == ["Levy", "Platt", "Saenko"]


@pytest.mark.slow
def test_pages_build_without_a_warning(tmp_path):
    pytest.importorskip("sphinx")
    pytest.importorskip("myst_nb")
    built = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "docs", str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stderr
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")}
    assert pages <= {path.stem for path in tmp_path.glob("*.html")}
    notebooks = {path.stem for path in (ROOT / "analysis/notebooks").glob("*.ipynb")}
    assert notebooks == {path.stem for path in (tmp_path / "notebooks").glob("*.html")}
