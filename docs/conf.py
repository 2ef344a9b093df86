"""How Sphinx builds these pages: `make docs` leaves them in build/docs."""

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

myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3  # links such as concepts.md#glossary, as they work where code is hosted

# `docs/notebooks` links to `analysis/notebooks`, whose outputs are stored in the files: a test runs
# them, a build only shows them.
nb_execution_mode = "off"
