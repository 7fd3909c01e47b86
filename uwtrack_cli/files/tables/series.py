"""Tables of bearings, frequencies and levels measured elsewhere: a Series from CSV.

**Conventions.** A table may name in every row the sensor that heard it. Where a sensor was
comes from the row (``sensor_latitude`` and ``sensor_longitude``, or ``sensor_east_m`` and
``sensor_north_m``) or from a sensor file: a fixed place, or navigation by which it drifts.
Rows of different sensors may share a time and stand in any order. Latitudes and longitudes
become metres about the first sensor's first place. Rows that are repeated are left out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin, places_on_grid, to_grid, to_latitude_longitude
from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.options import shown
from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.data.series import BEARING, Series
from uwtrack_cli.errors import DataError, note, warn
from uwtrack_cli.files.tables.csv_table import (
    Table,
    check_increasing,
    columns_of,
    read_declared,
    table_times,
)

OTHERS = (
    "sensor_latitude", "sensor_longitude", "sensor_east_m", "sensor_north_m",
    "array_heading_deg", "contact_numbers",
)  # fmt: skip
"""Columns that say where a sensor was, how a line array lay, and whose the contacts are."""

FULL_TURN = 2.0 * np.pi
ENOUGH_ROWS = 8


def read_series(path: Path | str, *, sensors: Sequence[Sensor] | None = None) -> Series:
    """Read measurements over time.

    Parameters
    ----------
    path
        CSV with time_s or time_utc, and any of bearing_deg, frequency_hz (further
        lines frequency_hz_2 ...) and level_db, with _std columns, and contact; sensor
        with its place if several heard it; mirrored_bearing_deg or array_heading_deg
        where a line array does not tell left from right; bounce_delay_s where a
        reflected path was heard behind the direct one.
    sensors
        The sensors that the table names, where its rows do not place them.

    Raises
    ------
    DataError
        No measurement, a cell that is no number or out of range, or times that do
        not increase within a contact.
    """
    table = read_declared(Path(path), Series, *OTHERS)
    if not {"bearing_deg", "frequency_hz", "level_db"} & set(table.cells):
        table.need("bearing_deg, frequency_hz or level_db")
    kept = _unrepeated(table, table_times(table)[0])
    if kept.size < len(table.lines):
        table = table.rows(kept)
    values = columns_of(table, Series)
    if "sensor" not in table:
        order = np.lexsort((values["time_s"], values["contact"]))
        if (order != np.argsort(values["contact"], kind="stable")).any():
            note(f"{table.path}: the rows are not in order of time: sorted.")
            table = table.rows(order)
            values = columns_of(table, Series)
        check_increasing(table, values["time_s"], values["contact"])
        if sensors:
            raise DataError(
                f"{table.path} has no column sensor: its rows cannot be assigned to "
                f"the sensors of the file."
            )
    _remark_on_radians(table, values["bearing_deg"])
    values["mirrored_bearing_deg"] = _mirrored(table, values)
    values["bearing_deg"] = values["bearing_deg"] % 360.0
    series = Series(**values, contact_numbers=_contact_numbers(table), where=table.where)
    _check_one_unit(table, series)
    return series if "sensor" not in table else _placed(series, table, sensors)


def sensor_of_rows(series: Series) -> Sensor | None:
    """Return the one sensor whose fixed place every row of a table gives, or None.

    Parameters
    ----------
    series
        Measurements as `read_series` returns them.

    Returns
    -------
    Sensor | None
        Its identifier and place; None where rows name no sensor, several, or places
        that differ.
    """
    east, north = series.sensor_east_m, series.sensor_north_m
    if series.sensor is None or east is None or north is None:
        return None
    if np.ptp(east) or np.ptp(north) or np.unique(series.sensor).size > 1:
        return None
    name = str(series.sensor[0])
    if series.origin_latitude is None or series.origin_longitude is None:
        return Sensor(id=name, east_m=float(east[0]), north_m=float(north[0]))
    origin = Origin(series.origin_latitude, series.origin_longitude)
    latitude, longitude = to_latitude_longitude(east[:1], north[:1], origin)
    return Sensor(id=name, latitude=float(latitude[0]), longitude=float(longitude[0]))


FEWEST_IN_A_UNIT = 3
"""Rows of either unit that a column must hold before it is told to mix them."""

SMOOTHER, NEARER = 10.0, 3.0
"""Times by which radians are smoother than the degrees beside them (57 are due), and by
which they are nearer to them as degrees."""


def _check_one_unit(table: Table, series: Series) -> None:
    """Refuse a column whose rows change to radians, or from them, at some line.

    A source that crosses north, or lies there, has bearings as small; but they scatter as
    the others do, and do not fit the others better when they are multiplied by 57.
    """
    heard_by = table.cells.get("sensor")
    names, number = (
        (np.array([""]), np.zeros_like(series.contact)) if heard_by is None
        else np.unique(np.array(heard_by), return_inverse=True)
    )  # fmt: skip
    for contact, k in np.unique(np.stack([series.contact, number]), axis=1).T:
        name = names[k]
        is_own = (series.contact == contact) & (number == k)
        rows = np.flatnonzero(is_own & ~np.isnan(series.bearing_deg))
        rows = rows[np.argsort(series.time_s[rows], kind="stable")]
        bearing = series.bearing_deg[rows]
        is_small = np.abs(bearing) <= FULL_TURN + 1e-6
        small, large = np.flatnonzero(is_small), np.flatnonzero(~is_small)
        if min(small.size, large.size) < FEWEST_IN_A_UNIT:
            continue
        first, last = int(small[0]), int(small[-1])
        if small.size < 0.8 * (last - first + 1):
            continue
        edge = int(large[large > last][0] if first == 0 else first - 1)
        inner = small[-FEWEST_IN_A_UNIT:] if first == 0 else small[:FEWEST_IN_A_UNIT]
        scatter = np.median(_turns(np.diff(bearing[large])))
        is_smooth = 0.0 < SMOOTHER * np.median(np.abs(np.diff(bearing[small]))) < scatter
        as_read = np.median(_turns(bearing[inner] - bearing[edge]))
        as_radians = np.median(_turns(np.degrees(bearing[inner]) - bearing[edge]))
        if is_smooth and NEARER * as_radians < as_read:
            by = f" by {name}" if name else ""
            table.fail(
                int(rows[first]),
                f"bearing_deg is {bearing[first]:g}, and {bearing[edge]:g} in line "
                f"{table.lines[rows[edge]]}: {small.size} of {rows.size} bearings{by} "
                f"seem to be radians; degrees are accepted.",
            )


def _turns(difference: FloatArray) -> FloatArray:
    """Return the sizes of differences of bearings, the short way round, degrees."""
    return np.asarray(np.abs((difference + 180.0) % 360.0 - 180.0))


def _unrepeated(table: Table, time_s: FloatArray) -> IntArray:
    """Return the rows that are not repeated cell by cell, and say how many are."""
    order = np.argsort(time_s, kind="stable")
    is_same = np.diff(time_s[order]) == 0.0  # rows of other times cannot be repeated
    seen = set[tuple[str, ...]]()
    again: list[int] = []
    for row in np.sort(order[np.append(False, is_same) | np.append(is_same, False)]):
        cells = tuple(column[row] for column in table.cells.values())
        if cells in seen:
            again.append(row)
        seen.add(cells)
    if again:
        note(
            f"{table.path}: {len(again)} repeated rows are left out, the first in line "
            f"{table.lines[again[0]]}."
        )
    return np.delete(np.arange(time_s.size), again)


def _mirrored(table: Table, values: Mapping[str, Any]) -> FloatArray | None:
    """Return the bearings that an array hears alike; None where there is no array."""
    mirrored: FloatArray | None = values["mirrored_bearing_deg"]
    if "array_heading_deg" in table:
        if mirrored is not None:
            raise DataError(
                f"{table.path} gives the array's other side twice: array_heading_deg "
                f"and mirrored_bearing_deg."
            )
        heading = table.measured("array_heading_deg", BEARING)
        mirrored = 2.0 * heading - values["bearing_deg"]
    return None if mirrored is None else mirrored % 360.0


Place = tuple[FloatArray, FloatArray, Origin | None]
"""East and north of every row, m, and the origin that they count from, if known."""


def _contact_numbers(table: Table) -> str:
    """Return whose the numbers of contacts are: what the table says, or what is usual."""
    if "contact_numbers" not in table:
        return "own" if "contact" in table or "sensor" not in table else "common"
    told = table.cells["contact_numbers"]
    for row, text in enumerate(told):
        if text not in {"own", "common"} or text != told[0]:
            table.fail(
                row, f"contact_numbers must be own or common in all rows, got {shown(text)}."
            )
    return told[0] if told else "own"


def _placed(series: Series, table: Table, sensors: Sequence[Sensor] | None) -> Series:
    """Say of every row which sensor heard it, and where that was."""
    names = table.cells["sensor"]
    known = {sensor.id: sensor for sensor in sensors or ()}
    _check_names(table, known)
    if known:
        series = _as_sensors_say(series, known)
    place = _places_in_rows(table)
    if place is None and known:
        place = _places_by_file(series, table, known)
    if place is None:
        return series
    east, north, origin = place
    return replace(
        series,
        sensor_east_m=east,
        sensor_north_m=north,
        origin=f"sensor {names[0]}" if origin else "grid",
        origin_latitude=origin.latitude if origin else None,
        origin_longitude=origin.longitude if origin else None,
    )


def _check_names(table: Table, known: Mapping[str, Sensor]) -> None:
    for row, name in enumerate(table.cells["sensor"]):
        if not name:
            table.fail(row, "the sensor that received it is not named.")
        if known and name not in known:
            has = ", ".join(known)
            table.fail(row, f"sensor {shown(name)} is not in the sensor file, which has {has}.")


def _as_sensors_say(series: Series, known: Mapping[str, Sensor]) -> Series:
    """Apply clock and compass offsets, and keep what is known of each sensor."""
    names = [] if series.sensor is None else series.sensor.tolist()
    used = list(dict.fromkeys(names))
    late = np.array([known[name].clock_offset_s for name in names])
    turned = np.array([known[name].compass_offset_deg for name in names])
    mirrored = series.mirrored_bearing_deg
    return replace(
        series,
        time_s=series.time_s + late,
        bearing_deg=(series.bearing_deg + turned) % 360.0,
        mirrored_bearing_deg=None if mirrored is None else (mirrored + turned) % 360.0,
        sensor_id=np.array(used, np.str_),
        sensor_compass_std_deg=_told(known, used, "compass_std_deg"),
        sensor_position_std_m=_told(known, used, "position_std_m"),
    )


def _places_in_rows(table: Table) -> Place | None:
    """Return the places that the rows themselves give; None where they do not."""
    if "sensor_latitude" in table or "sensor_longitude" in table:
        table.need("sensor_latitude", "sensor_longitude")
        return _geographic_rows(
            table.numbers("sensor_latitude", -90.0, 90.0),
            table.numbers("sensor_longitude", -180.0, 360.0),
        )
    if "sensor_east_m" in table or "sensor_north_m" in table:
        table.need("sensor_east_m", "sensor_north_m")
        return table.numbers("sensor_east_m"), table.numbers("sensor_north_m"), None
    return None


def _told(known: Mapping[str, Sensor], used: Sequence[str], name: str) -> FloatArray:
    values = [getattr(known[one], name) for one in used]
    return np.array([np.nan if value is None else value for value in values], float)


def _geographic_rows(latitude: FloatArray, longitude: FloatArray) -> Place:
    origin = Origin(float(latitude[0]), float(longitude[0]))
    return *places_on_grid(latitude, longitude, origin), origin


def _places_by_file(series: Series, table: Table, known: Mapping[str, Sensor]) -> Place:
    """Return where the sensor file puts every row, on one grid."""
    names = np.array(table.cells["sensor"])
    used = dict.fromkeys(names.tolist())
    origins = {name: _origin_of(known[name]) for name in used}
    placed = {name: _is_local(known[name]) for name in used}
    for name in used:
        if origins[name] is None and not placed[name]:
            table.fail(
                int(np.flatnonzero(names == name)[0]),
                f"the sensor file does not say where sensor {name!r} is: give latitude "
                f"and longitude, east_m and north_m, or navigation.",
            )
    geographic = [origin for origin in origins.values() if origin is not None]
    if geographic and len(geographic) < len(used):
        local = next(name for name in used if origins[name] is None)
        table.fail(
            int(np.flatnonzero(names == local)[0]),
            f"sensor {local!r} is on a local grid and others have latitude and "
            f"longitude: give all positions of one kind.",
        )
    first = geographic[0] if geographic else None
    east, north = np.zeros(names.size), np.zeros(names.size)
    for name in used:
        rows = np.flatnonzero(names == name)
        own = origins[name]
        way = _way(known[name], series, table, rows)
        if first is None or own is None:
            east[rows], north[rows] = way
        elif np.ptp(way[0]) == 0.0 and np.ptp(way[1]) == 0.0 and not way[0].any():
            east[rows], north[rows] = to_grid(*own, first)
        else:
            place = to_latitude_longitude(*way, own)
            east[rows], north[rows] = places_on_grid(*place, first)
    return east, north, first


def _origin_of(sensor: Sensor) -> Origin | None:
    """Return where the metres of a sensor's way count from; None on a local grid."""
    way = sensor.navigation
    if way is not None:
        if way.origin_latitude is None or way.origin_longitude is None:
            return None
        return Origin(way.origin_latitude, way.origin_longitude)
    if sensor.latitude is None or sensor.longitude is None:
        return None
    return Origin(sensor.latitude, sensor.longitude)


