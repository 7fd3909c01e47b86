"""Where an array is, how it points and how it moves, from what is known of its tow.

**Method.** A towed array lies on the way of its ship: a place on it is where the ship
was so many metres of way before. The heading is that of the chord from tail to head,
or of the array's own compass. Where tail and head point apart, the array is bent.

**Conventions.** Positions are metres on the grid of the navigation. Before its first
row and after its last one the ship goes straight on.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.constants import NANOSECONDS
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.errors import DataError, warn
from uwtrack_cli.estimation.angles import compass_deg, interpolate_deg, wrap_deg

SPEED_SPAN_S = 5.0
"""Time before and after a frame over which the speed is taken."""

LEAST_SPAN_M = 1.0
"""Least way over which a direction is taken."""


@dataclass(frozen=True, eq=False)
class ArrayPlace:
    """Place and motion of an array's middle at the times of frames."""

    east_m: FloatArray
    """East, m; nan if unknown."""
    north_m: FloatArray
    """North, m; nan if unknown."""
    heading_deg: FloatArray
    """Compass heading, degrees; nan if unknown."""
    bend_deg: FloatArray
    """Change of heading from tail to head, degrees; nan if unknown."""
    speed_mps: FloatArray
    """Own velocity along the array, m/s."""


def check_place(recording: Recording, *, needs_heading: bool) -> None:
    """Refuse a recording whose array has no heading, or no clock for its navigation.

    Raises
    ------
    DataError
        Something is missing; the key or option that gives it is named.
    """
    sensor, navigation = recording.sensor, recording.sensor.navigation
    if navigation is None:
        if sensor.heading_source != "fixed" and needs_heading:
            raise DataError(
                f"array {sensor.id!r} has neither heading_deg nor navigation, so its "
                f"bearings are unknown: give one of them in the sensor file, or "
                f"--own-ship NAV.csv, or --frame array for cone angles alone."
            )
        return
    knows_heading = sensor.heading_source in {"track", "way", "compass"}  # way: 0.2
    if sensor.tow_offset_m is None or not knows_heading:
        raise DataError(
            f"array {sensor.id!r} has navigation, but not tow_offset_m (0 if it is the "
            f'array\'s own) and heading_source ("track" or "compass"): give both in its '
            f"sensor file."
        )
    if sensor.heading_source == "compass" and np.isnan(navigation.heading_deg).any():
        raise DataError(
            f"heading_source of array {sensor.id!r} is 'compass', and rows of its "
            f'navigation have no heading_deg; give them, or heading_source = "track".'
        )
    if navigation.start_utc_ns is not None and recording.start_utc_ns is None:
        raise DataError(
            f"the navigation of array {sensor.id!r} is in UTC, and the start of "
            f"{recording.name} is not known: give --start-utc or --time-pattern."
        )
    _check_cover(recording, navigation)


def _check_cover(recording: Recording, navigation: Navigation) -> None:
    first, last = _rows_s(navigation, recording.start_utc_ns)[[0, -1]]
    end_s = first if recording.is_live else recording.duration_s
    if navigation.time_s.size < 2 or last < 0.0 or first > max(end_s, 0.0):
        raise DataError(
            f"the navigation covers {first:.6g} to {last:.6g} s of {recording.name}, "
            f"which lasts {end_s:.6g} s: do both count from the same start (give both "
            f"UTC, or one clock)?"
        )
    way = _Way(navigation, recording.start_utc_ns)
    behind_m = (recording.sensor.tow_offset_m or 0.0) + _reach_m(recording.sensor)
    missing = []
    if way.length_at(np.zeros(1))[0] < behind_m:
        missing.append(f"begins at {first:.6g} s, {behind_m:g} m of way later than")
    if last < end_s:
        missing.append(f"ends at {last:.6g} s, before the end of")
    for what in missing:
        warn(
            f"the navigation {what} {recording.name}; its course and speed are held "
            f"beyond, and bearings there rest on that."
        )


