"""Makes one static folder of the published results and the docs: `make site`."""

import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from absl import flags

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

    from launch.asking import start

    start.without_display()

from analysis import program
from analysis.program import CommandError
from analysis.reading import files, grid, names, paper
from analysis.report.index import write_index
from analysis.report.run_report import write_report
from hac_suite import policy_files
from launch import publish
from launch.folder import policies
from launch.folder.layout import RunFolder
from launch.pictures import replay
from launch.pictures.video import RenderingError

_HELP = """Makes a static web site of the published results and, if they are built, the docs.

  python launch/site.py --output=build/site --docs=build/docs
  python -m http.server --directory build/site

`make site` builds the docs first. index.html leads to a report for each task, with the 3-D replay
of each agent's published policy, and to the docs. Any web server can serve the folder.

Flags:
{flags}

Exit status: 0 done; 2 the command was wrong, or a file to read is missing or damaged."""

_DOCS = "docs"


def main(argv: Sequence[str]) -> int:
    """Carries out a command; returns the exit status that --help states."""
    values = _flags()
    return program.carry_out(program.Program(_HELP, values), argv, lambda _: _build(values))


def _flags() -> flags.FlagValues:
    values = flags.FlagValues()
    flags.DEFINE_string("output", "build/site", "folder to write, or to replace", values)
    publish.define_places(values)
    flags.DEFINE_string(
        "docs", None, "folder with the docs as web pages; empty: a site without docs", values
    )
    return values


def _build(values: flags.FlagValues) -> None:
    docs = Path(values.docs) if values.docs else None
    print(build(Path(values.output), Path(values.data), Path(values.policies), docs))


def build(output: Path, data: Path, chosen: Path, docs: Path | None) -> Path:
    """Makes the site and returns the path of its first page.

    Raises:
      CommandError: the output is a folder of other things, or the docs are not there.
      ValueError: there are no published results, or they are damaged.
    """
    if docs is not None and not (docs / "index.html").is_file():
        raise CommandError(f"{docs}: holds no docs as web pages; run `make docs` to build them")
    if any(output.glob("*")) and not (output / "index.html").is_file():
        raise CommandError(f"{output}: holds files that are no site; give another --output")
    found = policies.find(chosen)
    results = grid.load_grid(data)  # before anything is made
    with files.swapping(output) as site:
        for old in site.iterdir():
            shutil.rmtree(old) if old.is_dir() else old.unlink()
        for task in results:
            own = [policy for policy in found if policy.task == task]
            _run_folder(RunFolder(site, task), data / task, own)
        links = {}
        if docs is not None:
            shutil.copytree(docs, site / _DOCS, ignore=shutil.ignore_patterns(".*", "_sources"))
            links["Documentation"] = f"{_DOCS}/index.html"
            links["What they show, and what is known against them"] = f"{_DOCS}/results.html"
        write_index(site, title="HAC suite: published results", links=links)
    return output / "index.html"


def _run_folder(folder: RunFolder, data: Path, own: Sequence[policies.Found]) -> None:
    """The published results of a task as a run folder, with replays and a report."""
    print(f"{paper.title(folder.task)}: {len(own)} replays, and the report", flush=True)
    shutil.copytree(data, folder.path, ignore=shutil.ignore_patterns(names.REPORT))
    folder.policies.mkdir()
    for policy in own:
        for file in policy_files.paths(policy.path):
            files.put(file, folder.policies)
        folder.replays.mkdir(exist_ok=True)
        try:
            replay.render([policy.path], folder.replay(policy.subgoal_layers))
        except RenderingError as error:
            raise CommandError(str(error)) from error
    write_report(folder.path)


if __name__ == "__main__":
    sys.exit(main(sys.argv))
