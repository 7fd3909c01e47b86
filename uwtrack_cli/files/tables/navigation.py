"""Tables of a platform's positions: a Navigation series from CSV.

**Method.** Latitude and longitude become metres east and north of the first position
along geodesics of the WGS 84 ellipsoid (azimuthal equidistant). Speed and course
hold from their row to the next, so that a table of legs and one of samples both mean
what they say.

**References.** Karney, Algorithms for geodesics, J. Geodesy 87 (2013).
"""

from pathlib import Path
from typing import Any

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin, places_on_grid
from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.tables.csv_table import Table, check_increasing, columns_of, read_declared

OTHERS = ("latitude", "longitude", "speed_mps", "speed_kn", "course_deg")
"""Columns from which positions are made where the table has not their metres."""

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
    table = read_declared(Path(path), Navigation, *OTHERS)
    values = columns_of(table, Navigation)
    check_increasing(table, values["time_s"])
    if "east_m" in table or "north_m" in table:
        table.need("east_m", "north_m")
    elif "latitude" in table or "longitude" in table:
        values |= _geographic(table)
    elif "speed_mps" in table or "speed_kn" in table:
        values |= _integrated(table, values["time_s"])
    else:
        raise DataError(
            f"{path} has no positions: east_m and north_m, or latitude and longitude, "
            f"or speed_mps (speed_kn) and course_deg; it has {', '.join(table.cells)}."
        )
    return Navigation(**values | {"heading_deg": values["heading_deg"] % 360.0})


def _geographic(table: Table) -> dict[str, Any]:
    table.need("latitude", "longitude")
    latitude = table.numbers("latitude", -90.0, 90.0)
    longitude = table.numbers("longitude", -180.0, 360.0)
    first = Origin(float(latitude[0]), float(longitude[0]))
    east, north = places_on_grid(latitude, longitude, first)
    origin = {"origin_latitude": first.latitude, "origin_longitude": first.longitude}
    return {"east_m": east, "north_m": north, **origin}


def _integrated(table: Table, time_s: FloatArray) -> dict[str, Any]:
    if "speed_mps" in table and "speed_kn" in table:
        raise DataError(f"{table.path} gives the speed twice: speed_mps and speed_kn.")
    table.need("course_deg")
    unit = KNOT_MPS if "speed_kn" in table else 1.0
    name = "speed_kn" if "speed_kn" in table else "speed_mps"
    speed_mps = unit * table.numbers(name, 0.0, FASTEST_MPS / unit)
    course = np.radians(table.numbers("course_deg", -360.0, 360.0))
    rates = {"east_m": speed_mps * np.sin(course), "north_m": speed_mps * np.cos(course)}
    ways = {name: np.cumsum(rate[:-1] * np.diff(time_s)) for name, rate in rates.items()}
    return {name: np.append(0.0, way) for name, way in ways.items()}
