"""CSV tables of measurements, read with care for what people's tables look like.

**Conventions.** The first line that is neither empty nor a comment (``#``) names the
columns; names are compared in lower case, with underscores for spaces. Comma,
semicolon and tab are understood as separators. Every error names its line.
"""

import contextlib
import csv
import difflib
import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import Cells, Column, Container, FloatArray, IntArray
from uwtrack_cli.data.options import shown
from uwtrack_cli.errors import DataError, note, warn
from uwtrack_cli.files.checks import check_readable
from uwtrack_cli.files.input_ledger import as_input
from uwtrack_cli.files.utc import parse_utc

MAX_BYTES = 1 << 26
"""Largest table that is read as a whole."""
MAX_CELLS = 4_000_000
"""Most cells of a table: the columns of a day at ten rows a second."""
MAX_COLUMNS = 1000
"""Most columns of a table."""
MAX_KNOWN = 10_000
"""Different cells that are looked out for, to keep equal ones once."""
MAX_NAMED = 20
"""Most columns that a sentence names."""

ALIASES = {
    "timestamp": "time_utc", "datetime": "time_utc", "utc": "time_utc",
    "lat": "latitude", "latitude_deg": "latitude", "lon": "longitude",
    "long": "longitude", "longitude_deg": "longitude",
}  # fmt: skip
"""Other names of a column that leave no doubt about its unit."""

AGREEMENT_S = 1e-3
"""Most that time_s and time_utc of one row may disagree."""


