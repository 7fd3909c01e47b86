"""Own ship between the rows of its navigation, correct through turns.

**Method.** Between two rows the platform follows a circular arc when their headings
agree with one (the chord of an arc points along the mean of the headings at its
ends), and a straight line otherwise: legs given by their corners stay legs.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_rad

Doppler = Literal["instantaneous", "interval"]

ARC_TOLERANCE_RAD = np.radians(3.0)
"""How well chord and mean heading must agree for an arc (leeway, compass)."""


@dataclass(frozen=True, eq=False)
class ObserverTrack:
    """Own ship at the instants that the model needs (nodes); rows refer to them."""

    time_s: FloatArray
    """Times of the nodes from the first measurement, s, shape (nodes,)."""
    east_m: FloatArray
    """East of the first position, m, shape (nodes,)."""
    north_m: FloatArray
    """North of the first position, m, shape (nodes,)."""
    now: IntArray
    """Node of every row, shape (rows,)."""
    before: IntArray | None
    """Node at the start of every row's Doppler interval; None for the Doppler of the
    instant."""
    interval_s: FloatArray
    """Length of that interval, s, shape (rows,)."""
    velocity_mps: FloatArray
    """Own velocity east and north at every row, m/s, shape (2, rows)."""

    def rows(self, index: IntArray | slice) -> "ObserverTrack":
        """Keep some rows, and only the nodes that they need."""
        now = self.now[index]
        before = None if self.before is None else self.before[index]
        wanted = now if before is None else np.concatenate([before, now])
        nodes = np.unique(wanted)
        return ObserverTrack(
            time_s=self.time_s[nodes],
            east_m=self.east_m[nodes],
            north_m=self.north_m[nodes],
            now=np.searchsorted(nodes, now),
            before=None if before is None else np.searchsorted(nodes, before),
            interval_s=self.interval_s[index],
            velocity_mps=self.velocity_mps[:, index],
        )


@dataclass(frozen=True, eq=False)
class OwnPath:
    """Positions of own ship over time; heading in radians, nan if unknown."""

    time_s: FloatArray
    """Times of the navigation, s, shape (n,)."""
    east_m: FloatArray
    """Position east, m, shape (n,)."""
    north_m: FloatArray
    """Position north, m, shape (n,)."""
    heading_rad: FloatArray
    """Heading, rad, shape (n,); nan if unknown."""

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return east and north at any times; beyond the ends straight on."""
        if self.time_s.size < 2:
            shape = np.zeros_like(time_s)
            return self.east_m[0] + shape, self.north_m[0] + shape
        row = np.searchsorted(self.time_s, time_s, side="right") - 1
        row = np.clip(row, 0, self.time_s.size - 2)
        span = self.time_s[row + 1] - self.time_s[row]
        part = (time_s - self.time_s[row]) / span
        chord_east = self.east_m[row + 1] - self.east_m[row]
        chord_north = self.north_m[row + 1] - self.north_m[row]
        along, across = _arc(part, self._half_turn()[row])
        east = self.east_m[row] + along * chord_east + across * chord_north
        north = self.north_m[row] + along * chord_north - across * chord_east
        return east, north

    def _half_turn(self) -> FloatArray:
        """Half the change of heading between rows that lie on an arc, else 0."""
        turn = wrap_rad(np.diff(self.heading_rad)) / 2.0
        chord = np.arctan2(np.diff(self.east_m), np.diff(self.north_m))
        agreement = wrap_rad(chord - self.heading_rad[:-1] - turn)
        is_arc = (np.abs(agreement) < ARC_TOLERANCE_RAD) & (np.abs(turn) > 1e-9)
        return np.where(is_arc, turn, 0.0)

    def heading_at(self, time_s: FloatArray) -> FloatArray:
        """Return the heading at any times, by the shorter turn."""
        if self.time_s.size < 2:
            return np.full_like(time_s, self.heading_rad[0])
        unwrapped = np.unwrap(self.heading_rad)
        return np.asarray(np.interp(time_s, self.time_s, unwrapped))

    def course_at(self, time_s: FloatArray, step_s: float) -> FloatArray:
        """Return the course made good over the step that follows."""
        east, north = self.at(time_s)
        east_after, north_after = self.at(time_s + step_s)
        return np.asarray(np.arctan2(east_after - east, north_after - north))


USUAL_TOW_M = 300.0
"""Way from own ship to the end of an array whose tow is not known."""

BEND_STEPS = 16
"""Steps into which the way behind own ship is cut."""


