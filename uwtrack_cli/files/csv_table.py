"""CSV tables of measurements, read with care for what people's tables look like.

**Conventions.** The first line that is neither empty nor a comment (``#``) names the
columns; names are compared in lower case, with underscores for spaces. Comma,
semicolon and tab are understood as separators. Every error names its line.
"""

import csv
import difflib
import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn
from warnings import warn

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.errors import DataError, UwtrackWarning
from uwtrack_cli.files.checks import check_readable

MAX_BYTES = 1 << 26
"""Largest table that is read as a whole."""

ALIASES = {
    "timestamp": "time_utc", "datetime": "time_utc", "utc": "time_utc",
    "lat": "latitude", "latitude_deg": "latitude", "lon": "longitude",
    "long": "longitude", "longitude_deg": "longitude",
}  # fmt: skip
"""Other names of a column that leave no doubt about its unit."""


@dataclass(frozen=True)
class Table:
    """Cells of a table by column, and the line that each row stood in."""

    path: Path
    cells: Mapping[str, list[str]]
    lines: list[int]

    def __contains__(self, name: object) -> bool:
        """Tell whether the table has a column."""
        return name in self.cells

    def fail(self, row: int, reason: str) -> NoReturn:
        """Refuse a row, by its line in the file."""
        msg = f"{self.path}, line {self.lines[row]}: {reason}"
        raise DataError(msg)

    def need(self, *names: str) -> None:
        """Refuse the table unless it has all of these columns."""
        missing = [name for name in names if name not in self.cells]
        if missing:
            msg = (
                f"{self.path} lacks the column {', '.join(missing)}; "
                f"it has: {', '.join(self.cells)}."
            )
            raise DataError(msg)

    def numbers(
        self,
        name: str,
        low: float = -np.inf,
        high: float = np.inf,
        *,
        may_miss: bool = False,
    ) -> FloatArray:
        """Return a column of finite numbers within limits.

        Parameters
        ----------
        name
            The column.
        low
            Least value accepted.
        high
            Greatest value accepted.
        may_miss
            Whether a cell may be empty or nan.
        """
        values = np.full(len(self.lines), np.nan)
        for row, cell in enumerate(self.cells[name]):
            if may_miss and cell.lower() in {"", "nan", "null", "none"}:
                continue
            try:
                values[row] = float(cell)
            except ValueError:
                self.fail(row, f"{name} must be a number, got {cell!r}.")
            if not (np.isfinite(values[row]) and low <= values[row] <= high):
                limits = f" from {low:g} to {high:g}" if np.isfinite(low) else ""
                self.fail(row, f"{name} must be a finite number{limits}, got {cell}.")
        return values

    def contacts(self) -> IntArray:
        """Return the contact of every row; 1 where the table does not say."""
        if "contact" not in self.cells:
            return np.ones(len(self.lines), np.int64)
        values = self.numbers("contact", 1.0, 2.0**53)
        for row in np.flatnonzero(values != np.floor(values))[:1]:
            self.fail(row, f"contact must be a whole number, got {values[row]}.")
        return values.astype(np.int64)

    def check_known(self, known: Iterable[str]) -> None:
        """Refuse columns that look misspelt, and name those that are not used."""
        known = list(known)
        unused = [name for name in self.cells if name not in known]
        for name in unused:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.8)
            if near:
                msg = f"{self.path}: unknown column {name!r}; did you mean {near[0]!r}?"
                raise DataError(msg)
        if unused:
            msg = f"{self.path}: columns not used: {', '.join(unused)}."
            warn(msg, UwtrackWarning, stacklevel=3)


def read_table(path: Path, rename: Mapping[str, str] | None = None) -> Table:
    """Read the cells of a CSV file.

    Parameters
    ----------
    path
        The file, UTF-8, with or without a byte-order mark.
    rename
        Names for the columns of the file, by their own names.

    Raises
    ------
    DataError
        The file is missing, too large, no text, or not a table.
    """
    check_readable(path)
    if path.stat().st_size > MAX_BYTES:
        msg = f"{path} is larger than {MAX_BYTES >> 20} MB; split it."
        raise DataError(msg)
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(_rows(file))
    except (UnicodeDecodeError, csv.Error) as error:
        msg = f"{path} is no CSV table ({error})."
        raise DataError(msg) from error
    if not rows:
        msg = f"{path} holds no table: there is no line with column names."
        raise DataError(msg)
    names = _names(path, rows[0][1], rename or {})
    for line, cells in rows[1:]:
        if len(cells) != len(names):
            msg = f"{path}, line {line}: {len(cells)} cells, {len(names)} columns."
            raise DataError(msg)
    if len(rows) == 1:
        msg = f"{path} has column names, but no rows."
        raise DataError(msg)
    columns = zip(*(cells for _, cells in rows[1:]), strict=True)
    by_name = dict(zip(names, map(list, columns), strict=True))
    return Table(path, by_name, [line for line, _ in rows[1:]])


def _rows(file: Iterable[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield the cells of every line that is neither empty nor a comment."""
    numbered = (
        (line, text)
        for line, text in enumerate(file, 1)
        if text.strip() and not text.lstrip().startswith("#")
    )
    first = next(numbered, None)
    if first is None:
        return
    delimiter = max(",;\t", key=first[1].count)
    for line, text in itertools.chain([first], numbered):
        cells = next(csv.reader([text], delimiter=delimiter, strict=True), [])
        yield line, [cell.strip() for cell in cells]


def _names(path: Path, header: list[str], rename: Mapping[str, str]) -> list[str]:
    plain = [rename.get(name, name) for name in header]
    plain = ["_".join(name.strip().lower().split()) for name in plain]
    names = [ALIASES.get(name, name) for name in plain]
    for name in names:
        if not name or names.count(name) > 1:
            msg = f"{path}: column {name!r} is empty or named twice: {header}."
            raise DataError(msg)
    return names
