"""Tables of bearings, frequencies and levels measured elsewhere: a Series from CSV."""

import re
from collections.abc import Mapping
from pathlib import Path
from warnings import warn

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.series import Series
from uwtrack_cli.errors import OptionError, UwtrackWarning
from uwtrack_cli.files.tables.csv_table import (
    Table,
    check_increasing,
    read_table,
    table_times,
)

QUANTITIES = (
    "time_s", "time_utc", "contact", "bearing_deg", "bearing_std_deg", "frequency_hz",
    "frequency_std_hz", "level_db", "level_std_db",
)  # fmt: skip
LINE = re.compile(r"frequency(?:_std)?_hz_(\d+)")
TINY = np.finfo(np.float64).tiny
FULL_TURN = 2.0 * np.pi
ENOUGH_ROWS = 8


def read_series(
    path: Path | str,
    *,
    bearing_std_deg: float | None = None,
    frequency_std_hz: float | None = None,
    level_std_db: float | None = None,
    columns: Mapping[str, str] | None = None,
) -> Series:
    """Read measurements over time.

    Parameters
    ----------
    path
        CSV with time_s or time_utc, and any of bearing_deg, frequency_hz (further
        lines frequency_hz_2 ...) and level_db, with _std columns, and contact.
    bearing_std_deg
        Deviation of the bearings, degrees, where the table has none.
    frequency_std_hz
        Deviation of the frequencies, Hz, where the table has none.
    level_std_db
        Deviation of the levels, dB, where the table has none.
    columns
        Names of ours by the names that the table uses.

    Raises
    ------
    DataError
        No measurement, a cell that is no number or out of range, or times that do
        not increase within a contact.
    OptionError
        A deviation that is not positive.
    """
    table = read_table(Path(path), columns)
    n_lines = _n_lines(table)
    table.check_known([*QUANTITIES, *_line_names(n_lines)])
    if not {"bearing_deg", "frequency_hz", "level_db"} & set(table.cells):
        table.need("bearing_deg, frequency_hz or level_db")
    time_s, start_utc_ns = table_times(table)
    contact = table.contacts()
    check_increasing(table, time_s, contact)
    return Series(
        contact=contact,
        time_s=time_s,
        bearing_deg=_bearing(table),
        bearing_std_deg=_std(table, "bearing_std_deg", bearing_std_deg),
        frequency_hz=_frequencies(table, n_lines),
        frequency_std_hz=_frequency_stds(table, n_lines, frequency_std_hz),
        level_db=_values(table, "level_db", -1e3, 1e3),
        level_std_db=_std(table, "level_std_db", level_std_db),
        start_utc_ns=start_utc_ns,
    )


def _n_lines(table: Table) -> int:
    numbers = {int(m[1]) for name in table.cells if (m := LINE.fullmatch(name))}
    n_lines = max(numbers, default=1 if "frequency_hz" in table else 0)
    for name in _line_names(n_lines)[::2]:
        table.need(name)
    return n_lines


def _line_names(n_lines: int) -> list[str]:
    names: list[str] = []
    for line in range(1, min(n_lines, 1000) + 1):
        suffix = "" if line == 1 else f"_{line}"
        names += [f"frequency_hz{suffix}", f"frequency_std_hz{suffix}"]
    return names


def _bearing(table: Table) -> FloatArray:
    bearing = _values(table, "bearing_deg", -360.0, 360.0)
    known = bearing[np.isfinite(bearing)]
    if known.size >= ENOUGH_ROWS and np.all(np.abs(known) <= FULL_TURN):
        msg = (
            f"{table.path}: every bearing lies within {FULL_TURN:.3f} degrees of "
            f"north; if these are radians, convert them to degrees."
        )
        warn(msg, UwtrackWarning, stacklevel=3)
    return bearing % 360.0


def _frequencies(table: Table, n_lines: int) -> FloatArray:
    names = _line_names(n_lines)[::2]
    return _stack(table, [_values(table, name, TINY, 1e15) for name in names])


def _frequency_stds(table: Table, n_lines: int, default: float | None) -> FloatArray:
    names = _line_names(n_lines)[1::2]
    return _stack(table, [_std(table, name, default) for name in names])


def _stack(table: Table, lines: list[FloatArray]) -> FloatArray:
    if not lines:
        return np.zeros((len(table.lines), 0))
    return np.stack(lines, axis=1)


def _values(table: Table, name: str, low: float, high: float) -> FloatArray:
    if name not in table:
        return np.full(len(table.lines), np.nan)
    return table.numbers(name, low, high, may_miss=True)


def _std(table: Table, name: str, default: float | None) -> FloatArray:
    if default is not None and not (np.isfinite(default) and default > 0.0):
        msg = f"{name} must be positive, got {default}."
        raise OptionError(msg)
    values = _values(table, name, TINY, 1e9)
    if default is None:
        return values
    if name in table and np.isfinite(values).any():
        msg = f"{table.path} has {name} itself; the option fills only empty cells."
        warn(msg, UwtrackWarning, stacklevel=3)
    return np.where(np.isnan(values), default, values)