@dataclass(frozen=True)
class Table:
    """Cells of a table by column, and the line that each row stood in."""

    path: Path
    """The file."""
    cells: Mapping[str, list[str]]
    """Cells as text, by column."""
    lines: list[int]
    """Number of the line of each row in the file, from 1."""
    damaged: dict[int, str] | None = None
    """What is wrong, by line, where single rows may be damaged; None: the table is
    refused."""

    def __contains__(self, name: object) -> bool:
        """Tell whether the table has a column."""
        return name in self.cells

    def where(self, row: int) -> str:
        """Return the file and line in which a row stands."""
        return f"{self.path}, line {self.lines[row]}"

    def fail(self, row: int, reason: str) -> NoReturn:
        """Refuse a row, by its line in the file."""
        raise DataError(f"{self.where(row)}: {reason}")

    def refuse(self, row: int, reason: str) -> None:
        """Refuse a row, or note it where single rows may be damaged."""
        if self.damaged is None:
            self.fail(row, reason)
        self.damaged.setdefault(self.lines[row], reason)

    def undamaged(self) -> IntArray:
        """Return the rows in which nothing was wrong, and say how many are left out.

        Raises
        ------
        DataError
            More than half of the rows are damaged: the table is another than it seems.
        """
        damaged = self.damaged or {}
        kept = [row for row, line in enumerate(self.lines) if line not in damaged]
        if damaged:
            line = min(damaged)
            first = f"line {line}: {damaged[line].rstrip('.')}"
            count = len(kept) + len(damaged)
            if len(kept) < len(damaged):
                raise DataError(
                    f"{self.path}, {first}; so are {len(damaged)} of {count} rows: the "
                    f"table is not what it seems."
                )
            are = "row is" if len(damaged) == 1 else "rows are"
            note(
                f"{self.path}: {len(damaged)} damaged {are} left out of {count}; the "
                f"first is {first}."
            )
        return np.array(kept, dtype=np.int64)

    def rows(self, kept: IntArray) -> "Table":
        """Return the table with some of its rows."""
        cells = {name: [column[i] for i in kept] for name, column in self.cells.items()}
        return Table(self.path, cells, [self.lines[i] for i in kept])

    def need(self, *names: str) -> None:
        """Refuse the table unless it has all of these columns."""
        missing = [name for name in names if name not in self.cells]
        if missing:
            columns = "column" if len(missing) == 1 else "columns"
            raise DataError(
                f"{self.path} lacks the {columns} {', '.join(missing)}; "
                f"it has: {_some(self.cells)}."
            )

    def numbers(
        self, name: str, low: float = -np.inf, high: float = np.inf, *, may_miss: bool = False
    ) -> FloatArray:
        """Return a column of finite numbers within limits.

        ``low``: least value accepted. ``high``: greatest value accepted. ``may_miss``:
        whether a cell may be empty or nan.
        """
        with contextlib.suppress(ValueError):  # what is wrong, the loop below says
            values = np.fromiter(map(float, self.cells[name]), float, len(self.lines))
            if (
                np.isfinite(values).all()
                and low <= values.min(initial=low)
                and (values.max(initial=high) <= high)
            ):
                return values
        values = np.full(len(self.lines), np.nan)
        for row, cell in enumerate(self.cells[name]):
            if may_miss and cell.lower() in {"", "nan", "null", "none"}:
                continue
            try:
                values[row] = float(cell)
            except ValueError:
                point = " (a decimal point, no comma)" if "," in cell else ""
                self.refuse(row, f"{name} must be a number{point}, got {shown(cell)}.")
                continue
            if not (np.isfinite(values[row]) and low <= values[row] <= high):
                limits = f" from {low:g} to {high:g}" if np.isfinite(low) else ""
                self.refuse(row, f"{name} must be a finite number{limits}, got {cell[:80]}.")
        return values

    def whole_numbers(self, name: str, low: float, high: float) -> IntArray:
        """Return a column of whole numbers within limits."""
        values = self.numbers(name, low, high)
        for row in np.flatnonzero(values != np.floor(values))[:1]:
            self.fail(row, f"{name} must be a whole number, got {values[row]}.")
        return values.astype(np.int64)

    def column(self, name: str, spec: Column) -> NDArray[Any] | None:
        """Return a declared column: texts, whole numbers, or numbers and nan.

        One that the table lacks is None if it may be, else 1 or not measured.
        """
        cells = spec.cells or Cells()
        if name not in self and (spec.optional or spec.dtype.kind == "i"):
            return None if spec.optional else np.ones(len(self.lines), np.int64)
        if spec.dtype.kind == "U":
            return np.array(self.cells[name], np.str_)
        if spec.dtype.kind == "i":
            return self.whole_numbers(name, cells.low, cells.high)
        return self.measured(name, cells)

    def measured(self, name: str, cells: Cells) -> FloatArray:
        """Return a column of numbers, nan where the table or a cell has none."""
        if name not in self:
            return np.full(len(self.lines), np.nan)
        return self.numbers(name, cells.low, cells.high, may_miss=not cells.every)

    def check_known(self, known: Iterable[str]) -> None:
        """Refuse columns that look misspelt, and name those that are not used."""
        known = list(known)
        unused = [name for name in self.cells if name not in known]
        for name in unused:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.8)
            if near:
                raise DataError(
                    f"{self.path}: unknown column {shown(name)}; did you mean {near[0]!r}?"
                )
        if unused:
            warn(f"{self.path}: columns not used: {_some(unused)}.")


def read_table(path: Path, heading: str = "", *, may_be_damaged: bool = False) -> Table:
    """Read the cells of a CSV file.

    ``path``: the file, UTF-8, with or without a byte-order mark. ``heading``: begin of
    a first line that names the columns, though it looks like a comment.
    ``may_be_damaged``: whether single rows may be damaged: what is wrong with them is
    noted, see `Table.undamaged`.

    Raises
    ------
    DataError
        The file is missing, too large, no text, or not a table.
    """
    check_readable(path)
    if path.stat().st_size > MAX_BYTES:
        raise DataError(f"{path} is larger than {MAX_BYTES >> 20} MB; split it.")
    try:
        with as_input(path).open(encoding="utf-8-sig", newline="") as file:
            rows = _rows(path, file, heading, is_strict=not may_be_damaged)
            return _table(path, rows, is_strict=not may_be_damaged)
    except (UnicodeDecodeError, csv.Error) as error:
        is_text = not isinstance(error, UnicodeDecodeError)
        why = f"{error}" if is_text else "it is no text in UTF-8"
        raise DataError(f"{path} is no CSV table ({why}).") from error


