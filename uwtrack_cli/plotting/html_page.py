"""A page in HTML from its template: text, tables and pictures, in one file.

**Conventions.** What a page says stands in its template: `report.html` of a product,
`deployment.html` of a folder, both from `page.html`. A picture is inlined as data, in a
rendering for wide screens and paper and one for telephones, with a text for who cannot
see it; a page has no script and refers to no address but pages beside it. All text is
escaped where it stands.
"""

import base64
from collections.abc import Callable
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, PackageLoader
from matplotlib.figure import Figure

from uwtrack_cli import __version__
from uwtrack_cli.files.tables.json_rows import Row
from uwtrack_cli.files.text_escaping import plain_text
from uwtrack_cli.files.utc import format_utc
from uwtrack_cli.plotting.page import png_of
from uwtrack_cli.plotting.page_layout import alternative_text
from uwtrack_cli.plotting.passage_words import passage_title
from uwtrack_cli.plotting.style import NARROW_IN, WIDE_IN, contact_color, text_on
from uwtrack_cli.plotting.view import Units, View


def page_html(template: str, **said: Any) -> str:
    """Return a whole page of what its template names; any text is accepted."""
    pages = Environment(
        loader=PackageLoader("uwtrack_cli.plotting", "."), autoescape=True,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
        finalize=lambda value: plain_text(value) if type(value) is str else value,
    )  # fmt: skip
    pages.filters["utc"] = format_utc
    return pages.get_template(template).render(version=__version__, **said)


def picture_of_page(
    draw: Callable[[View], Figure], units: Units = "kn", text: str = ""
) -> dict[str, str]:
    """Return a picture, drawn for each of two widths.

    ``text``: what it shows, unless the picture itself says so.
    """
    found: dict[str, str] = {}
    for name, width_in in (("narrow", NARROW_IN), ("wide", WIDE_IN)):
        view = View(width_in=width_in, units=units, stands_alone=False)
        figure = draw(view)
        found |= {name: png_data(figure), "text": text or alternative_text(figure)}
        for image in [image for ax in figure.axes for image in ax.images]:
            image.remove()  # they are large, and a figure is collected late
    return found


def png_data(figure: Figure, dpi: float = 110) -> str:
    """Return a picture as the address of itself."""
    return data_address("image/png", png_of(figure, dpi))


def data_address(kind: str, content: bytes) -> str:
    """Return an address that holds its own content."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def anchor_of(row: Row, *, is_alone: bool) -> str:
    """Return the name of the place of a passage on a page.

    ``is_alone``: whether one sensor heard all passages: the others number their own.
    """
    return f"passage-{row['passage']}" + (
        "" if is_alone else f"-{quote(row['sensor'])}"
    )


def passage_head(row: Row, number: int, units: Units) -> dict[str, Any]:
    """Return number, colour and title of a passage; HTML joins spaces, so dots part it.

    ``row``: the passage, as `json_rows` gives it.
    """
    color, title = contact_color(number), passage_title(row, units)
    title = title.replace("   ", " \u00b7 ")
    return {"number": number, "color": color, "ink": text_on(color), "title": title}
