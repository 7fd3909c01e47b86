"""Results as geographic features: sensors, closest approaches, tracks, positions, motions.

**Method.** Places are taken from the sensor along geodesics. An uncertainty is the
ellipse that holds the true position with 95 % probability, as a polygon.

**Conventions.** Coordinates are (longitude, latitude) in degrees, WGS 84; polygons
are closed and run counter-clockwise. A track reaches three ranges before and after
its closest approach, that of a motion from the first measurement to the last one.
Longitudes of one feature do not jump at the date line.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin, to_latitude_longitude
from uwtrack_cli.acoustics.geometry import compass_unit, place_covariance, region_95
from uwtrack_cli.data.base import Container, FloatArray
from uwtrack_cli.data.encounters import Encounters, Fixes
from uwtrack_cli.data.motions import Motions
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, warn
from uwtrack_cli.files.tables.json_rows import json_rows

TRACK_RANGES = 3.0
C = TypeVar("C", bound=Container)


@dataclass(frozen=True)
class Feature:
    """One thing on the map."""

    kind: Literal["sensor", "encounter", "track", "fix", "motion", "ellipse"]
    """What it shows: 'fix', 'track', 'sensor' ..."""
    shape: Literal["Point", "LineString", "Polygon"]
    """'Point', 'LineString' or 'Polygon'."""
    name: str
    """Title."""
    places: tuple[tuple[float, float], ...]
    """Longitude and latitude of each point, degrees."""
    properties: dict[str, Any] = field(default_factory=dict)
    """Facts, as plain values."""


def geographic_features(containers: Sequence[Container], name: str) -> list[Feature]:
    """Return everything in a product that has a place on Earth.

    Raises
    ------
    DataError
        Nothing has a latitude and longitude.
    """
    sensors = {s.id: s for s in _of(containers, Sensor) if s.latitude is not None}
    found = [_sensor(sensor) for sensor in sensors.values()]
    for encounters in _of(containers, Encounters):
        found += _encounters(encounters, sensors)
    for fixes in _of(containers, Fixes):
        found += _fixes(fixes)
    for motions in _of(containers, Motions):
        found += _motions(motions)
    if not found:
        raise DataError(
            f"{name} has nothing with latitude and longitude: give them in the sensor "
            f"file and run again, or export to csv."
        )
    _remark(containers, found, name)
    return found


def _remark(containers: Sequence[Container], found: Sequence[Feature], name: str) -> None:
    """Say which encounters have no place on the map: they are not left out in silence."""
    n_found = sum(e.n_encounters for e in _of(containers, Encounters))
    n_placed = sum(feature.kind == "encounter" for feature in found)
    if n_placed < n_found:
        warn(
            f"{n_found - n_placed} of {n_found} encounters of {name} have no place on "
            f"the map, which takes a bearing and a range; export to csv holds them."
        )


def _of(containers: Sequence[Container], kind: type[C]) -> list[C]:
    return [c for c in containers if isinstance(c, kind)]


def _sensor(sensor: Sensor) -> Feature:
    place = (float(sensor.longitude or 0.0), float(sensor.latitude or 0.0))
    facts = {"id": sensor.id, "sensor_kind": sensor.kind, "depth_m": sensor.depth_m,
             "position_std_m": sensor.position_std_m}  # fmt: skip
    return Feature("sensor", "Point", sensor.id, (place,), facts)


def _encounters(encounters: Encounters, sensors: dict[str, Sensor]) -> Iterator[Feature]:
    for row, values in enumerate(json_rows(encounters)):
        sensor = sensors.get(values["sensor"])
        range_m = values["horizontal_range_m"] or values["slant_range_m"]
        if sensor is None or range_m is None or values["bearing_deg"] is None:
            continue
        origin = Origin(float(sensor.latitude or 0), float(sensor.longitude or 0))
        east, north = range_m * compass_unit(values["bearing_deg"])
        name = f"contact {values['contact']} at {values['sensor']}"
        place = _places(np.array([east]), np.array([north]), origin)
        yield Feature("encounter", "Point", name, place, values)
        if values["course_deg"] is None:
            continue
        course = np.radians(encounters.course_deg[row])
        along = np.linspace(-TRACK_RANGES, TRACK_RANGES, 25) * range_m
        track = _places(east + along * np.sin(course), north + along * np.cos(course), origin)
        known = {key: values[key] for key in ("contact", "sensor", "speed_mps")}
        yield Feature("track", "LineString", f"track of {name}", track, known)


def _fixes(fixes: Fixes) -> Iterator[Feature]:
    for row, values in enumerate(json_rows(fixes)):
        if values["latitude"] is None or values["longitude"] is None:
            continue
        name = f"contact {values['contact']}, mode {values['mode']}"
        place = (values["longitude"], values["latitude"])
        yield Feature("fix", "Point", name, (place,), values)
        covariance = fixes.covariance_m2[row]
        if np.isfinite(covariance).all():
            origin = Origin(values["latitude"], values["longitude"])
            told = ("contact", "mode", "time_s", "time_utc")
            known = {key: values[key] for key in told}
            ring = _ring(covariance, origin)
            yield Feature("ellipse", "Polygon", f"95 % region of {name}", ring,
                          {**known, "probability": 0.95})  # fmt: skip


def _motions(motions: Motions) -> Iterator[Feature]:
    """Yield the place at the first measurement, its region and the way to the last one.

    Only motions of sensors with latitude and longitude have a place.
    """
    for row, values in enumerate(json_rows(motions)):
        if values["latitude"] is None or values["longitude"] is None:
            continue
        del values["probability_of_rows"]  # one for each row of a table
        name = f"motion of contact {values['contact']}, mode {values['mode']}"
        place = (values["longitude"], values["latitude"])
        yield Feature("motion", "Point", name, (place,), values)
        known = {key: values[key] for key in ("contact", "mode")}
        origin = Origin(values["latitude"], values["longitude"])
        course = np.radians(motions.course_deg[row])
        way = motions.speed_mps[row] * (motions.now_time_s[row] - motions.time_s[row])
        if np.isfinite(way * course):
            to = np.array([0.0, way])
            track = _places(to * np.sin(course), to * np.cos(course), origin)
            yield Feature("track", "LineString", f"track of {name}", track, known)
        polar = motions.covariance[row][:2, :2]
        if np.isfinite(polar).all():
            where = float(motions.range_m[row]), float(motions.bearing_deg[row])
            ring = _ring(place_covariance(*where, polar), origin)
            yield Feature("ellipse", "Polygon", f"95 % region of {name}", ring,
                          {**known, "time_s": values["time_s"], "probability": 0.95})  # fmt: skip


def _ring(covariance: FloatArray, origin: Origin) -> tuple[tuple[float, float], ...]:
    east, north = region_95(covariance)
    return _places(east, north, origin)


def _places(east: FloatArray, north: FloatArray, origin: Origin) -> tuple[tuple[float, float], ...]:
    latitude, longitude = to_latitude_longitude(east, north, origin)
    smooth = longitude + 360.0 * np.round((origin.longitude - longitude) / 360.0)
    pairs = zip(smooth.tolist(), latitude.tolist(), strict=True)
    return tuple((round(x, 8), round(y, 8)) for x, y in pairs)
