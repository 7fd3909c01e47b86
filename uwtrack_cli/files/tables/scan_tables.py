"""Tables of scans, contacts, delays and operating curves: containers from CSV.

**Conventions.** As in `uwtrack_cli.files.tables.csv_table`; an empty cell is "not measured".
"""

import re
from pathlib import Path

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.contacts import Contacts
from uwtrack_cli.data.directions import Delays
from uwtrack_cli.data.scans import Roc, Scans
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.tables.csv_table import Table, read_table, table_times

_COMPONENT = re.compile(r"z_(\d+)(?:_?[\[(](.+)[\])]|_(\S+))?$")
_UNITS = {"hz": "Hz", "db": "dB"}
_CONTACT_QUANTITIES = (
    "contact", "time_s", "time_utc", "range_m", "range_std_m", "bearing_deg",
    "bearing_std_deg", "range_rate_mps", "range_rate_std_mps",
)  # fmt: skip


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
        msg = (
            f"{path}: the components must be z_1, z_2 ... without a gap; "
            f"the columns are {', '.join(table.cells)}."
        )
        raise DataError(msg)
    names, units = zip(*(named[i] for i in numbers), strict=True)
    deviations = [f"std_{i}" for i in numbers]
    table.check_known(
        [*names, *deviations, "scan", "time_s", "time_utc", "amplitude", "contact"]
    )
    time_s, start_utc_ns = table_times(table)
    return Scans(
        scan=_scan_numbers(table),
        time_s=time_s,
        measured=np.stack([table.numbers(name, may_miss=True) for name in names], 1),
        measured_std=np.stack([_optional(table, name, 0.0) for name in deviations], 1),
        amplitude=_optional(table, "amplitude"),
        component=np.array([f"z_{i}" for i in numbers]),
        component_unit=np.array([_UNITS.get(unit, unit) for unit in units]),
        start_utc_ns=start_utc_ns,
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
    table = read_table(Path(path))
    table.need("contact", "range_m", "bearing_deg", "range_rate_mps")
    table.check_known(_CONTACT_QUANTITIES)
    time_s, start_utc_ns = table_times(table)
    contacts = Contacts(
        contact=table.contacts(),
        time_s=time_s,
        range_m=table.numbers("range_m", 0.0, may_miss=True),
        range_std_m=_optional(table, "range_std_m", 0.0),
        bearing_deg=table.numbers("bearing_deg", -360.0, 360.0, may_miss=True),
        bearing_std_deg=_optional(table, "bearing_std_deg", 0.0),
        range_rate_mps=table.numbers("range_rate_mps", may_miss=True),
        range_rate_std_mps=_optional(table, "range_rate_std_mps", 0.0),
        start_utc_ns=start_utc_ns,
    )
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
    table = read_table(Path(path))
    wanted = ("false_alarm_probability", "detection_probability")
    table.need(*wanted)
    table.check_known([*wanted, "threshold"])
    roc = Roc(
        false_alarm_probability=table.numbers(wanted[0], 0.0, 1.0),
        detection_probability=table.numbers(wanted[1], 0.0, 1.0),
        threshold=_optional(table, "threshold"),
    )
    return roc.take("point", np.argsort(roc.false_alarm_probability, kind="stable"))


def _optional(table: Table, name: str, low: float = -np.inf) -> FloatArray:
    """Return a column, nan where the table or the cell has nothing."""
    if name not in table:
        return np.full(len(table.lines), np.nan)
    return table.numbers(name, low, may_miss=True)


def _scan_numbers(table: Table) -> IntArray:
    table.need("scan")
    values = table.numbers("scan")
    for row in np.flatnonzero(values != np.floor(values))[:1]:
        table.fail(row, f"scan must be a whole number, got {values[row]}.")
    return values.astype(np.int64)


_DELAYS = ("channel_a", "channel_b", "delay_s", "delay_std_s")


def read_delays(path: Path) -> Delays:
    """Read a table of delays.

    ``path``: CSV with time_s or time_utc, channel_a, channel_b, delay_s (arrival at the
    second less arrival at the first) and delay_std_s; one row per pair and time.

    Raises
    ------
    DataError
        The table is not readable, or a value is not accepted; the line is named.
    """
    table = read_table(path)
    table.check_known(("time_s", "time_utc", "coherence", *_DELAYS))
    table.need(*_DELAYS)
    time_s, start_utc_ns = table_times(table)
    one, other = (np.array(table.cells[name], np.str_) for name in _DELAYS[:2])
    for row in np.flatnonzero((one == other) | (one == "") | (other == ""))[:1]:
        table.fail(
            int(row),
            f"channel_a and channel_b must be two channels, got {one[row]!r} and "
            f"{other[row]!r}.",
        )
    return Delays(
        time_s=time_s,
        channel_a=one,
        channel_b=other,
        delay_s=table.numbers("delay_s", -1e6, 1e6),
        delay_std_s=table.numbers("delay_std_s", 1e-12, 1e6),
        coherence=table.numbers("coherence", 0.0, 1.0)
        if "coherence" in table
        else None,
        start_utc_ns=start_utc_ns,
    )
