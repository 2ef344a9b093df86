"""How Sphinx builds these pages: `make docs` leaves them in build/docs."""

import re
import tomllib
from pathlib import Path

_PYPROJECT = Path(__file__).parents[1] / "pyproject.toml"

project = "HAC suite"
author = "the HAC suite's contributors"
release = version = tomllib.loads(_PYPROJECT.read_text())["project"]["version"]

extensions = ["myst_nb"]
exclude_patterns = ["**/.ipynb_checkpoints"]

html_theme = "furo"
html_title = project

myst_heading_anchors = 3  # for links such as concepts.md#glossary

# `docs/notebooks` links to `analysis/notebooks`, whose outputs are stored in the files: a test runs
# them, a build only shows them.
nb_execution_mode = "off"


def _link_within(app, docname, source):
    """Links that work where the code is browsed, as they must be here.

    Notebooks are pages below `notebooks`; other Markdown outside of docs is no page but a file.
    """
    notebook = re.compile(r"\[([^\]]+)\]\(\.\./analysis/notebooks/(\w+)\.ipynb\)")
    other_markdown = re.compile(r"\]\((\.\./[^)#]+\.md)\)")
    text = notebook.sub(r"{doc}`\1 </notebooks/\2>`", source[0])
    source[0] = other_markdown.sub(r"](path:\1)", text)


def setup(app):
    app.connect("source-read", _link_within)
