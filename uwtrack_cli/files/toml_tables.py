"""TOML files read with care: size, syntax, known keys, types and ranges.

**Conventions.** An unknown key is refused and the known ones are listed, because a
misspelt key would otherwise silently leave a default in force.
"""

import difflib
import math
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.checks import check_readable

MAX_BYTES = 1 << 20
"""Largest TOML file that is read; those written by people are far smaller."""


@dataclass(frozen=True)
class Number:
    """A number between two limits, with its unit."""

    low: float
    high: float
    unit: str


def read_toml(path: Path) -> dict[str, Any]:
    """Return the contents of a TOML file.

    Raises
    ------
    DataError
        The file is missing, too large, or no TOML.
    """
    check_readable(path)
    if path.stat().st_size > MAX_BYTES:
        msg = f"{path} is larger than {MAX_BYTES} bytes; that is no settings file."
        raise DataError(msg)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        msg = f"{path} is no valid TOML: {str(error) or type(error).__name__}."
        raise DataError(msg) from error


def check_keys(table: Mapping[str, Any], known: Iterable[str], where: str) -> None:
    """Refuse keys that mean nothing here.

    Raises
    ------
    DataError
        A key is unknown; the known ones are listed.
    """
    known = list(known)
    for key in table:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            msg = f"{where}: unknown key {key!r}.{hint} Known: {', '.join(known)}."
            raise DataError(msg)


def number(table: Mapping[str, Any], key: str, spec: Number, where: str) -> float:
    """Return a number within its limits.

    Raises
    ------
    DataError
        Not a number, not finite, or outside the limits.
    """
    value = table[key]
    if isinstance(value, bool) or not isinstance(value, int | float):
        msg = f"{where}: {key} must be a number ({spec.unit}), got {value!r}."
        raise DataError(msg)
    if not (math.isfinite(value) and spec.low <= value <= spec.high):
        msg = (
            f"{where}: {key} must lie between {spec.low:g} and {spec.high:g} "
            f"{spec.unit}, got {value!r}."
        )
        raise DataError(msg)
    return float(value)


def text(table: Mapping[str, Any], key: str, where: str) -> str:
    """Return a text that is not empty.

    Raises
    ------
    DataError
        Not a text, empty, or with characters that cannot be printed.
    """
    value = table[key]
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        msg = f"{where}: {key} must be a text that is not empty, got {value!r}."
        raise DataError(msg)
    return value


def texts(table: Mapping[str, Any], key: str, where: str) -> list[str]:
    """Return a list of texts; a single text stands for a list of one.

    Raises
    ------
    DataError
        Not a list of texts.
    """
    value = table[key]
    if isinstance(value, str):
        value = [value]
    if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
        msg = f"{where}: {key} must be a list of texts, got {value!r}."
        raise DataError(msg)
    return value
