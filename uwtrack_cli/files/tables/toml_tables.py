"""TOML files read with care: size and syntax. Keys and values: `data.options`."""

import re
import tomllib
from pathlib import Path
from typing import Any

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.checks import check_readable
from uwtrack_cli.files.input_ledger import as_input

MAX_BYTES = 1 << 20
"""Largest TOML file that is read; those written by people are far smaller."""

MAX_KEY_PARTS = 32
"""Most parts of a dotted key; the parser's memory grows with their square."""

STRINGS = re.compile(r'"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'')
KEYS = re.compile(r"[=,{}\n]")
"""What stands between two of these is a key, a number or a string."""


def read_toml(path: Path) -> dict[str, Any]:
    """Return the contents of a TOML file.

    Raises
    ------
    DataError
        The file is missing, too large, or no TOML.
    """
    check_readable(path)
    if path.stat().st_size > MAX_BYTES:
        raise DataError(f"{path} is larger than {MAX_BYTES} bytes; that is no settings file.")
    try:
        return parse_toml(as_input(path).read_text(encoding="utf-8-sig"))
    except (DataError, UnicodeDecodeError) as error:
        is_text = isinstance(error, DataError)
        why = f"{error}" if is_text else "it is no text in UTF-8"
        raise DataError(f"{path} is no valid TOML: {why}.") from error


def parse_toml(content: str) -> dict[str, Any]:
    """Return what TOML text says; memory grows with its length, and no faster.

    Raises
    ------
    DataError
        No TOML, or larger, deeper or with longer numbers than a settings file has;
        the message tells the reason alone.
    """
    if len(content) > MAX_BYTES:
        raise DataError(f"it is longer than {MAX_BYTES} characters")
    for part in KEYS.split(STRINGS.sub('""', content)):
        if part.count(".") >= MAX_KEY_PARTS and not part.lstrip().startswith("#"):
            raise DataError(f"a key has more than {MAX_KEY_PARTS} parts")
    try:
        return tomllib.loads(content)
    except RecursionError as error:
        raise DataError("it is nested too deeply") from error
    except tomllib.TOMLDecodeError as error:
        raise DataError(str(error)) from error
    except ValueError as error:  # Python's limit on digits
        raise DataError("a number has thousands of digits") from error
