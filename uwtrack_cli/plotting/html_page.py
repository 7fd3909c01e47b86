"""A page in HTML: blocks of text, tables and pictures, in one file.

**Conventions.** A block is the name of a part of `report.html` and what it shows. A
picture is inlined as data, in a rendering for wide screens and paper and one for
telephones, with a text for who cannot see it; a page has no script and refers to no
address but pages beside it. All text is escaped where it stands.
"""

import base64
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, PackageLoader

from uwtrack_cli.files.text_escaping import plain_text
from uwtrack_cli.plotting.page import png_of
from uwtrack_cli.plotting.page_layout import alternative_text
from uwtrack_cli.plotting.style import NARROW_IN, WIDE_IN

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Block = tuple[str, Any]


def page_html(title: str, blocks: Iterable[Block], footer: str) -> str:
    """Return a whole page.

    ``title``: its title, any text. ``footer``: its last line, any text.
    """
    pages = Environment(
        loader=PackageLoader("uwtrack_cli.plotting", "."), autoescape=True,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
        finalize=lambda value: plain_text(value) if type(value) is str else value,
    )  # fmt: skip
    page = pages.get_template("report.html")
    return page.render(title=title, blocks=list(blocks), footer=footer)


def picture_block(draw: "Callable[[float], Figure]", text: str = "") -> Block:
    """Return a picture that is drawn for each of two widths, inches.

    ``text``: what it shows, unless the picture itself says so.
    """
    wide, narrow = draw(WIDE_IN), draw(NARROW_IN)
    text = text or alternative_text(wide)
    return "picture", {"wide": png_data(wide), "narrow": png_data(narrow), "text": text}


def png_data(figure: "Figure", dpi: float = 110) -> str:
    """Return a picture as the address of itself."""
    return data_address("image/png", png_of(figure, dpi))


def data_address(kind: str, content: bytes) -> str:
    """Return an address that holds its own content."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