def read_declared(path: Path, kind: type[Container], *others: str) -> Table:
    """Read a table whose columns a container declares, and refuse one that lacks them.

    ``others``: further columns that are looked for.

    Raises
    ------
    DataError
        As of `read_table`; a column is missing, or looks misspelt.
    """
    table = read_table(path)
    names, columns = _declared_names(table, kind), kind.columns()
    times = ("time_s", "time_utc") if "time_s" in columns else ()
    table.check_known([*itertools.chain(*names.values()), *times, *others])
    needed = {name: spec.cells for name, spec in columns.items() if spec.cells}
    table.need(*(n for name, cells in needed.items() if cells.needed for n in names[name]))
    return table


def columns_of(table: Table, kind: type[Container]) -> dict[str, Any]:
    """Return the columns that a container declares, and times with their start.

    Raises
    ------
    DataError
        A cell is no number or out of range, or no time; the message names the line.
    """
    values: dict[str, Any] = {}
    if "time_s" in kind.columns():
        values["time_s"], values["start_utc_ns"] = table_times(table)
    for name, own in _declared_names(table, kind).items():
        spec = kind.columns()[name]
        if len(spec.axes) == 1:
            values[name] = table.column(name, spec)
        else:
            lines = [table.measured(each, spec.cells or Cells()) for each in own]
            values[name] = np.reshape(lines, (len(own), len(table.lines))).T
    return values


def _declared_names(table: Table, kind: type[Container]) -> dict[str, list[str]]:
    """Return the columns of a table that each declared column of a container may have.

    One of two axes has as many as there are: ``name``, ``name_2`` and so on.
    """
    told = {name: spec for name, spec in kind.columns().items() if spec.cells}
    wide = [name for name, spec in told.items() if len(spec.axes) > 1]
    ends = [c.removeprefix(f"{name}_") for name in wide for c in table.cells]
    numbers = [int(end) for end in ends if end.isdecimal()]
    count = max(numbers, default=int(bool(wide) and wide[0] in table))
    further = [f"_{number}" for number in range(2, min(count, MAX_COLUMNS) + 1)]
    lines = ["", *further] if count else []
    return {name: [name + end for end in (lines if name in wide else [""])] for name in told}


def _table(path: Path, rows: Iterator[tuple[int, list[str]]], *, is_strict: bool) -> Table:
    """Gather rows by column; a cell that occurs often is kept once."""
    _, header = next(rows, (0, None))
    if header is None:
        raise DataError(f"{path} holds no table: there is no line with column names.")
    columns: dict[str, list[str]] = {name: [] for name in _names(path, header)}
    lists, lines, known = list(columns.values()), list[int](), dict[str, str]()
    damaged = dict[int, str]()
    for line, cells in rows:
        if len(cells) != len(lists):
            damaged[line] = _uneven(cells, list(columns))
            _fail_first(path, damaged if is_strict else {})
            continue
        if (len(lines) + 1) * len(lists) > MAX_CELLS:
            raise DataError(f"{path} has more than {MAX_CELLS} cells; split it.")
        lines.append(line)
        if len(known) > MAX_KNOWN:
            known.clear()
        for column, cell in zip(lists, cells, strict=True):
            column.append(known.setdefault(cell, cell))
    if not lines:
        _fail_first(path, damaged)
        raise DataError(f"{path} has column names, but no rows.")
    return Table(path, columns, lines, None if is_strict else damaged)


def _uneven(cells: list[str], names: list[str]) -> str:
    """Say of a row that it has not a cell for every column."""
    why = f"{len(cells)} cells, {len(names)} columns"
    if len(names) == 1:
        return f"{why}: the first line, {shown(names[0])}, was read as their names."
    if len(cells) == 1:
        return f"{why}: {shown(cells[0])} is no row; a remark begins with #."
    return f"{why}."


def _fail_first(path: Path, damaged: Mapping[int, str]) -> None:
    """Refuse a table by the first of its damaged lines, if there is one."""
    for line, reason in damaged.items():
        raise DataError(f"{path}, line {line}: {reason}")


