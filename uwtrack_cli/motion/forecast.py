"""What one platform hears of another, when the ways of both are known.

**Method.** Both ways are interpolated (arcs where headings tell them); sound that is
heard at a time was made where the target was a range earlier. Bearing, range and its
rate follow, and for each tone its frequency, with the velocities of both platforms
along the sound's way.

**Conventions.** Compass degrees from own platform to where the sound was made; the
range is that to this place, and its rate is positive where it opens.

**References.** Doppler of source and receiver that both move: Pierce, Acoustics (1989),
section 9-2.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.acoustics.geodesy import Origin, places_on_grid, to_latitude_longitude
from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.errors import DataError
from uwtrack_cli.motion.target_motion.own_ship import OwnPath

DELAY_STEPS = 4
"""Steps to the time of emission; the error falls by the Mach number in each."""

VELOCITY_STEP_S = 0.5
"""Half the span over which velocities are taken."""

MOST_ROWS = 1_000_000
"""Rows of a forecast at most."""


@dataclass(frozen=True, eq=False)
class Forecast:
    """What is heard, one row per time."""

    time_s: FloatArray
    """Times, s from own platform's time zero, shape (row,)."""
    bearing_deg: FloatArray
    """Compass bearing, shape (row,)."""
    range_m: FloatArray
    """Horizontal range to where the sound was made, m, shape (row,)."""
    range_rate_mps: FloatArray
    """How fast the sound's way grows: its Doppler over the rest frequency times the
    sound speed, with the sign changed, m/s, shape (row,)."""
    frequency_hz: FloatArray
    """Frequency of every tone, Hz, shape (row, tone)."""
    start_utc_ns: int | None
    """UTC epoch of time zero, ns; None if unknown."""


def forecast_contact(
    own: Navigation,
    target: Navigation,
    *,
    rest_frequencies_hz: Sequence[float] = (),
    every_s: float = 10.0,
    sound_speed_mps: float = 1500.0,
) -> Forecast:
    """Return bearing, range and Doppler of a target along two known ways.

    Parameters
    ----------
    own
        Way of the platform that hears.
    target
        Way of the one that is heard.
    rest_frequencies_hz
        Tones of the target at rest, Hz.
    every_s
        Interval of the rows, s.
    sound_speed_mps
        Sound speed, m/s.

    Raises
    ------
    DataError
        The ways have positions of two kinds, clocks that cannot be compared, or no
        common time.
    """
    target = _on_grid_and_clock(own, target)
    first = max(own.time_s[0], target.time_s[0])
    last = min(own.time_s[-1], target.time_s[-1])
    if not first <= last:
        raise DataError(
            f"the two tracks share no time: own platform's lasts from {own.time_s[0]:g} "
            f"to {own.time_s[-1]:g} s, the target's from {target.time_s[0]:g} to "
            f"{target.time_s[-1]:g} s on the same clock."
        )
    if (last - first) / every_s > MOST_ROWS:
        raise DataError(
            f"{last - first:g} s at every {every_s:g} s are more than {MOST_ROWS} rows; "
            f"lengthen the interval."
        )
    time_s = np.arange(first, last + 1e-6, every_s)
    here, there = _path(own), _path(target)
    place = np.stack(here.at(time_s))
    emitted = time_s
    for _ in range(DELAY_STEPS):
        way = np.stack(there.at(emitted)) - place
        emitted = time_s - np.hypot(*way) / sound_speed_mps
    way = np.stack(there.at(emitted)) - place
    range_m = np.hypot(*way)
    toward = way / np.maximum(range_m, 1e-9)
    coming = (_velocity(here, time_s) * toward).sum(axis=0) / sound_speed_mps
    going = (_velocity(there, emitted) * toward).sum(axis=0) / sound_speed_mps
    ratio = (1.0 + coming) / (1.0 + going)
    tones = np.asarray(rest_frequencies_hz, float)
    return Forecast(
        time_s=time_s,
        bearing_deg=np.degrees(np.arctan2(*way)) % 360.0,
        range_m=range_m,
        range_rate_mps=(1.0 - ratio) * sound_speed_mps,
        frequency_hz=ratio[:, None] * tones,
        start_utc_ns=own.start_utc_ns,
    )


def _on_grid_and_clock(own: Navigation, target: Navigation) -> Navigation:
    """Return the target's way on own grid and clock."""
    if (own.origin_latitude is None) != (target.origin_latitude is None):
        raise DataError(
            "one track has latitudes and longitudes and the other metres on a grid: give "
            "both the same way."
        )
    if (own.start_utc_ns is None) != (target.start_utc_ns is None):
        raise DataError("one track has UTC times and the other none: give both the same clock.")
    east, north = target.east_m, target.north_m
    origin, other = _origin(own), _origin(target)
    if origin is not None and other is not None:
        east, north = places_on_grid(*to_latitude_longitude(east, north, other), origin)
    shift_s = 0.0
    if own.start_utc_ns is not None and target.start_utc_ns is not None:
        shift_s = (target.start_utc_ns - own.start_utc_ns) / NANOSECONDS
    time_s = target.time_s + shift_s
    return replace(target, time_s=time_s, east_m=east, north_m=north)


def _origin(navigation: Navigation) -> Origin | None:
    latitude, longitude = navigation.origin_latitude, navigation.origin_longitude
    if latitude is None or longitude is None:
        return None
    return Origin(latitude, longitude)


def _path(navigation: Navigation) -> OwnPath:
    heading = np.radians(navigation.heading_deg)
    return OwnPath(navigation.time_s, navigation.east_m, navigation.north_m, heading)


def _velocity(path: OwnPath, time_s: FloatArray) -> FloatArray:
    """Return velocity east and north, m/s, shape (2, time)."""
    ahead = np.stack(path.at(time_s + VELOCITY_STEP_S))
    behind = np.stack(path.at(time_s - VELOCITY_STEP_S))
    return np.asarray((ahead - behind) / (2.0 * VELOCITY_STEP_S))
