"""Closest approaches of AIS vessels to a sensor, by geodesics.

**Method.** The positions of a vessel are brought to a grid about the sensor on which
distance and azimuth are those of the geodesic. Between two messages the position
follows the cubic through both positions with the speeds and courses over ground as its
slopes; every least distance of it to the sensor is found on a grid of a tenth of a
second and refined by the parabola through three points.

**Conventions.** Messages more than ``MAX_GAP_S`` apart leave a gap: nothing is said of
what happened in it. The horizontal range comes from the positions; the slant range
adds the sensor's depth, where it is known, over a source at ``SOURCE_DEPTH_M``.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin, places_on_grid
from uwtrack_cli.constants import SOURCE_DEPTH_M
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.truth import TruePassage, Truth, VesselTrack
from uwtrack_cli.flow.scoring.recorded_sensors import origin_of

MAX_GAP_S = 300.0
STEP_S = 0.1
ALONE_STEPS = 1200
"""A passage is the least distance within this many steps on either side."""
LEAST_SPEED_MPS = 0.5
"""A vessel slower than this drifts or lies at anchor: it does not pass."""
SPEED_STD_MPS = 0.1
COURSE_STD_DEG = 2.0
FAR_DEG = 1.0
"""Vessels further off than this in latitude are not looked at."""


def ais_passages(
    truth: Truth, sensor: Sensor, span_s: tuple[float, float], within_m: float
) -> Iterator[TruePassage]:
    """Yield the closest approaches to a sensor within a span of time.

    ``sensor``: the sensor; its latitude and longitude must be known. ``span_s``: begin
    and end of the recording on the clock of the truth, s. ``within_m``: largest range
    of a passage that counts, m.

    Raises
    ------
    DataError
        The latitude and longitude of the sensor are not known.
    """
    origin = origin_of(sensor)
    for track in truth.tracks:
        for approach in _approaches(track, origin, span_s):
            if np.hypot(*approach.place_m) <= within_m:
                yield _passage(truth, track, sensor, approach)


def interpolate_track(
    track: VesselTrack, east_m: FloatArray, north_m: FloatArray, time_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return positions of a vessel between its messages, nan in gaps.

    ``track``: the vessel; its speeds and courses are the slopes, where they are known.
    ``east_m``: its positions on a grid, m. ``north_m``: its positions on a grid, m.
    ``time_s``: times wanted, s.
    """
    at = np.clip(np.searchsorted(track.time_s, time_s, side="right") - 1, 0, len(east_m) - 2)
    gap = np.diff(track.time_s)[at]
    share = (time_s - track.time_s[at]) / gap
    outside = (share < 0.0) | (share > 1.0) | (gap > MAX_GAP_S)
    course = np.radians(track.course_deg)
    slopes = (track.speed_mps * np.sin(course), track.speed_mps * np.cos(course))
    found = []
    for values, slope in zip((east_m, north_m), slopes, strict=True):
        a, b = values[at], values[at + 1]
        chord = (b - a) / gap
        before = np.where(np.isnan(slope[at]), chord, slope[at]) * gap
        after = np.where(np.isnan(slope[at + 1]), chord, slope[at + 1]) * gap
        rise = b - a
        cubic = a + share * (
            before
            + share * ((3.0 * rise - 2.0 * before - after) + share * (before + after - 2.0 * rise))
        )
        found.append(np.where(outside, np.nan, cubic))
    return found[0], found[1]


class _Approach(NamedTuple):
    """A least distance of a vessel from a sensor, which is the origin."""

    time_s: float
    """When it was, from the start of the truth."""
    place_m: tuple[float, float]
    """Where the vessel was then: east and north."""
    velocity_mps: tuple[float, float]
    """Its velocity east and north."""


def _approaches(
    track: VesselTrack, origin: Origin, span_s: tuple[float, float]
) -> Iterator[_Approach]:
    """Yield time, place and velocity of every least distance in the span."""
    near = (track.time_s > span_s[0] - MAX_GAP_S) & (track.time_s < span_s[1] + MAX_GAP_S)
    if np.count_nonzero(near) < 2:
        return
    if np.abs(track.first[near] - origin.latitude).min() > FAR_DEG:
        return
    columns = ("time_s", "first", "second", "speed_mps", "course_deg")
    part = replace(track, **{name: getattr(track, name)[near] for name in columns})
    time_s = np.arange(span_s[0], span_s[1] + STEP_S, STEP_S)
    x, y = interpolate_track(part, *places_on_grid(part.first, part.second, origin), time_s)
    distance = np.hypot(x, y)
    middle = distance[1:-1]
    for dip in np.flatnonzero((middle < distance[:-2]) & (middle <= distance[2:])) + 1:
        around = slice(max(0, dip - ALONE_STEPS), dip + ALONE_STEPS)
        found = _refined(time_s, x, y, int(dip))
        is_least = distance[dip] <= np.nanmin(distance[around])
        if is_least and np.hypot(*found.velocity_mps) >= LEAST_SPEED_MPS:
            yield found


def _refined(time_s: FloatArray, x: FloatArray, y: FloatArray, dip: int) -> _Approach:
    below, here, above = np.hypot(x, y)[dip - 1 : dip + 2] ** 2
    bend = below - 2.0 * here + above
    shift = 0.5 * (below - above) / bend if bend > 0.0 else 0.0
    both = np.array([x, y])
    velocity = (both[:, dip + 1] - both[:, dip - 1]) / (2.0 * STEP_S)
    place = both[:, dip] + shift * STEP_S * velocity
    (east, north), (east_rate, north_rate) = place.tolist(), velocity.tolist()
    at = float(time_s[dip] + shift * STEP_S)
    return _Approach(at, (east, north), (east_rate, north_rate))


def _passage(truth: Truth, track: VesselTrack, sensor: Sensor, approach: _Approach) -> TruePassage:
    time_s, (east, north), (east_rate, north_rate) = approach
    range_m, speed = (float(np.hypot(east, north)), float(np.hypot(east_rate, north_rate)))
    height = 0.0 if sensor.depth_m is None else sensor.depth_m - SOURCE_DEPTH_M
    slant_m = float(np.hypot(range_m, height))
    right = -east * north_rate + north * east_rate
    spread = truth.position_std_m
    values = {
        "time_s": time_s,
        "speed_mps": speed,
        "slant_range_m": slant_m,
        "horizontal_range_m": range_m,
        "course_deg": float(np.degrees(np.arctan2(east_rate, north_rate)) % 360.0),
        "bearing_deg": float(np.degrees(np.arctan2(east, north)) % 360.0),
    }
    std = {
        "time_s": spread / max(speed, 0.1),
        "speed_mps": SPEED_STD_MPS,
        "slant_range_m": spread,
        "horizontal_range_m": spread,
        "course_deg": COURSE_STD_DEG,
        "bearing_deg": float(np.degrees(spread / max(range_m, spread))),
    }
    if speed > SPEED_STD_MPS:
        values["range_over_speed_s"] = slant_m / speed
        std["range_over_speed_s"] = (
            slant_m / speed * float(np.hypot(spread / slant_m, SPEED_STD_MPS / speed))
        )
    return TruePassage(
        vessel=track.vessel,
        sensor=sensor.id,
        inside=True,
        values=values,
        std=std,
        side="starboard" if right > 0.0 else "port",
    )
