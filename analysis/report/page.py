"""The parts of an html page: escaped text, tables, embedded pictures, and the frame round them."""

import base64
import html
import io
from collections.abc import Iterable, Sequence
from urllib.parse import quote

from matplotlib.figure import Figure

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; max-width: 62rem; margin: 2rem auto;
       padding: 0 1rem; }
h1 { margin-bottom: 0; } h2 { margin-top: 2.2rem; border-bottom: 1px solid #ddd; }
img, video { max-width: 100%; height: auto; }
table { border-collapse: collapse; }
caption { caption-side: bottom; text-align: left; color: #555; }
th, td { padding: .3rem .8rem; border-bottom: 1px solid #ddd; }
th, td { text-align: left; vertical-align: top; }
td { font-variant-numeric: tabular-nums; overflow-wrap: anywhere; }
pre { background: #f4f4f4; padding: .8rem; overflow-x: auto; }
figure { margin: 1rem 0; } figcaption, .note { color: #555; }
.videos { display: grid; grid-template-columns: repeat(auto-fit, minmax(18rem, 1fr)); gap: 1rem; }
"""


def text(value: object) -> str:
    """`value` as text that no browser takes for markup, in attributes either."""
    return html.escape(str(value), quote=True)


def page(title: str, body: Iterable[str]) -> str:
    """A whole document. `title` is escaped here; `body` is markup already."""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{text(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )


def table(header: Sequence[object], rows: Iterable[Sequence[object]], caption: str = "") -> str:
    """A table of escaped cells."""
    lines = ["<table>", f"<caption>{text(caption)}</caption>"]
    lines.append("<tr>" + "".join(f"<th>{text(cell)}</th>" for cell in header) + "</tr>")
    lines += ["<tr>" + "".join(f"<td>{text(cell)}</td>" for cell in row) + "</tr>" for row in rows]
    return "\n".join([*lines, "</table>"])


def picture(figure: Figure, description: str, dpi: int) -> str:
    """The figure as a png inside the page."""
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=dpi)
    data = base64.b64encode(png.getvalue()).decode()
    return f'<img alt="{text(description)}" src="data:image/png;base64,{data}">'


def link(path: str) -> str:
    """A link to a file below the page's own folder."""
    return f'<a href="{text(quote(path))}">{text(path)}</a>'


def video(path: str) -> str:
    """A player for a file below the page's own folder."""
    return (
        f'<figure><video controls preload="metadata" src="{text(quote(path))}"></video>'
        f"<figcaption>{link(path)}</figcaption></figure>"
    )
