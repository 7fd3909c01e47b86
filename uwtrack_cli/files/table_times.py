"""The time column of a table: seconds, or UTC as exact integers."""

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.csv_table import Table
from uwtrack_cli.files.utc import parse_utc

AGREEMENT_S = 1e-3
"""Most that time_s and time_utc of one row may disagree."""


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
    utc_ns = _utc(table)
    if "time_s" not in table:
        start_ns = int(utc_ns.min())
        return (utc_ns - start_ns) / NANOSECONDS, start_ns
    time_s = table.numbers("time_s")
    start_ns = int(utc_ns[0]) - round(float(time_s[0]) * NANOSECONDS)
    apart = np.abs((utc_ns - start_ns) / NANOSECONDS - time_s)
    for row in np.flatnonzero(apart > AGREEMENT_S)[:1]:
        table.fail(row, f"time_s and time_utc disagree by {apart[row]:g} s.")
    return time_s, start_ns


def check_increasing(
    table: Table, time_s: FloatArray, contact: IntArray | None = None
) -> None:
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


def _utc(table: Table) -> IntArray:
    times = np.zeros(len(table.lines), np.int64)
    for row, cell in enumerate(table.cells["time_utc"]):
        try:
            times[row] = parse_utc(cell)
        except (DataError, OverflowError) as error:
            table.fail(row, f"time_utc: {error}")
    return times