def _is_local(sensor: Sensor) -> bool:
    return sensor.navigation is not None or sensor.east_m is not None


SLACK_S = 60.0
"""Time by which rows may lie beyond a sensor's navigation."""


def _way(
    sensor: Sensor, series: Series, table: Table, rows: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return where a sensor was at its rows, from the origin of its own grid."""
    navigation: Navigation | None = sensor.navigation
    if navigation is None:
        east = 0.0 if sensor.latitude is not None else float(sensor.east_m or 0.0)
        north = 0.0 if sensor.latitude is not None else float(sensor.north_m or 0.0)
        return np.full(rows.size, east), np.full(rows.size, north)
    time = navigation.time_s
    if navigation.start_utc_ns is not None and series.start_utc_ns is not None:
        time = time + (navigation.start_utc_ns - series.start_utc_ns) / NANOSECONDS
    wanted = series.time_s[rows]
    outside = (wanted < time[0] - SLACK_S) | (wanted > time[-1] + SLACK_S)
    for index in np.flatnonzero(outside)[:1]:
        table.fail(
            int(rows[index]),
            f"the navigation of sensor {sensor.id!r} covers {time[0]:g} to "
            f"{time[-1]:g} s, not {wanted[index]:g} s: do both count from one start?",
        )
    return (np.interp(wanted, time, navigation.east_m), np.interp(wanted, time, navigation.north_m))


def _remark_on_radians(table: Table, bearing: FloatArray) -> None:
    known = bearing[np.isfinite(bearing)]
    if known.size >= ENOUGH_ROWS and np.all(np.abs(known) <= FULL_TURN):
        first = int(np.flatnonzero(np.isfinite(bearing))[0])
        warn(
            f"{table.where(first)}: bearing_deg is {bearing[first]:g}, and every bearing "
            f"of the table lies within {FULL_TURN:.3f} degrees of north; if these are "
            f"radians, convert them to degrees."
        )