def _rows(
    path: Path, file: Iterable[str], heading: str, *, is_strict: bool
) -> Iterator[tuple[int, list[str]]]:
    """Yield the cells of every line that is neither empty nor a comment."""
    numbered = (
        (line, text.removeprefix("#") if line == 1 else text)
        for line, text in enumerate(file, 1)
        if text.strip()
        and (
            not text.lstrip().startswith("#")
            or (line == 1 and heading and text.startswith(heading))
        )
    )
    first = next(numbered, None)
    if first is None:
        return
    delimiter = max(",;\t", key=first[1].count)
    for line, text in itertools.chain([first], numbered):
        if text.count(delimiter) >= MAX_COLUMNS:
            raise DataError(f"{path}, line {line}: more than {MAX_COLUMNS} columns are not read.")
        cells = text.split(delimiter)
        if '"' in text:
            try:
                cells = next(csv.reader([text], delimiter=delimiter, strict=True), [])
            except csv.Error:
                if is_strict:
                    raise
                cells = []  # a row of no cells is a damaged one
        yield line, [cell.strip() for cell in cells]


def _names(path: Path, header: list[str]) -> list[str]:
    plain = ["_".join(name.strip().lower().split()) for name in header]
    names = [ALIASES.get(name, name) for name in plain]
    for name, times in Counter(names).items():
        if not name or times > 1:
            raise DataError(
                f"{path}: column {shown(name)} is empty or named twice: {_some(header)}."
            )
    return names


def _some(names: Iterable[str]) -> str:
    """Return names as a list for a sentence, those beyond a few as their number."""
    names = list(names)
    more = f" and {len(names) - MAX_NAMED} more" if len(names) > MAX_NAMED else ""
    return ", ".join(name[:80] for name in names[:MAX_NAMED]) + more


def table_times(table: Table) -> tuple[FloatArray, int | None]:
    """Return the times of all rows, s, and the UTC epoch of time zero, ns.

    Where the table has UTC alone, time zero is its earliest row.

    Raises
    ------
    DataError
        No time column, a cell that is no time, or two columns that disagree.
    """
    if "time_s" not in table and "time_utc" not in table:
        table.need("time_s or time_utc")
    if "time_utc" not in table:
        return table.numbers("time_s"), None
    utc_ns = _utc_ns(table)
    if "time_s" not in table:
        start_ns = int(utc_ns.min())
        return (utc_ns - start_ns) / NANOSECONDS, start_ns
    time_s = table.numbers("time_s")
    utc_s = (utc_ns.astype(float) - float(utc_ns[0])) / NANOSECONDS
    apart = np.abs(utc_s - (time_s - time_s[0]))
    for row in np.flatnonzero(apart > AGREEMENT_S)[:1]:
        table.fail(row, f"time_s and time_utc disagree by {apart[row]:g} s.")
    start_ns = int(utc_ns[0]) - round(float(time_s[0]) * NANOSECONDS)
    if abs(start_ns) > np.iinfo(np.int64).max:
        table.fail(0, f"time_s = {time_s[0]:g} puts time zero centuries from time_utc.")
    return time_s, start_ns


def check_increasing(table: Table, time_s: FloatArray, contact: IntArray | None = None) -> None:
    """Refuse times that do not strictly increase (per contact).

    Raises
    ------
    DataError
        A time is not later than the one before it.
    """
    groups = np.zeros(time_s.size, np.int64) if contact is None else contact
    order = np.argsort(groups, kind="stable")
    later = np.diff(time_s[order]) > 0.0
    same = np.diff(groups[order]) == 0
    for at in np.flatnonzero(same & ~later)[:1]:
        row = int(order[at + 1])
        before = time_s[order[at]]
        table.fail(row, f"time {time_s[row]:g} s is not later than {before:g} s.")


def _utc_ns(table: Table) -> IntArray:
    times = np.zeros(len(table.lines), np.int64)
    is_known = np.ones(times.size, np.bool_)
    for row, cell in enumerate(table.cells["time_utc"]):
        try:
            times[row] = parse_utc(cell)
        except (DataError, OverflowError) as error:
            table.refuse(row, f"time_utc: {error}")
            is_known[row] = False
    # the earliest row is time zero: one that is left out must not be it
    times[~is_known] = times[is_known].min(initial=np.iinfo(np.int64).max)
    return times
