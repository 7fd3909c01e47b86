"""Tables of scans, contacts, delays and operating curves; which table is which container.

**Conventions.** As in `uwtrack_cli.files.tables.csv_table`; an empty cell is "not measured".
The containers declare what a table of them holds.
"""

import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from uwtrack_cli.data.base import Cells, Container
from uwtrack_cli.data.directions import Delays
from uwtrack_cli.data.scans import Contacts, Roc, Scans
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.tables.csv_table import columns_of, read_declared, read_table
from uwtrack_cli.files.tables.navigation import read_navigation
from uwtrack_cli.files.tables.series import read_series

_COMPONENT = re.compile(r"z_(\d+)(?:_?[\[(](.+)[\])]|_(\S+))?$")
_UNITS = {"hz": "Hz", "db": "dB"}
TABLES = (".csv", ".txt", ".tsv")
"""Endings of tables."""


def table_readers(sensors: Sequence[Sensor] = ()) -> dict[str, Callable[[Path], Container]]:
    """Return the reader of each container that a CSV table may be, by its name.

    ``sensors``: those that a table may name in its rows.
    """
    return {
        "series": partial(read_series, sensors=sensors),
        "delays": read_delays,
        "scans": read_scans,
        "contacts": read_contacts,
        "navigation": read_navigation,
        "roc": read_roc,
    }


def read_scans(path: Path | str) -> Scans:
    """Read scans of measurements: scan, time_s, z_1 ... z_m, amplitude, std_1 ...

    ``path``: CSV table; the unit of a component stands in its header, as in ``z_1
    [m]``.

    Returned: one row per measurement; an empty scan is a row with the time alone.

    Raises
    ------
    DataError
        A column is missing, or a cell is no number; the message names the line.
    """
    table = read_table(Path(path))
    found = {name: _COMPONENT.match(name) for name in table.cells}
    named = {int(m[1]): (name, m[2] or m[3] or "") for name, m in found.items() if m}
    numbers = range(1, len(named) + 1)
    if not named or sorted(named) != list(numbers):
        raise DataError(
            f"{path}: the components must be z_1, z_2 ... without a gap; "
            f"the columns are {', '.join(table.cells)}."
        )
    names, units = zip(*(named[i] for i in numbers), strict=True)
    deviations = [f"std_{i}" for i in numbers]
    table.check_known([*names, *deviations, "scan", "time_s", "time_utc", "amplitude", "contact"])
    table.need("scan")
    return Scans(
        **columns_of(table, Scans),
        measured=np.stack([table.numbers(name, may_miss=True) for name in names], 1),
        measured_std=np.stack([table.measured(n, Cells(0.0)) for n in deviations], 1),
        component=np.array([f"z_{i}" for i in numbers]),
        component_unit=np.array([_UNITS.get(unit, unit) for unit in units]),
    )


def read_contacts(path: Path | str) -> Contacts:
    """Read contacts: contact, time_s, range_m, bearing_deg, range_rate_mps and _std.

    ``path``: CSV table; deviations are columns such as ``range_std_m``.

    Returned: one row per contact and scan, ordered by time.

    Raises
    ------
    DataError
        A column is missing, or a cell is no number; the message names the line.
    """
    table = read_declared(Path(path), Contacts)
    contacts = Contacts(**columns_of(table, Contacts))
    return contacts.take("row", np.argsort(contacts.time_s, kind="stable"))


def read_roc(path: Path | str) -> Roc:
    """Read an operating curve: false_alarm_probability, detection_probability.

    ``path``: CSV table; a third column, ``threshold``, may hold the detector's setting.

    Returned: the curve, ordered by false alarm probability.

    Raises
    ------
    DataError
        A column is missing, or a cell is no probability; the message names the line.
    """
    roc = Roc(**columns_of(read_declared(Path(path), Roc), Roc))
    return roc.take("point", np.argsort(roc.false_alarm_probability, kind="stable"))


def read_delays(path: Path) -> Delays:
    """Read a table of delays.

    ``path``: CSV with time_s or time_utc, channel_a, channel_b, delay_s (arrival at the
    second less arrival at the first) and delay_std_s; one row per pair and time.

    Raises
    ------
    DataError
        The table is not readable, or a value is not accepted; the line is named.
    """
    table = read_declared(path, Delays)
    delays = Delays(**columns_of(table, Delays))
    one, other = delays.channel_a, delays.channel_b
    for row in np.flatnonzero((one == other) | (one == "") | (other == ""))[:1]:
        table.fail(
            int(row),
            f"channel_a and channel_b must be two channels, got {one[row]!r} and {other[row]!r}.",
        )
    return delays
