r"""Text of unknown origin, made safe for each kind of output.

**Method.** Names of files, sensors and contacts may hold any character. Characters
that steer a terminal or turn the direction of reading, and what is no text at all
(bytes of a name that is not UTF-8), are written out as ``\u001b``, which JSON reads
back. Then each kind of output has its own marks that must not take effect.

**References.** ECMA-48 (1991), control functions; Unicode Standard Annex 9,
directional formatting; XML 1.0 (2008), section 2.2; OWASP, "CSV Injection".
"""

import re
import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import Any

STEERING = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069"
    "\ud800-\udfff\ufeff\ufffe\uffff]"
)
"""Control characters, marks of direction and line, halves of characters, no text."""

FORMULA = re.compile(r"[=+\-@]")
"""What the first character of a formula is in a spreadsheet."""


def plain_text(text: str) -> str:
    r"""Return text for a terminal, a line of JSON or a tab-separated cell.

    Examples
    --------
    >>> plain_text("a\x1b[31m\n")
    'a\\u001b[31m\\u000a'
    """
    return STEERING.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def csv_cell(value: Any) -> Any:
    """Return a cell that a spreadsheet does not take for a formula.

    An apostrophe before a text that could be one makes it a text. Numbers stay.

    Examples
    --------
    >>> csv_cell("=1+1"), csv_cell("-1.5"), csv_cell(-1.5)
    ("'=1+1", '-1.5', -1.5)
    """
    if not isinstance(value, str):
        return value
    text = plain_text(value)
    may_be_formula = len(text) > 1 and FORMULA.match(text) and not _is_number(text)
    return f"'{text}" if may_be_formula else text


def csv_line(cells: Iterable[Any]) -> str:
    """Return cells as a line of a CSV table, without its end."""
    import csv
    import io

    text = io.StringIO()
    csv.writer(text, lineterminator="").writerow(map(csv_cell, cells))
    return text.getvalue()


def file_name(path: Path) -> str:
    r"""Return the name of a file as text; bytes that are not UTF-8 are written out.

    Examples
    --------
    >>> file_name(Path("a/p\udcff.wav"))
    'p\\udcff.wav'
    """
    return path.name.encode("utf-8", "backslashreplace").decode()


def shell_word(path: Path | str) -> str:
    """Return a path as one word of a command that is told to a person.

    Examples
    --------
    >>> shell_word("my ship.wav"), shell_word("-a.wav"), shell_word("a.wav")
    ("'my ship.wav'", './-a.wav', 'a.wav')
    """
    text = str(path)
    return shlex.quote(f"./{text}" if text.startswith("-") and text != "-" else text)


def xml_text(text: str) -> str:
    """Return text that XML can hold; whoever writes the XML escapes its marks."""
    return plain_text(text)


def figure_text(text: str) -> str:
    r"""Return text for matplotlib, where dollar signs would begin a formula.

    Examples
    --------
    >>> print(figure_text("a$^$b"))
    a\$^\$b
    """
    return plain_text(text).replace("$", r"\$")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