def place_of_array(sensor: Sensor, frames: Frames) -> ArrayPlace:
    """Return where an array is and how it points at the times of frames."""
    n = frames.n_frames
    navigation = sensor.navigation
    if navigation is None:
        is_known = sensor.heading_source == "fixed"
        fixed_deg = (sensor.heading_deg + sensor.compass_offset_deg) % 360.0
        at = [sensor.east_m or 0.0, sensor.north_m or 0.0] if is_known else [np.nan] * 2
        return ArrayPlace(
            np.full(n, at[0]),
            np.full(n, at[1]),
            np.full(n, fixed_deg if is_known else np.nan),
            np.full(n, 0.0 if is_known else np.nan),
            np.zeros(n),
        )
    way = _Way(navigation, frames.start_utc_ns)
    middle = way.length_at(frames.time_s) - (sensor.tow_offset_m or 0.0)
    east, north = way.at(middle)
    reach = _reach_m(sensor)
    if sensor.heading_source == "compass":
        speed = way.speed_at(frames.time_s)
        crossing = reach / np.maximum(speed, 0.1)
        heading = way.heading_at(frames.time_s)
        ends = [way.heading_at(frames.time_s + k * crossing) for k in (-1.0, 1.0)]
        bend = np.abs(wrap_deg(ends[1] - ends[0]))
        heading = (heading + sensor.compass_offset_deg) % 360.0
    else:
        heading = way.direction(middle, reach)
        ends = [way.direction(middle + k * reach, 0.25 * reach) for k in (-1.0, 1.0)]
        bend = np.abs(wrap_deg(ends[1] - ends[0]))
    return ArrayPlace(east, north, heading, bend, way.speed_at(frames.time_s))


def _reach_m(sensor: Sensor) -> float:
    """Return half the length of the array."""
    return 0.5 * float(np.ptp(sensor.element_places_m))


def _rows_s(navigation: Navigation, start_utc_ns: int | None) -> FloatArray:
    """Return the times of a navigation from the first sample, s."""
    if navigation.start_utc_ns is None or start_utc_ns is None:
        return navigation.time_s
    shift_s = (navigation.start_utc_ns - start_utc_ns) / NANOSECONDS
    return np.asarray(navigation.time_s + shift_s)


class _Way:
    """The way of a ship: its length over time, and its places over length."""

    def __init__(self, navigation: Navigation, start_utc_ns: int | None) -> None:
        self._time_s = _rows_s(navigation, start_utc_ns)
        self._east, self._north = navigation.east_m, navigation.north_m
        self._heading = navigation.heading_deg
        step = np.hypot(np.diff(self._east), np.diff(self._north))
        self._length = np.append(0.0, np.cumsum(step))

    def length_at(self, time_s: FloatArray) -> FloatArray:
        """Return the way made since the first row, m; straight on beyond the ends."""
        return _extended(time_s, self._time_s, self._length)

    def speed_at(self, time_s: FloatArray) -> FloatArray:
        """Return the speed through a few seconds about each time, m/s."""
        ahead = self.length_at(time_s + SPEED_SPAN_S)
        return (ahead - self.length_at(time_s - SPEED_SPAN_S)) / (2.0 * SPEED_SPAN_S)

    def at(self, length_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the places at lengths of way, m."""
        moved = np.append(True, np.diff(self._length) > 0.0)
        if np.count_nonzero(moved) < 2:
            return (np.full_like(length_m, self._east[0]), np.full_like(length_m, self._north[0]))
        known = self._length[moved]
        return (
            _extended(length_m, known, self._east[moved]),
            _extended(length_m, known, self._north[moved]),
        )

    def direction(self, length_m: FloatArray, half_m: float) -> FloatArray:
        """Return the direction of the chord about lengths of way, degrees."""
        half_m = max(half_m, LEAST_SPAN_M)
        east, north = self.at(length_m + half_m)
        east_before, north_before = self.at(length_m - half_m)
        return compass_deg(east - east_before, north - north_before)

    def heading_at(self, time_s: FloatArray) -> FloatArray:
        """Return the heading that the navigation gives, degrees."""
        return interpolate_deg(time_s, self._time_s, self._heading)


def _extended(x: FloatArray, known: FloatArray, values: FloatArray) -> FloatArray:
    """Interpolate, and go on beyond the ends as between the outermost rows."""
    found = np.interp(x, known, values)
    first = (values[1] - values[0]) / (known[1] - known[0])
    last = (values[-1] - values[-2]) / (known[-1] - known[-2])
    found = found + first * np.minimum(x - known[0], 0.0)
    return np.asarray(found + last * np.maximum(x - known[-1], 0.0))
