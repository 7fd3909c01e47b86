"""Tolerances from a TOML file: how close two results, or a result and truth, must be.

**Conventions.** One table per container, one key per quantity. For `diff` a quantity
has ``rtol`` and ``atol``; for `score` it has ``error`` (in its unit), ``percent`` and
``sigmas``, each an upper limit on the magnitude. ``[encounters] missed`` and ``false``
limit how many encounters may be missed or invented.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

from uwtrack_cli.errors import OptionError
from uwtrack_cli.files.toml_tables import Number, check_keys, number, read_toml

ANY_MAGNITUDE = Number(0.0, 1e300, "zero or more")
COUNTS = ("missed", "false")
L = TypeVar("L", "Closeness", "Limits")


@dataclass(frozen=True)
class Closeness:
    """Two numbers agree when they differ by at most ``atol + rtol * magnitude``."""

    rtol: float = 0.0
    atol: float = 0.0


@dataclass(frozen=True)
class Limits:
    """Most that an estimate may be off: in its unit, in percent, in deviations."""

    error: float | None = None
    percent: float | None = None
    sigmas: float | None = None

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
    missed: int | None = None
    false: int | None = None


def read_closeness(path: Path) -> dict[str, dict[str, Closeness]]:
    """Read the tolerances of a comparison, by container and quantity.

    Raises
    ------
    DataError
        The file is missing or no TOML, or a tolerance is no number from 0.
    OptionError
        A container is no table of quantities.
    """
    return {
        name: {
            key: _entry(Closeness, value, f"{path}: {name}.{key}")
            for key, value in table.items()
        }
        for name, table in _tables(path).items()
    }


def read_requirements(path: Path) -> Requirements:
    """Read what a score must meet.

    Raises
    ------
    DataError
        The file is missing or no TOML, or a limit is no number from 0.
    OptionError
        A container is no table of quantities.
    """
    tables = _tables(path)
    counts = {
        key: int(number(tables["encounters"], key, ANY_MAGNITUDE, f"{path}"))
        for key in COUNTS
        if key in tables.get("encounters", {})
    }
    limits = {
        name: {
            key: _entry(Limits, value, f"{path}: {name}.{key}")
            for key, value in table.items()
            if key not in COUNTS
        }
        for name, table in tables.items()
    }
    return Requirements(limits, **counts)


def _tables(path: Path) -> dict[str, dict[str, Any]]:
    content = read_toml(path)
    for name, table in content.items():
        if not isinstance(table, dict):
            msg = f"{path}: give one table per container, such as [encounters], "
            msg += f"not {name} = {table!r}."
            raise OptionError(msg)
    return content


def _entry(kind: type[L], value: Any, where: str) -> L:
    known = [field.name for field in fields(kind)]
    if not isinstance(value, dict):
        msg = f"{where} must be a table with {', '.join(known)}, got {value!r}."
        raise OptionError(msg)
    check_keys(value, known, where)
    return kind(**{key: number(value, key, ANY_MAGNITUDE, where) for key in value})
