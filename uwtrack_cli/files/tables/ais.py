"""AIS tables: where ships said that they were.

**Conventions.** One row per message, in any order, under the usual names of columns
(MMSI, time, latitude, longitude, SOG in knots, COG in degrees). The values that AIS
reserves for "not available" (SOG 102.3, COG 360, latitude 91, longitude 181) are
not used. Times without a zone are UTC.

**References.** ITU-R M.1371-5 (2014), annex 8, table 48: position report.
"""

from pathlib import Path

import numpy as np

from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.truth import Truth, VesselTrack
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.tables.csv_table import Table, read_table, table_times

ALIASES = {
    "time": "time_utc", "basedatetime": "time_utc", "base_date_time": "time_utc",
    "date_time_utc": "time_utc", "received_time": "time_utc", "timestamp_utc": "time_utc",
    "latitude_degrees": "latitude", "longitude_degrees": "longitude",
    "sog": "speed_kn", "sog_knots": "speed_kn", "sog_kn": "speed_kn",
    "speed_over_ground": "speed_kn", "speed": "speed_kn",
    "cog": "course_deg", "cog_degrees": "course_deg", "cog_deg": "course_deg",
    "course_over_ground": "course_deg", "course": "course_deg",
    "vesselname": "name", "vessel_name": "name", "shipname": "name", "ship_name": "name",
}  # fmt: skip
NO_SPEED_KN, NO_COURSE_DEG = 102.25, 360.0
POSITION_STD_M = 10.0
"""Deviation of a position: AIS calls those better than 10 m accurate."""


def read_ais(path: Path) -> Truth:
    """Read an AIS table as the truth of where vessels were.

    Parameters
    ----------
    path
        CSV with time, MMSI, latitude, longitude, speed and course over ground.

    Raises
    ------
    DataError
        The table lacks a column, or a cell is no number.
    """
    table = read_table(path)
    cells = {ALIASES.get(name, name): column for name, column in table.cells.items()}
    if len(cells) < len(table.cells):
        msg = f"{path} names a quantity in two columns: {', '.join(table.cells)}."
        raise DataError(msg)
    table = Table(path, cells, table.lines)
    table.need("time_utc", "mmsi", "latitude", "longitude", "speed_kn", "course_deg")
    cells.pop("time_s", None)
    time_s, start_ns = table_times(table)
    latitude = table.numbers("latitude", -91.0, 91.0, may_miss=True)
    longitude = table.numbers("longitude", -181.0, 181.0, may_miss=True)
    known = (np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 180.0)
    mmsi = np.array(table.cells["mmsi"])
    tracks = [
        _track(table, known & (mmsi == vessel), (time_s, latitude, longitude))
        for vessel in np.unique(mmsi[known])
    ]
    return Truth(
        name=path.name,
        start_utc_ns=start_ns,
        is_geographic=True,
        tracks=tuple(tracks),
        position_std_m=POSITION_STD_M,
    )


def _track(
    table: Table, rows: BoolArray, places: tuple[FloatArray, FloatArray, FloatArray]
) -> VesselTrack:
    time_s, latitude, longitude = places
    order = np.flatnonzero(rows)
    order = order[np.argsort(time_s[order], kind="stable")]
    order = order[np.append(True, np.diff(time_s[order]) > 0.0)]  # one per time
    speed_kn = _cells(table, "speed_kn", order, NO_SPEED_KN)
    course_deg = _cells(table, "course_deg", order, NO_COURSE_DEG)
    first = int(order[0])
    names = (table.cells["name"][row] for row in order) if "name" in table else ()
    name = next((text for text in names if text.strip()), "")  # messages may lack it
    mmsi = table.cells["mmsi"][first]
    return VesselTrack(
        vessel=f"{name} ({mmsi})" if name else mmsi,
        time_s=time_s[order],
        first=latitude[order],
        second=longitude[order],
        speed_mps=speed_kn * KNOT_MPS,
        course_deg=course_deg,
    )


def _cells(table: Table, name: str, rows: IntArray, unknown: float) -> FloatArray:
    """Return some cells as numbers; nan from the value on that means unknown."""
    part = Table(
        table.path,
        {name: [table.cells[name][row] for row in rows]},
        [table.lines[row] for row in rows],
    )
    values = part.numbers(name, 0.0, 1e4, may_miss=True)
    values[~(values < unknown)] = np.nan
    return values
