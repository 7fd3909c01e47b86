"""Tables of a platform's positions: a Navigation series from CSV.

**Method.** Latitude and longitude become metres east and north of the first position
along geodesics of the WGS 84 ellipsoid (azimuthal equidistant). Speed and course
hold from their row to the next, so that a table of legs and one of samples both mean
what they say.

**References.** Karney, Algorithms for geodesics, J. Geodesy 87 (2013).
"""

from pathlib import Path

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin, to_grid
from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.tables.csv_table import (
    Table,
    check_increasing,
    read_table,
    table_times,
)

COLUMNS = (
    "time_s", "time_utc", "east_m", "north_m", "latitude", "longitude",
    "speed_mps", "speed_kn", "course_deg", "heading_deg",
)  # fmt: skip
FASTEST_MPS = 100.0


def read_navigation(path: Path | str) -> Navigation:
    """Read positions of a platform over time.

    ``path``: CSV with time_s or time_utc; east_m and north_m, or latitude and
    longitude, or speed_mps (or speed_kn) and course_deg; heading_deg if known.

    Raises
    ------
    DataError
        A column is missing, a cell is no number or out of range, or times do not
        increase.
    """
    table = read_table(Path(path))
    table.check_known(COLUMNS)
    time_s, start_utc_ns = table_times(table)
    check_increasing(table, time_s)
    origin: tuple[float, float] | None = None
    if "east_m" in table or "north_m" in table:
        table.need("east_m", "north_m")
        east, north = table.numbers("east_m"), table.numbers("north_m")
    elif "latitude" in table or "longitude" in table:
        east, north, origin = _geographic(table)
    elif "speed_mps" in table or "speed_kn" in table:
        east, north = _integrated(table, time_s)
    else:
        msg = (
            f"{path} has no positions: east_m and north_m, or latitude and longitude, "
            f"or speed_mps (speed_kn) and course_deg; it has {', '.join(table.cells)}."
        )
        raise DataError(msg)
    heading = np.full(time_s.size, np.nan)
    if "heading_deg" in table:
        heading = table.numbers("heading_deg", -360.0, 360.0, may_miss=True) % 360.0
    return Navigation(
        time_s=time_s,
        east_m=east,
        north_m=north,
        heading_deg=heading,
        origin_latitude=None if origin is None else origin[0],
        origin_longitude=None if origin is None else origin[1],
        start_utc_ns=start_utc_ns,
    )


def _geographic(table: Table) -> tuple[FloatArray, FloatArray, tuple[float, float]]:
    table.need("latitude", "longitude")
    latitude = table.numbers("latitude", -90.0, 90.0)
    longitude = table.numbers("longitude", -180.0, 360.0)
    first = Origin(float(latitude[0]), float(longitude[0]))
    places = zip(latitude.tolist(), longitude.tolist(), strict=True)
    grid = np.array([to_grid(*place, first) for place in places])
    return grid[:, 0], grid[:, 1], first


def _integrated(table: Table, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    if "speed_mps" in table and "speed_kn" in table:
        msg = f"{table.path} gives the speed twice: speed_mps and speed_kn."
        raise DataError(msg)
    table.need("course_deg")
    unit = KNOT_MPS if "speed_kn" in table else 1.0
    name = "speed_kn" if "speed_kn" in table else "speed_mps"
    speed_mps = unit * table.numbers(name, 0.0, FASTEST_MPS / unit)
    course = np.radians(table.numbers("course_deg", -360.0, 360.0))
    east_mps, north_mps = speed_mps * np.sin(course), speed_mps * np.cos(course)
    return _integral(time_s, east_mps), _integral(time_s, north_mps)


def _integral(time_s: FloatArray, rate: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(rate[:-1] * np.diff(time_s))])
