"""One grid and one clock for the encounters of several sensors.

**Method.** Sensors with latitude and longitude share a grid about the first of them;
sensors on a local grid keep it; a single sensor without a position is the origin.

**Conventions.** Times count from the first sample of the earliest recording.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin, to_grid
from uwtrack_cli.constants import NANOSECONDS, SOURCE_DEPTH_M
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.directions import LINE, Directions
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.series import Series
from uwtrack_cli.errors import DataError
from uwtrack_cli.motion.fusion.motion_fit import Approaches
from uwtrack_cli.motion.passage.model.direction_bearings import bearing_series

CLOCK_STD_S = 5.0
"""Deviation of the clocks of several recorders where none is given, s."""

SIDES = {"starboard": 1.0, "port": -1.0}
"""Sign of the bearing trend by the side of the vessel on which the sensor lies."""

USABLE = ("ok", "extrapolated", "level-only", "no-speed")


@dataclass(frozen=True)
class Grid:
    """The common grid: its name, its origin, and where the sensors are."""

    name: str
    """What the grid is relative to: a sensor or 'grid'."""
    origin: Origin | None
    """Latitude and longitude of its origin; None on a local grid."""
    place: dict[str, tuple[float, float]]
    """East and north of every sensor, m, by its identifier."""


class OtherLeg(NamedTuple):
    """How a vessel moved on the other side of a manoeuvre."""

    time_s: float
    """When it manoeuvred, s."""
    time_std_s: float
    """Its standard deviation, s."""
    is_later: bool
    """Whether that leg follows the manoeuvre; else it goes before."""
    course_deg: float
    """Course at closest approach, degrees."""
    turn: float
    """+1 if the sensor lies to starboard there, -1 to port."""
    along_away_mps: FloatArray
    """Velocity there, along the course at closest approach and away from the sensor,
    m/s, shape (2,); nan where its course is not known."""
    std_mps: FloatArray
    """Deviations of its speed, and across it, m/s, shape (2,)."""


class EvenTurn(NamedTuple):
    """How a vessel turned evenly about its passage."""

    closest_s: float
    """Time of its closest approach, s."""
    course_deg: float
    """Course there, degrees."""
    turn: float
    """+1 if the sensor lies to starboard there, -1 to port; nan where it is not known
    or the sensor moves."""
    values: FloatArray
    """Angle away from the sensor (rad), duration (s) and middle (s), shape (3,)."""
    covariance: FloatArray
    """Their covariance, shape (3, 3)."""


@dataclass(frozen=True)
class Passages:
    """All usable encounters, one row each, on one grid and one clock."""

    approaches: Approaches
    """The closest approaches as numbers, one row each."""
    contact: list[int]
    """Contact number of every row."""
    sensor: list[str]
    """Identifier of the sensor of every row."""
    rest: list[FloatArray]
    """Rest frequencies and deviations of every row, Hz, shape (lines, 2)."""
    other_turn: list[float]
    """Weight of the opposite side of every row, 0 to 1."""
    start_utc_ns: int | None
    """UTC epoch of time zero, ns; None if unknown."""
    clock_std_s: FloatArray
    """Deviation of the clock of every row, s, shape (rows,)."""
    grid: Grid
    """The common grid."""
    other_leg: list[OtherLeg | None]
    """The other leg of every row; None for a straight passage."""
    even_turn: list[EvenTurn | None]
    """The steady turn of every row; None where it has none."""


def make_grid(sensors: list[Sensor], wanted: set[str]) -> Grid:
    """Lay one grid under the sensors with encounters, whose identifiers are wanted."""
    used = [_at_origin(sensor) for sensor in sensors if sensor.id in wanted]
    missing = wanted - {sensor.id for sensor in used}
    is_placed = [s.latitude is not None or s.east_m is not None for s in used]
    if len(wanted) <= 1 and not (used and all(is_placed)):
        name = next(iter(wanted), "sensor")
        return Grid(f"sensor {name}", None, {name: (0.0, 0.0)})
    if missing:
        raise DataError(f"no sensor file for {', '.join(sorted(missing))}: give one with its id.")
    if all(s.latitude is not None and s.longitude is not None for s in used):
        origin = Origin(float(used[0].latitude or 0), float(used[0].longitude or 0))
        place = {
            s.id: to_grid(float(s.latitude or 0), float(s.longitude or 0), origin) for s in used
        }
        return Grid(f"sensor {used[0].id}", origin, place)
    if all(s.east_m is not None and s.north_m is not None for s in used):
        place = {s.id: (float(s.east_m or 0), float(s.north_m or 0)) for s in used}
        return Grid("grid", None, place)
    raise DataError(
        "the sensors need positions of one kind: latitude and longitude, or east_m "
        "and north_m, for every sensor."
    )


def _at_origin(sensor: Sensor) -> Sensor:
    """Place a moving sensor at the origin of its navigation."""
    navigation = sensor.navigation
    if navigation is None:
        return sensor
    if navigation.origin_latitude is None:
        return replace(sensor, east_m=0.0, north_m=0.0)
    return replace(
        sensor, latitude=navigation.origin_latitude, longitude=navigation.origin_longitude
    )


def gather_passages(encounters: list[Encounters], sensors: list[Sensor]) -> Passages:
    """Bring the usable encounters of any number of sensors together."""
    names = {str(name) for item in encounters for name in item.sensor}
    known = {sensor.id: sensor for sensor in sensors}
    grid = make_grid(sensors, names)
    start = _start_utc_ns(encounters)
    rows = [
        (item, row)
        for item in encounters
        for row in range(item.time_s.size)
        if item.status[row] in USABLE and np.isfinite(item.time_s[row])
    ]
    clocks = _clock_deviations(known, [str(item.sensor[row]) for item, row in rows])
    parts = [
        _approach(item, row, known, (grid, start, float(clock)))
        for (item, row), clock in zip(rows, clocks, strict=True)
    ]
    times_s = [float(part.measured[0, 0]) for part in parts]
    return Passages(
        _stack(parts),
        [int(item.contact[row]) for item, row in rows],
        [str(item.sensor[row]) for item, row in rows],
        [
            np.stack([item.rest_frequency_hz, item.rest_frequency_std_hz], axis=-1)[
                item.rest_encounter == row
            ]
            for item, row in rows
        ],
        [_other_turn(item, row) for item, row in rows],
        start,
        clocks,
        grid,
        [_other_leg(*place, at) for place, at in zip(rows, times_s, strict=True)],
        [_even_turn(*place, at) for place, at in zip(rows, times_s, strict=True)],
    )


def _even_turn(item: Encounters, row: int, time_s: float) -> EvenTurn | None:
    """Return the steady turn of an encounter whose closest approach is at a time."""
    angle, angle_std, duration, duration_std, correlation, at, at_std = _values(
        row, item.turn_away_deg, item.turn_away_std_deg, item.turn_duration_s,
        item.turn_duration_std_s, item.turn_correlation, item.change_time_s,
        item.change_time_std_s,
    )  # fmt: skip
    if not np.isfinite(angle):
        return None
    side = SIDES.get(str(item.side[row]), np.nan)
    std = np.array([np.radians(angle_std), duration_std, at_std])
    covariance = np.diag(std**2)
    covariance[0, 1] = covariance[1, 0] = correlation * std[0] * std[1]
    middle = time_s + at - float(item.time_s[row])
    return EvenTurn(
        time_s, float(item.course_deg[row]), np.nan if _is_moving(item, row) else side,
        np.array([np.radians(angle), duration, middle]), covariance,
    )  # fmt: skip


def _other_leg(item: Encounters, row: int, time_s: float) -> OtherLeg | None:
    """Return the other leg of an encounter whose closest approach is at a time."""
    at, at_std, speed, speed_std, course, course_std = _values(
        row, item.change_time_s, item.change_time_std_s, item.other_leg_speed_mps,
        item.other_leg_speed_std_mps, item.other_leg_course_deg,
        item.other_leg_course_std_deg,
    )  # fmt: skip
    if not np.isfinite(speed):
        return None
    after = at - float(item.time_s[row])
    main = float(item.course_deg[row])
    turn = SIDES.get(str(item.side[row]), np.nan)
    angle = np.radians(course - main)
    return OtherLeg(
        time_s + after, at_std, after > 0, main, turn,
        speed * np.array([np.cos(angle), -turn * np.sin(angle)]),
        np.array([speed_std, speed * np.radians(course_std)]),
    )  # fmt: skip


def _clock_deviations(known: dict[str, Sensor], names: list[str]) -> FloatArray:
    """Return the deviation of the clock of every row; one recorder has one clock."""
    if len(set(names)) < 2:
        stated = [known[name].clock_std_s if name in known else None for name in names]
        return np.array([std or 0.0 for std in stated])
    return np.array(
        [CLOCK_STD_S if (std := known[name].clock_std_s) is None else std for name in names]
    )


def _other_turn(encounters: Encounters, row: int) -> float:
    """Weight of the opposite side, from the ambiguities of an encounter."""
    rows = encounters.owned_rows("ambiguity_encounter", row)
    return float(encounters.ambiguity_weight[rows].sum())


SOME_STARTS = (
    "some recordings have a start time and some have none: give all of them one "
    "(--start-utc or --time-pattern), or none."
)


def _start_utc_ns(encounters: list[Encounters]) -> int | None:
    starts = [
        int(item.time_utc_ns[row]) - round(float(item.time_s[row]) * NANOSECONDS)
        for item in encounters
        for row in range(item.time_s.size)
        if item.time_utc_ns[row] >= 0
    ]
    unknown = any(
        item.time_utc_ns[row] < 0 and np.isfinite(item.time_s[row])
        for item in encounters
        for row in range(item.time_s.size)
    )
    if starts and unknown:
        raise DataError(SOME_STARTS)
    return min(starts) if starts else None


def _approach(
    item: Encounters, row: int, known: dict[str, Sensor], common: tuple[Grid, int | None, float]
) -> Approaches:
    grid, start, clock_std_s = common
    name = str(item.sensor[row])
    sensor = known.get(name, Sensor(id=name))
    speed = float(item.speed_mps[row])
    time = float(item.time_s[row])
    if start is not None:
        time = (int(item.time_utc_ns[row]) - start) / NANOSECONDS
    if not np.isfinite(speed):
        time += float(item.arrival_time_s[row] - item.time_s[row])
    height = 0.0 if sensor.depth_m is None else abs(sensor.depth_m - SOURCE_DEPTH_M)
    width, covariance = float(item.range_over_speed_s[row]), item.covariance[row]
    horizontal, own = item.horizontal_range_over_speed_s, item.horizontal_covariance
    if horizontal is not None and own is not None and np.isfinite(horizontal[row]):
        width, covariance, height = float(horizontal[row]), own[row], 0.0
    turn = SIDES.get(str(item.side[row]), 0.0)
    place: FloatArray = np.array(grid.place[name])
    velocity: FloatArray = np.zeros(2)
    if _is_moving(item, row):
        place = place + _values(row, item.sensor_east_m, item.sensor_north_m)
        velocity = np.array(
            _values(row, item.sensor_velocity_east_mps, item.sensor_velocity_north_mps)
        )
        course = np.deg2rad(item.course_deg[row])
        ground = speed * np.array([np.sin(course), np.cos(course)])
        speed = float(np.hypot(*(ground - velocity)))
        # the side of the relative motion is the sign of the bearing trend
        relative = np.arctan2(*(ground - velocity)) - np.deg2rad(item.bearing_deg[row])
        turn = float(np.nan_to_num(np.sign(np.sin(relative))))
    values = np.array([time, width, speed, np.deg2rad(item.bearing_deg[row])])
    unit = np.array([1.0, 1.0, 1.0, np.deg2rad(1.0)])
    covariance = covariance * unit[:, None] * unit[None, :]
    covariance[0, 0] += clock_std_s**2
    known_values = np.isfinite(np.diag(covariance)) & np.isfinite(values)
    delay = 0.0 if np.isfinite(speed) else 1 / float(item.sound_speed_mps[row])
    return Approaches(
        np.where(known_values, values, np.nan)[None],
        covariance[None],
        np.array([turn]),
        place[None],
        np.array([sensor.position_std_m]),
        np.array([height]),
        np.array([delay]),
        velocity[None],
    )


def _is_moving(item: Encounters, row: int) -> bool:
    east = item.sensor_velocity_east_mps
    return east is not None and bool(np.isfinite(east[row]))


def _values(row: int, *columns: FloatArray | None) -> list[float]:
    """Return a row of some columns; nan of those that are not there."""
    return [np.nan if values is None else float(values[row]) for values in columns]


def _stack(parts: list[Approaches]) -> Approaches:
    none = Approaches(
        np.empty((0, 4)), np.empty((0, 4, 4)), np.empty(0), np.empty((0, 2)),
        np.empty(0), np.empty(0), np.empty(0), np.empty((0, 2)),
    )  # fmt: skip
    return Approaches.join(parts or [none])


def bearings_of_arrays(directions: list[Directions], sensors: list[Sensor]) -> Series:
    """Return the directions that arrays at several places heard, as one table.

    Every source that an array follows is a contact of its own number there. Those of a
    line have their bearings on both of its sides.

    Raises
    ------
    DataError
        An array has no place, cannot tell one side from the other, or some recordings
        have a start time and others none.
    """
    known = {sensor.id: sensor for sensor in sensors}
    names = [one.sensor for one in directions]
    grid = make_grid(sensors, set(names))
    sides = [one.sensor for one in directions if one.ambiguity == "plane"]
    if sides:
        raise DataError(
            f"array {sides[0]} does not tell one side of its plane from the other: its "
            f"directions are not joined with those of others."
        )
    starts = [one.start_utc_ns for one in directions]
    told = [start for start in starts if start is not None]
    if told and len(told) < len(starts):
        raise DataError(SOME_STARTS)
    first = min(told) if told else None
    is_open = any(one.ambiguity == LINE for one in directions)
    parts = []
    for one in directions:
        heard = bearing_series(one)
        if is_open and heard.mirrored_bearing_deg is None:
            resolved = np.full(heard.time_s.size, np.nan)
            heard = replace(heard, mirrored_bearing_deg=resolved)
        if heard.start_utc_ns is not None and first is not None:
            late_s = (heard.start_utc_ns - first) / NANOSECONDS
            heard = replace(heard, time_s=heard.time_s + late_s, start_utc_ns=first)
        east, north = _way_of(known[one.sensor], heard) if one.sensor in known else (
            np.zeros((2, heard.time_s.size)))  # fmt: skip
        place = grid.place[one.sensor]
        parts.append(
            replace(
                heard,
                sensor=np.full(heard.time_s.size, one.sensor),
                sensor_east_m=place[0] + east,
                sensor_north_m=place[1] + north,
            )
        )
    used = [known.get(name, Sensor(id=name)) for name in dict.fromkeys(names)]
    return replace(
        Series.join(parts),
        sensor_id=np.array([one.id for one in used], np.str_),
        sensor_compass_std_deg=np.array([_or_nan(s.compass_std_deg) for s in used]),
        sensor_position_std_m=np.array([_or_nan(s.position_std_m) for s in used]),
        origin=grid.name,
        origin_latitude=grid.origin.latitude if grid.origin else None,
        origin_longitude=grid.origin.longitude if grid.origin else None,
    )


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value


def _way_of(sensor: Sensor, heard: Series) -> tuple[FloatArray, FloatArray]:
    """Return where a sensor was at its rows, m from where its grid begins."""
    way = sensor.navigation
    if way is None:
        return np.zeros(heard.time_s.size), np.zeros(heard.time_s.size)
    time = way.time_s
    if way.start_utc_ns is not None and heard.start_utc_ns is not None:
        time = time + (way.start_utc_ns - heard.start_utc_ns) / NANOSECONDS
    return (np.interp(heard.time_s, time, way.east_m), np.interp(heard.time_s, time, way.north_m))
