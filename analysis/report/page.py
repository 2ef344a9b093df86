"""The frame of html pages: templates, and figures as pictures inside the page."""

import base64
import io
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple
from urllib.parse import quote

import jinja2
from matplotlib.figure import Figure

_TEMPLATES = jinja2.Environment(
    loader=jinja2.FileSystemLoader(Path(__file__).with_name("templates")),
    autoescape=True,  # folders, tasks and manifests can hold anything
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_TEMPLATES.filters["urlpath"] = quote
_TEMPLATES.filters["stem"] = lambda path: PurePosixPath(path).stem


class Picture(NamedTuple):
    """A picture, in words for those who do not see it, and what it shows."""

    source: str
    description: str
    caption: str

    @classmethod
    def of(cls, figure: Figure, description: str, caption: str, dpi: int) -> "Picture":
        """The figure as a png inside the page."""
        png = io.BytesIO()
        figure.savefig(png, format="png", dpi=dpi)
        data = base64.b64encode(png.getvalue()).decode()
        return cls(f"data:image/png;base64,{data}", description, caption)


def render(template: str, **values: Any) -> str:
    """A whole document; what is not markup in the template is escaped."""
    return _TEMPLATES.get_template(template).render(**values)
