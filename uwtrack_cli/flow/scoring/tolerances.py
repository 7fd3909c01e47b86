"""Tolerances from a TOML file: how close two results, or a result and truth, must be.

**Conventions.** One table per container, one key per quantity. For `diff` a quantity
has ``rtol`` and ``atol``; for `score` it has ``error`` (in its unit), ``percent`` and
``sigmas``, each an upper limit on the magnitude. ``[encounters] missed`` and ``false``
limit how many encounters may be missed or invented.
"""

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from uwtrack_cli.data.options import AtLeast, AtMost, convert, from_table
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.tables.toml_tables import read_toml

Magnitude = Annotated[float, AtLeast(0), AtMost(1e300)]
Count = Annotated[int, AtLeast(0), AtMost(10**9)]
COUNTS = ("missed", "false")
L = TypeVar("L", "Closeness", "Limits")


@dataclass(frozen=True)
class Closeness:
    """Two numbers agree when they differ by at most ``atol + rtol * magnitude``."""

    rtol: Magnitude = 0.0
    """Allowed difference relative to the larger magnitude."""
    atol: Magnitude = 0.0
    """Allowed absolute difference, in the quantity's unit."""


@dataclass(frozen=True)
class Limits:
    """Most that an estimate may be off: in its unit, in percent, in deviations."""

    error: Magnitude | None = None
    """Largest error, in the quantity's unit; None: any."""
    percent: Magnitude | None = None
    """Largest error in percent of the truth; None: any."""
    sigmas: Magnitude | None = None
    """Largest error in standard deviations; None: any."""

    def excess(self, error: float, percent: float, sigmas: float) -> str:
        """Return which limit is passed; an empty text if none is."""
        found = {"error": error, "percent": percent, "sigmas": sigmas}
        passed = [
            f"{name} {abs(value):.4g} > {limit:g}"
            for name, value in found.items()
            if (limit := getattr(self, name)) is not None and not abs(value) <= limit
        ]
        return ", ".join(passed)


@dataclass(frozen=True)
class Requirements:
    """What a score must meet: limits by container and quantity, and counts."""

    limits: Mapping[str, Mapping[str, Limits]]
    """Limits by container and quantity."""
    missed: int | None = None
    """Most passages that may be missed; None: any number."""
    false: int | None = None
    """Most encounters that may be false; None: any number."""


def read_closeness(path: Path) -> dict[str, dict[str, Closeness]]:
    """Read the tolerances of a comparison, by container and quantity.

    Raises
    ------
    DataError
        The file is missing or no TOML, or a tolerance is no number from 0.
    """
    return _limits(path, _tables(path), Closeness)


def read_requirements(path: Path) -> Requirements:
    """Read what a score must meet.

    Raises
    ------
    DataError
        The file is missing or no TOML, or a limit is no number from 0.
    """
    tables = _tables(path)
    encounters = tables.get("encounters", {})
    given = {key: encounters.pop(key) for key in COUNTS if key in encounters}
    with _of_file(path):
        counts = {key: convert(f"encounters.{key}", Count, value) for key, value in given.items()}
    return Requirements(_limits(path, tables, Limits), **counts)


def _limits(
    path: Path, tables: dict[str, dict[str, Any]], kind: type[L]
) -> dict[str, dict[str, L]]:
    with _of_file(path):
        return {
            name: {key: from_table(kind, value, f"{name}.{key}") for key, value in table.items()}
            for name, table in tables.items()
        }


@contextlib.contextmanager
def _of_file(path: Path) -> Iterator[None]:
    """Name the file in which a value is not accepted."""
    try:
        yield
    except OptionError as error:
        raise DataError(f"{path}: {error}") from error


def _tables(path: Path) -> dict[str, dict[str, Any]]:
    content = read_toml(path)
    for name, table in content.items():
        if not isinstance(table, dict):
            msg = f"{path}: give one section per table, such as [encounters], "
            msg += f"not {name} = {table!r}."
            raise DataError(msg)
    return content
