"""AIS: where ships said that they were.

**Conventions.** A CSV table has one row per message, in any order, under the usual names
of columns (MMSI, time, latitude, longitude, SOG in knots, COG in degrees); a log of
sentences is known by its first ones. The values that AIS
reserves for "not available" (SOG 102.3, COG 360, latitude 91, longitude 181) are
not used. A damaged row is left out, and it is said how many there are; a table of which
most rows are damaged is refused. Times without a zone are UTC; a number is seconds since 1970. In tables of the
Danish agency, whose line of names begins with ``# Timestamp``, the day stands first.

**References.** ITU-R M.1371-5 (2014), annex 8, table 48: position report.
"""

import re
from pathlib import Path

import numpy as np

from uwtrack_cli.constants import KNOT_MPS, NANOSECONDS
from uwtrack_cli.data.base import Cells, IntArray
from uwtrack_cli.data.truth import Truth, VesselTrack
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.checks import check_readable
from uwtrack_cli.files.input_ledger import as_input
from uwtrack_cli.files.tables.ais_sentences import (
    AisMessages,
    is_sentence_log,
    read_sentences,
)
from uwtrack_cli.files.tables.csv_table import Table, read_table, table_times
from uwtrack_cli.files.utc import format_utc

COLUMNS = {
    "time_utc": Cells(needed=True, aliases=(
        "time", "basedatetime", "base_date_time", "date_time_utc", "received_time",
        "timestamp_utc",
    )),
    "mmsi": Cells(needed=True),
    "latitude": Cells(-91.0, 91.0, needed=True, aliases=("latitude_degrees",)),
    "longitude": Cells(-181.0, 181.0, needed=True, aliases=("longitude_degrees",)),
    "speed_kn": Cells(0.0, 1e4, needed=True, aliases=(
        "sog", "sog_knots", "sog_kn", "speed_over_ground", "speed",
    )),
    "course_deg": Cells(0.0, 1e4, needed=True, aliases=(
        "cog", "cog_degrees", "cog_deg", "course_over_ground", "course",
    )),
    "name": Cells(aliases=("vesselname", "vessel_name", "shipname", "ship_name")),
}  # fmt: skip
"""Columns of a table; values for "not available" are among those accepted."""

NUMBERS = ("latitude", "longitude", "speed_kn", "course_deg")
ALIASES = {alias: name for name, cells in COLUMNS.items() for alias in cells.aliases}
DAY_FIRST = "# Timestamp"
"""Begin of the line of names in tables of the Danish Maritime Authority."""

DAY_MONTH = re.compile(r"(\d\d)/(\d\d)/(\d{4}) (.+)")
SECONDS = re.compile(r"\d{9,10}(\.\d+)?")
"""A time as seconds since 1970, from 1973 on."""

NO_SPEED_KN, NO_COURSE_DEG = 102.25, 360.0
POSITION_STD_M = 10.0
"""Deviation of a position: AIS calls those better than 10 m accurate."""


def read_ais(path: Path) -> Truth:
    """Read an AIS table as the truth of where vessels were.

    ``path``: CSV with time, MMSI, latitude, longitude, speed and course over ground, or
    a log of NMEA 0183 sentences.

    Raises
    ------
    DataError
        The table lacks a column, most of its rows are damaged, or a log has no times.
    """
    check_readable(path)
    messages = read_sentences(path) if is_sentence_log(path) else _read_csv(path)
    known = (np.abs(messages.latitude) <= 90.0) & (np.abs(messages.longitude) <= 180.0)
    vessel = np.unique(messages.mmsi, return_inverse=True)[1]
    # by vessel and time; of equal times the first message counts
    order = np.lexsort((messages.time_s, vessel))
    order = order[known[order]]
    is_first = np.diff(vessel[order], prepend=-1) != 0
    is_first |= np.diff(messages.time_s[order], prepend=-np.inf) > 0.0
    order = order[is_first]
    parts = np.split(order, np.flatnonzero(np.diff(vessel[order])) + 1)
    return Truth(
        name=path.name,
        start_utc_ns=messages.start_utc_ns,
        is_geographic=True,
        tracks=tuple(_track(messages, rows) for rows in parts if rows.size),
        position_std_m=POSITION_STD_M,
    )


def _read_csv(path: Path) -> AisMessages:
    table = read_table(path, heading=DAY_FIRST, may_be_damaged=True)
    cells = {ALIASES.get(name, name): column for name, column in table.cells.items()}
    if len(cells) < len(table.cells):
        msg = f"{path} names a quantity in two columns: {', '.join(table.cells)}."
        raise DataError(msg)
    table = Table(path, cells, table.lines, table.damaged)
    table.need(*(name for name, own in COLUMNS.items() if own.needed))
    cells.pop("time_s", None)
    is_day_first = _begins_with(path, DAY_FIRST)
    cells["time_utc"] = [
        _iso(cell, is_day_first=is_day_first) for cell in cells["time_utc"]
    ]
    time_s, start_ns = table_times(table)
    columns = [table.measured(name, COLUMNS[name]) for name in NUMBERS]
    kept = table.undamaged()
    latitude, longitude, speed_kn, course_deg = (column[kept] for column in columns)
    table = table.rows(kept)
    numbers = table.cells["mmsi"]
    names = dict[str, str]()
    for number, name in zip(numbers, table.cells.get("name", ()), strict=False):
        if name.strip():  # messages may lack it
            names.setdefault(number, name)
    return AisMessages(
        start_utc_ns=start_ns,
        time_s=time_s[kept],
        mmsi=np.array(numbers),
        latitude=latitude,
        longitude=longitude,
        speed_kn=speed_kn,
        course_deg=course_deg,
        names=names,
    )


def _begins_with(path: Path, text: str) -> bool:
    with as_input(path).open(encoding="utf-8-sig") as file:
        return file.read(len(text)) == text


def _iso(cell: str, *, is_day_first: bool) -> str:
    """Return a time of an agency in the form that all tables have, others unchanged."""
    if SECONDS.fullmatch(cell):
        return format_utc(int(float(cell) * NANOSECONDS))
    found = DAY_MONTH.fullmatch(cell) if is_day_first else None
    if found is None:
        return cell
    day, month, year, clock = found.groups()
    return f"{year}-{month}-{day}T{clock}"


def _track(messages: AisMessages, rows: IntArray) -> VesselTrack:
    mmsi = str(messages.mmsi[rows[0]])
    name = messages.names.get(mmsi)
    speed_kn, course_deg = messages.speed_kn[rows], messages.course_deg[rows]
    return VesselTrack(
        vessel=f"{name} ({mmsi})" if name else mmsi,
        time_s=messages.time_s[rows],
        first=messages.latitude[rows],
        second=messages.longitude[rows],
        speed_mps=np.where(speed_kn < NO_SPEED_KN, speed_kn, np.nan) * KNOT_MPS,
        course_deg=np.where(course_deg < NO_COURSE_DEG, course_deg, np.nan),
    )
