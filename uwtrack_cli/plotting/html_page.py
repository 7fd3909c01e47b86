"""Pieces of a page in HTML: text that cannot take effect, tables, pictures inside.

**Conventions.** Pictures are inlined as data, each in a rendering for wide screens and
paper and one for telephones; a page has no script and refers to no address. All text
that comes from a file is escaped.
"""

import base64
import io
from collections.abc import Sequence
from importlib import resources
from string import Template
from typing import TYPE_CHECKING

from uwtrack_cli.files.text_escaping import html_text
from uwtrack_cli.plotting.page import DPI

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def page_html(title: str, body: Sequence[str], footer: str) -> str:
    """Return a whole page.

    ``title``: its title, any text. ``footer``: its last line, any text.
    """
    source = resources.files("uwtrack_cli.plotting") / "report.html"
    return Template(source.read_text(encoding="utf-8")).substitute(
        title=html_text(title), body="\n".join(body), footer=html_text(footer)
    )


def table_html(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table that scrolls by itself where it is too wide."""
    lines = [_cells("th", heads), *(_cells("td", row) for row in rows)]
    body = "\n".join(f"<tr>{line}</tr>" for line in lines)
    return f'<div class="wide"><table>\n{body}\n</table></div>'


def _cells(tag: str, texts: Sequence[str]) -> str:
    return "".join(f"<{tag}>{html_text(text)}</{tag}>" for text in texts)


def list_html(texts: Sequence[str], kind: str = "") -> str:
    """Return texts as a list, empty for none."""
    if not texts:
        return ""
    mark = f' class="{kind}"' if kind else ""
    items = "".join(f"<li>{html_text(text)}</li>" for text in texts)
    return f"<ul{mark}>{items}</ul>"


def facts_html(facts: Sequence[tuple[str, str]]) -> str:
    """Return names and values side by side."""
    rows = (
        f"<div><dt>{html_text(name)}</dt><dd>{html_text(value)}</dd></div>"
        for name, value in facts
    )
    return f"<dl>{''.join(rows)}</dl>"


def folded_html(title: str, body: str) -> str:
    """Return a part that is opened by a click."""
    return f"<details><summary>{html_text(title)}</summary>\n{body}\n</details>"


def picture_html(wide: "Figure", narrow: "Figure", text: str) -> str:
    """Return a picture in two renderings; the text is for who cannot see it."""
    return (
        f'<picture><source media="(max-width: 40rem)" srcset="{_data(narrow)}">'
        f'<img alt="{html_text(text)}" src="{_data(wide)}"></picture>'
    )


def _data(figure: "Figure") -> str:
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=DPI)
    return f"data:image/png;base64,{base64.b64encode(picture.getvalue()).decode()}"
