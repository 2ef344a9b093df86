"""The frame of html pages: templates, and figures as pictures inside the page."""

import base64
import io
import re
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple
from urllib.parse import quote

import jinja2
from matplotlib.figure import Figure

from analysis.reading import paper

_TEMPLATES = jinja2.Environment(
    loader=jinja2.FileSystemLoader(Path(__file__).with_name("templates")),
    autoescape=True,  # folders, tasks and manifests can hold anything
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_TEMPLATES.filters["urlpath"] = quote
_TEMPLATES.filters["stem"] = lambda path: PurePosixPath(path).stem
_TEMPLATES.filters["agent"] = lambda path: _agent_of(PurePosixPath(path).stem)


def _agent_of(stem: str) -> str:
    """Whose a video or replay is, from its name; the name, where it says no agent."""
    found = re.search(r"_(\d+)layers$", stem)
    return f"the agent with {paper.agent_name(int(found[1]))}" if found else stem


_WIDE = 7.0  # inches: wider pictures cannot be read in the width of a phone


class Picture(NamedTuple):
    """A picture, in words for those who do not see it, and what it shows."""

    source: str
    description: str
    caption: str
    inches: float  # wide

    @property
    def wide(self) -> bool:
        """Whether it keeps its size on a phone, and moves sideways there."""
        return self.inches > _WIDE

    @classmethod
    def of(cls, figure: Figure, description: str, caption: str, dpi: int) -> "Picture":
        """The figure as a png inside the page."""
        png = io.BytesIO()
        figure.savefig(png, format="png", dpi=dpi)
        data = base64.b64encode(png.getvalue()).decode()
        inches = round(figure.get_figwidth(), 1)
        return cls(f"data:image/png;base64,{data}", description, caption, inches)


def render(template: str, **values: Any) -> str:
    """A whole document; what is not markup in the template is escaped."""
    return _TEMPLATES.get_template(template).render(**values)