def bend_rad(path: OwnPath, time_s: FloatArray, length_m: float) -> FloatArray:
    """Return by how much own ship turned on the way that its array lies on, rad.

    An array follows own ship's way for its length, m: until it has passed a turn, its
    heading lies between the course before and the course after. The largest difference
    between the course at each time, s, in order, and on the way behind; 0 for a
    platform that stands still.
    """
    if path.time_s.size < 2 or length_m == 0.0 or time_s.size == 0:
        return np.zeros(time_s.size)
    speeds = np.hypot(np.diff(path.east_m), np.diff(path.north_m)) / np.diff(path.time_s)
    speed = float(np.median(speeds))
    if speed <= 0.0:
        return np.zeros(time_s.size)
    step_s = length_m / speed / BEND_STEPS
    # more than a tow before the first row own ship is taken to have gone straight
    grid = np.arange(time_s[0] - 2.0 * length_m / speed, time_s[-1] + 2 * step_s, step_s)
    east, north = path.at(grid)
    leg = np.hypot(np.diff(east), np.diff(north))
    course = np.unwrap(np.arctan2(np.diff(east), np.diff(north)))
    way = np.cumsum(leg)
    now = np.clip(np.searchsorted(grid, time_s) - 1, 0, course.size - 1)
    last = np.searchsorted(way, way[now] - length_m)
    return np.array(
        [np.abs(course[a : b + 1] - course[b]).max() for a, b in zip(last, now, strict=True)]
    )


def _arc(part: FloatArray, half_turn: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Progress along and off the chord of an arc, in chords.

    On an arc of turn 2 h the chord from the start to the share s has the length
    sin(s h) / sin(h) and points h (s - 1) away from the whole chord.
    """
    safe = np.where(half_turn == 0.0, 1.0, half_turn)
    length = np.where(half_turn == 0.0, part, np.sin(part * safe) / np.sin(safe))
    angle = np.where(half_turn == 0.0, 0.0, half_turn * (part - 1.0))
    return length * np.cos(angle), length * np.sin(angle)


def make_sensors_track(
    paths: list[OwnPath], sensor: IntArray, time_s: FloatArray, doppler: Doppler, interval_s: float
) -> ObserverTrack:
    """Sample several sensors on one grid, each at the rows that it heard.

    The first row's sensor is the origin; times are in order, equal ones allowed. The
    rest is as for one platform.
    """
    origin = paths[sensor[0]].at(time_s[:1])
    place = float(origin[0][0]), float(origin[1][0])
    rows = [np.flatnonzero(sensor == number) for number in range(len(paths))]
    parts = [
        make_observer_track(
            path, time_s[own], doppler, interval_s, start=float(time_s[0]), origin=place
        )
        for path, own in zip(paths, rows, strict=True)
    ]
    first = np.cumsum([0, *(part.time_s.size for part in parts)])
    order = np.argsort(np.concatenate(rows))
    before = [
        n + part.before for n, part in zip(first, parts, strict=False) if part.before is not None
    ]
    now = [n + part.now for n, part in zip(first, parts, strict=False)]
    return ObserverTrack(
        time_s=np.concatenate([part.time_s for part in parts]),
        east_m=np.concatenate([part.east_m for part in parts]),
        north_m=np.concatenate([part.north_m for part in parts]),
        now=np.concatenate(now)[order],
        before=np.concatenate(before)[order] if before else None,
        interval_s=np.full(time_s.size, interval_s),
        velocity_mps=np.concatenate([part.velocity_mps for part in parts], 1)[:, order],
    )


def make_observer_track(
    path: OwnPath,
    time_s: FloatArray,
    doppler: Doppler,
    interval_s: float,
    *,
    start: float | None = None,
    origin: tuple[float, float] | None = None,
) -> ObserverTrack:
    """Sample own ship where the model needs it.

    Parameters
    ----------
    path
        Own ship's path.
    time_s
        Times of the measurement rows, in the clock of the path, s.
    doppler
        Whether frequencies are of the instant or a mean over an interval.
    interval_s
        The interval that ends at a row, or the span of the central difference
        that gives own velocity, s.
    start
        Time from which times count; by default that of the first row.
    origin
        Place from which places count; by default that at the first row.
    """
    start = float(time_s[0]) if start is None else start
    before = time_s - interval_s
    with_past = doppler == "interval"
    wanted = np.concatenate([before, time_s]) if with_past else time_s
    # a tenth of a microsecond: regular rows share their nodes with their neighbours
    keys, inverse = np.unique(np.rint(wanted * 1e7), return_inverse=True)
    nodes = np.empty(keys.size)
    nodes[inverse] = wanted
    east, north = path.at(nodes)
    if origin is None:
        east_0, north_0 = path.at(np.array([start]))
    else:
        east_0, north_0 = (np.array([place]) for place in origin)
    count = time_s.size
    ahead = path.at(time_s + interval_s / 2.0)
    behind = path.at(time_s - interval_s / 2.0)
    return ObserverTrack(
        time_s=nodes - start,
        east_m=east - east_0,
        north_m=north - north_0,
        now=inverse[-count:],
        before=inverse[:count] if with_past else None,
        interval_s=np.full(count, interval_s),
        velocity_mps=(np.stack(ahead) - np.stack(behind)) / interval_s,
    )
