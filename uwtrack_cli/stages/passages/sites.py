"""One grid and one clock for the encounters of several sensors.

**Method.** Sensors with latitude and longitude share a grid about the first of them;
sensors on a local grid keep it; a single sensor without a position is the origin.

**Conventions.** Times count from the first sample of the earliest recording.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.constants import NANOSECONDS, SOURCE_DEPTH_M
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError
from uwtrack_cli.estimation.passages.motion_fit import Approaches
from uwtrack_cli.physics.geodesy import Origin, to_grid

USABLE = ("ok", "extrapolated", "level-only")


@dataclass(frozen=True)
class Grid:
    """The common grid: its name, its origin, and where the sensors are."""

    name: str
    origin: Origin | None
    place: dict[str, tuple[float, float]]


@dataclass(frozen=True)
class Passages:
    """All usable encounters, one row each, on one grid and one clock."""

    approaches: Approaches
    contact: list[int]
    sensor: list[str]
    rest: list[FloatArray]
    other_turn: list[float]
    start_utc_ns: int | None
    grid: Grid


def make_grid(sensors: list[Sensor], wanted: set[str]) -> Grid:
    """Lay one grid under the sensors.

    Parameters
    ----------
    sensors
        Sensors known.
    wanted
        Identifiers of those with encounters.
    """
    used = [sensor for sensor in sensors if sensor.id in wanted]
    missing = wanted - {sensor.id for sensor in used}
    if len(wanted) <= 1 and not (used and _is_placed(used)):
        name = next(iter(wanted), "sensor")
        return Grid(f"sensor {name}", None, {name: (0.0, 0.0)})
    if missing:
        msg = f"no sensor file for {', '.join(sorted(missing))}: give one with its id."
        raise DataError(msg)
    if all(s.latitude is not None and s.longitude is not None for s in used):
        origin = Origin(float(used[0].latitude or 0), float(used[0].longitude or 0))
        place = {
            s.id: to_grid(float(s.latitude or 0), float(s.longitude or 0), origin)
            for s in used
        }
        return Grid(f"sensor {used[0].id}", origin, place)
    if all(s.east_m is not None and s.north_m is not None for s in used):
        place = {s.id: (float(s.east_m or 0), float(s.north_m or 0)) for s in used}
        return Grid("grid", None, place)
    msg = (
        "the sensors need positions of one kind: latitude and longitude, or east_m "
        "and north_m, for every sensor."
    )
    raise DataError(msg)


def _is_placed(sensors: list[Sensor]) -> bool:
    return all(s.latitude is not None or s.east_m is not None for s in sensors)


def gather_passages(encounters: list[Encounters], sensors: list[Sensor]) -> Passages:
    """Bring the usable encounters together.

    Parameters
    ----------
    encounters
        Encounters of any number of sensors.
    sensors
        The sensors, found by their identifiers.
    """
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
    parts = [_approach(item, row, known, (grid, start)) for item, row in rows]
    return Passages(
        _stack(parts),
        [int(item.contact[row]) for item, row in rows],
        [str(item.sensor[row]) for item, row in rows],
        [
            np.stack(
                [
                    item.rest_frequency_hz[item.rest_encounter == row],
                    item.rest_frequency_std_hz[item.rest_encounter == row],
                ],
                axis=-1,
            )
            for item, row in rows
        ],
        [_other_turn(str(item.ambiguities[row])) for item, row in rows],
        start,
        grid,
    )


def _other_turn(text: str) -> float:
    """Weight of the opposite side, from the ambiguities of an encounter."""
    import json

    return sum(
        float(item.get("weight", 0.0)) for item in json.loads(text) if "side" in item
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
        msg = (
            "some recordings have a start time and some have none: give all of them "
            "one (--start-utc or --time-pattern), or none."
        )
        raise DataError(msg)
    return min(starts) if starts else None


def _approach(
    item: Encounters,
    row: int,
    known: dict[str, Sensor],
    common: tuple[Grid, int | None],
) -> Approaches:
    grid, start = common
    name = str(item.sensor[row])
    sensor = known.get(name, Sensor(id=name))
    speed = float(item.speed_mps[row])
    time = float(item.time_s[row])
    if start is not None:
        time = (int(item.time_utc_ns[row]) - start) / NANOSECONDS
    values = np.array(
        [
            time,
            item.range_over_speed_s[row],
            speed,
            np.deg2rad(item.bearing_deg[row]),
        ]
    )
    unit = np.array([1.0, 1.0, 1.0, np.deg2rad(1.0)])
    covariance = item.covariance[row] * unit[:, None] * unit[None, :]
    covariance[0, 0] += sensor.clock_std_s**2
    turn = {"starboard": 1.0, "port": -1.0}.get(str(item.side[row]), 0.0)
    height = 0.0 if sensor.depth_m is None else abs(sensor.depth_m - SOURCE_DEPTH_M)
    known_values = np.isfinite(np.diag(covariance)) & np.isfinite(values)
    delay = 0.0 if np.isfinite(speed) else 1 / float(item.sound_speed_mps[row])
    return Approaches(
        np.where(known_values, values, np.nan)[None],
        covariance[None],
        np.array([turn]),
        np.array([grid.place[name]]),
        np.array([sensor.position_std_m]),
        np.array([height]),
        np.array([delay]),
    )


def _stack(parts: list[Approaches]) -> Approaches:
    if not parts:
        return Approaches(
            np.empty((0, 4)), np.empty((0, 4, 4)), np.empty(0), np.empty((0, 2)),
            np.empty(0), np.empty(0), np.empty(0),
        )  # fmt: skip
    return Approaches(
        np.concatenate([part.measured for part in parts]),
        np.concatenate([part.covariance for part in parts]),
        np.concatenate([part.turn for part in parts]),
        np.concatenate([part.sensor for part in parts]),
        np.concatenate([part.position_std_m for part in parts]),
        np.concatenate([part.height_m for part in parts]),
        np.concatenate([part.delay for part in parts]),
    )
