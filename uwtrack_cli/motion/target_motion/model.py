"""Forward model: bearing and range rate of a target on a straight track.

**Method.** Chang et al. 2003, eqs 1-3, corrected: four-quadrant bearings; one-way
Doppler, f = f0 (1 - rate / c), positive rate opening; the rate is the mean over the
interval before the row, or that of the instant. With a propagation delay the
vessel is seen where it was when the sound left: the range r solves
r = |P(t - r/c)| and the bearing points there; f = f0 (1 - dr/dt / c) is then exact
for a moving source and receiver. The range is the slant range when sensor and source
lie at different depths.

**Conventions.** The model takes the state (x, y, vx, vy) relative to own ship at time
zero. The solver works in q = (ln R, bearing, vx, vy): the likelihood is closest to a
parabola there. Results are p = (R, bearing, speed, course). *Polar* solver
coordinates (ln R, bearing, speed, course) serve the intervals of speed and course.

A target that alters its course or speed has four more unknowns for every alteration,
after the first four in all these forms: the change of velocity to the east and to the
north, m/s, the middle of the alteration, s, and the logarithm of its duration, s. The
velocity goes evenly from one leg to the next; the first four are the first leg's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.motion.target_motion.own_ship import ObserverTrack

ComplexArray = NDArray[np.complexfloating[Any, Any]]

STRAIGHT, PER_ALTERATION = 4, 4
"""Unknowns of a straight motion, and of every alteration."""


def to_state(q: FloatArray, *, polar: bool = False) -> FloatArray:
    """Turn solver coordinates into (x, y, vx, vy)."""
    distance = np.exp(q[..., 0])
    x, y = distance * np.sin(q[..., 1]), distance * np.cos(q[..., 1])
    vx, vy = q[..., 2], q[..., 3]
    if polar:
        vx, vy = vx * np.sin(vy), vx * np.cos(vy)
    return _with_alterations([x, y, vx, vy], q)


def _with_alterations(straight: Sequence[FloatArray], of: FloatArray) -> FloatArray:
    """Put the alterations of motions behind other forms of their first legs."""
    first = np.stack(straight, -1)
    if of.shape[-1] == STRAIGHT:
        return first
    return np.concatenate([first, of[..., STRAIGHT:]], -1)


def state_jacobian(q: FloatArray, *, polar: bool = False) -> FloatArray:
    """Differentiate the state by the solver coordinates (trial, state, q)."""
    distance = np.exp(q[:, 0])
    x, y = distance * np.sin(q[:, 1]), distance * np.cos(q[:, 1])
    jacobian = _unit_jacobian(q)
    jacobian[:, 0, 0], jacobian[:, 0, 1] = x, y
    jacobian[:, 1, 0], jacobian[:, 1, 1] = y, -x
    if polar:
        sine, cosine = np.sin(q[:, 3]), np.cos(q[:, 3])
        jacobian[:, 2, 2], jacobian[:, 2, 3] = sine, q[:, 2] * cosine
        jacobian[:, 3, 2], jacobian[:, 3, 3] = cosine, -q[:, 2] * sine
    return jacobian


def _unit_jacobian(q: FloatArray) -> FloatArray:
    jacobian = np.zeros((q.shape[0], q.shape[1], q.shape[1]))
    place = np.arange(2, q.shape[1])
    jacobian[:, place, place] = 1.0
    return jacobian


def to_polar(q: FloatArray) -> FloatArray:
    """Turn (ln R, bearing, vx, vy) into (ln R, bearing, speed, course)."""
    speed = np.hypot(q[..., 2], q[..., 3])
    course = np.arctan2(q[..., 2], q[..., 3])
    return _with_alterations([q[..., 0], q[..., 1], speed, course], q)


def from_motion(
    range_m: FloatArray, bearing_rad: FloatArray, speed_mps: FloatArray, course_rad: FloatArray
) -> FloatArray:
    """Turn range, bearing, speed and course into solver coordinates.

    A negative range or speed is the same vessel on the opposite bearing or
    course; both are brought to the positive form.
    """
    bearing = np.where(range_m < 0, bearing_rad + np.pi, bearing_rad)
    distance = np.log(np.maximum(np.abs(range_m), 1e-6))
    vx, vy = speed_mps * np.sin(course_rad), speed_mps * np.cos(course_rad)
    return np.stack([distance, np.mod(bearing, 2.0 * np.pi), vx, vy], -1)


def from_state(state: FloatArray) -> FloatArray:
    """Turn (x, y, vx, vy) into solver coordinates."""
    x, y, vx, vy = np.moveaxis(state, -1, 0)
    distance = np.log(np.maximum(np.hypot(x, y), 1e-6))
    return np.stack([distance, np.mod(np.arctan2(x, y), 2.0 * np.pi), vx, vy], -1)


def to_motion(q: FloatArray) -> FloatArray:
    """Turn solver coordinates into (R, bearing, speed, course), SI, normalised."""
    p = to_polar(q)
    p[..., 0] = np.exp(p[..., 0])
    p[..., [1, 3]] = np.mod(p[..., [1, 3]], 2.0 * np.pi)
    return p


def state_at(q: FloatArray, time_s: float) -> tuple[FloatArray, FloatArray]:
    """Return the state (x, y, vx, vy) of one motion at a time, s, and its partials.

    The partials are those by the solver coordinates, shape (4, p).
    """
    state = to_state(q)
    now = state[:STRAIGHT].copy()
    now[:2] += time_s * now[2:]
    parts = Alteration.of(state[np.newaxis], np.full((1, 1), time_s))
    for one in parts:
        way, velocity = one.way[0, 0], one.velocity[0, 0]
        now += [way.real, way.imag, velocity.real, velocity.imag]
    rows = []
    for slow, fast, partials in (
        (1.0, time_s, [one.way_partials() for one in parts]),
        (0.0, 1.0, [one.velocity_partials() for one in parts]),
    ):
        for x, y in np.eye(2)[:, :, np.newaxis, np.newaxis]:
            columns = [slow * x, slow * y, fast * x, fast * y]
            _add_partials(columns, partials, x, y)
            rows.append(np.concatenate(columns, axis=1)[0])
    return now, np.array(rows) @ state_jacobian(q[np.newaxis])[0]


def motion_jacobian(q: FloatArray) -> FloatArray:
    """Differentiate (R, bearing, speed, course) by solver coordinates."""
    speed = np.hypot(q[:, 2], q[:, 3])
    # at rest any course will do: north
    sine = np.where(speed > 1e-9, q[:, 2] / np.maximum(speed, 1e-9), 0.0)
    cosine = np.where(speed > 1e-9, q[:, 3] / np.maximum(speed, 1e-9), 1.0)
    speed = np.maximum(speed, 1e-9)
    jacobian = _unit_jacobian(q)
    jacobian[:, 0, 0] = np.exp(q[:, 0])
    jacobian[:, 1, 1] = 1.0
    jacobian[:, 2, 2], jacobian[:, 2, 3] = sine, cosine
    jacobian[:, 3, 2], jacobian[:, 3, 3] = cosine / speed, -sine / speed
    return jacobian


@dataclass(frozen=True, eq=False)
class Prediction:
    """Model values per trial and row; Jacobians (trial, unknown of the state, row)."""

    bearing_rad: FloatArray
    """Bearings, rad, shape (trials, rows)."""
    rate_mps: FloatArray
    """Range rates, m/s, shape (trials, rows)."""
    bearing_jacobian: FloatArray
    """Partials of the bearings, shape (trials, p, rows)."""
    rate_jacobian: FloatArray
    """Partials of the range rates, shape (trials, p, rows)."""
    range_m: FloatArray
    """Slant ranges when the sound left, m, shape (trials, rows)."""
    range_jacobian: FloatArray
    """Partials of the slant ranges, shape (trials, p, rows)."""


STRAIGHTEST = 1e-3
"""Change of course (rad) or of the logarithm of the speed below which series are used."""

SLOWEST_MPS = 1e-3
"""Speed of a leg below which its course means nothing."""


@dataclass(frozen=True, eq=False)
class Alteration:
    """How far one alteration of velocity has gone at given times.

    Velocities and ways are complex, east + i north, m/s and m. The velocity goes from z
    to z' as z (z'/z)^w with the share w of the duration: course and logarithm of the
    speed change evenly, the shorter way round.
    """

    before: ComplexArray
    """Velocity before it, shape (trials, 1)."""
    after: ComplexArray
    """Velocity after it, same shape."""
    duration_s: FloatArray
    """Duration, s, same shape."""
    share: FloatArray
    """Share of the duration that is over, shape (trials, times)."""
    rest_s: FloatArray
    """Time since its end, s, same shape."""
    power: ComplexArray
    """(z'/z)^w, same shape."""
    mean: ComplexArray
    """Integral of the power over the share."""
    slope: ComplexArray
    """Partial of the mean by the logarithm of z'/z."""

    @classmethod
    def of(cls, state: FloatArray, time_s: FloatArray) -> "tuple[Alteration, ...]":
        """Return the alterations of states, shape (trials, p), at times.

        The times, s, have the shape (trials, times).
        """
        found = []
        before = state[:, 2:3] + 1j * state[:, 3:4]
        for first in range(STRAIGHT, state.shape[1], PER_ALTERATION):
            east, north, middle, log_duration = (
                state[:, first + k, np.newaxis] for k in range(PER_ALTERATION)
            )
            after = before + east + 1j * north
            old, new = (np.where(np.abs(z) < SLOWEST_MPS, SLOWEST_MPS, z) for z in (before, after))
            found.append(cls._of_one(old, new, np.exp(log_duration), time_s - middle))
            before = after
        return tuple(found)

    @classmethod
    def _of_one(
        cls, before: ComplexArray, after: ComplexArray, duration_s: FloatArray, since_s: FloatArray
    ) -> "Alteration":
        share = np.clip(since_s / duration_s + 0.5, 0.0, 1.0)
        turn = np.log(after / before)
        power = np.exp(turn * share)
        small = np.abs(turn) < STRAIGHTEST
        safe = np.where(small, 1.0, turn)
        mean = np.where(small, share * (1.0 + share * turn / 2.0), (power - 1.0) / safe)
        slope = np.where(
            small, share**2 * (0.5 + share * turn / 3.0), (share * power - mean) / safe
        )
        rest = np.maximum(since_s - 0.5 * duration_s, 0.0)
        return cls(before, after, duration_s, share, rest, power, mean, slope)

    def at(self, index: IntArray) -> "Alteration":
        """Keep some of the times."""
        return Alteration(
            self.before, self.after, self.duration_s, self.share[:, index],
            self.rest_s[:, index], self.power[:, index], self.mean[:, index],
            self.slope[:, index],
        )  # fmt: skip

    @property
    def velocity(self) -> ComplexArray:
        """What it has added to the velocity."""
        return np.asarray(self.before * (self.power - 1.0))

    @property
    def way(self) -> ComplexArray:
        """What it has added to the way."""
        within = self.duration_s * self.before * (self.mean - self.share)
        return np.asarray(within + (self.after - self.before) * self.rest_s)

    def way_partials(self) -> tuple[ComplexArray, ...]:
        """Return its partials by velocity before, change, middle and log duration."""
        ratio = self.before / self.after * self.slope
        by_change = self.duration_s * ratio + self.rest_s
        by_before = self.duration_s * (self.mean - self.slope - self.share + ratio)
        late = self.velocity
        longer = self.before * (self.mean - self.share) + (0.5 - self.share) * late
        return by_before, by_change, -late, self.duration_s * longer

    def velocity_partials(self) -> tuple[ComplexArray, ...]:
        """Return partials of the velocity by the same."""
        by_change = self.before / self.after * self.share * self.power
        by_before = self.power * (1.0 - self.share) + by_change - 1.0
        within = (self.share > 0.0) & (self.share < 1.0)
        rate = within * self.before * self.power * np.log(self.after / self.before)
        return by_before, by_change, -rate / self.duration_s, (0.5 - self.share) * rate


def _add_partials(
    columns: list[FloatArray],
    partials: Sequence[tuple[ComplexArray, ...]],
    x: FloatArray,
    y: FloatArray,
) -> None:
    """Add (x, y) times the partials of alterations to those of a straight motion.

    A velocity is that of the first leg and all changes before.
    """
    velocities = [2]
    for before, change, middle, duration in partials:
        for place in velocities:
            columns[place] = columns[place] + x * before.real + y * before.imag
            columns[place + 1] = columns[place + 1] - x * before.imag + y * before.real
        velocities.append(len(columns))
        columns += [
            x * change.real + y * change.imag, y * change.real - x * change.imag,
            x * middle.real + y * middle.imag, x * duration.real + y * duration.imag,
        ]  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Sight:
    """The line of sight at the nodes of a track."""

    time_s: FloatArray
    """Time of emission, s, shape (nodes,) or (trials, nodes)."""
    range_m: FloatArray
    """Range at emission, m, shape (trials, nodes)."""
    east: FloatArray
    """East part of the unit vector, shape (trials, nodes)."""
    north: FloatArray
    """North part of the unit vector, shape (trials, nodes)."""
    stretch: FloatArray
    """1 + u.v / c: stretch of time between emission and reception."""
    velocity_mps: tuple[FloatArray, FloatArray]
    """The target's velocity at emission, east and north, m/s, shapes (trials, 1 or
    nodes)."""
    alterations: tuple[Alteration, ...]
    """How far its alterations had gone at emission."""

    def at(self, index: IntArray) -> "_Sight":
        vx, vy = self.velocity_mps
        return _Sight(
            self.time_s[..., index],
            self.range_m[:, index],
            self.east[:, index],
            self.north[:, index],
            self.stretch[:, index] if self.stretch.shape[1] > 1 else self.stretch,
            (vx[:, index], vy[:, index]) if self.alterations else (vx, vy),
            tuple(one.at(index) for one in self.alterations),
        )

    def place_columns(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return (x, y) times the partials of the place at emission, (trials, p, .)."""
        columns = [x, y, self.time_s * x, self.time_s * y]
        parts = [one.way_partials() for one in self.alterations]
        _add_partials(columns, parts, x, y)
        return np.stack(columns, 1)

    def velocity_columns(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return (x, y) times the partials of the velocity at emission."""
        columns = [np.zeros_like(x), np.zeros_like(x), x, y]
        parts = [one.velocity_partials() for one in self.alterations]
        _add_partials(columns, parts, x, y)
        return np.stack(columns, 1)

    def range_jacobian(self) -> FloatArray:
        return self.place_columns(self.east / self.stretch, self.north / self.stretch)


def predict(track: ObserverTrack, state: FloatArray, medium: Medium) -> Prediction:
    """Predict bearings and range rates with their derivatives.

    Own ship is at the nodes, the trial states (x, y, vx, vy), m and m/s, with their
    alterations, one per row.

    Notes
    -----
    With u the unit vector along the line of sight, s the slowness and
    D = 1 + s u.v: dr = u.dP / D, the vessel is seen at dP - s v dr, and the bearing
    changes by the part of that across the line of sight, over the horizontal range.
    """
    nodes = _line_of_sight(track, state, medium)
    now = nodes.at(track.now)
    range_jacobian = now.range_jacobian()
    north, east = now.north, now.east
    turn = now.place_columns(north, -east)
    if medium.slowness_spm:
        vx, vy = now.velocity_mps
        drift = medium.slowness_spm * (north * vx - east * vy)
        turn = turn - drift[:, np.newaxis] * range_jacobian
    level = now.range_m * (east**2 + north**2) if medium.height_m else now.range_m
    bearing_jacobian = turn / level[:, np.newaxis]
    if track.before is not None:
        before = nodes.at(track.before)
        rate: FloatArray = (now.range_m - before.range_m) / track.interval_s
        change = range_jacobian - before.range_jacobian()
        rate_jacobian: FloatArray = change / track.interval_s
    else:
        rate, rate_jacobian = _rate_of_the_instant(track, now, medium.slowness_spm, range_jacobian)
    return Prediction(
        np.arctan2(east, north), rate, bearing_jacobian, rate_jacobian, now.range_m, range_jacobian
    )


def predict_values(
    track: ObserverTrack, state: FloatArray, medium: Medium
) -> tuple[FloatArray, FloatArray]:
    """Predict bearings and range rates alone, at a third of the cost."""
    nodes = _line_of_sight(track, state, medium)
    now = nodes.at(track.now)
    bearing = np.arctan2(now.east, now.north)
    if track.before is not None:
        gone = now.range_m - nodes.range_m[:, track.before]
        return bearing, np.asarray(gone / track.interval_s)
    vx, vy = now.velocity_mps
    own_x, own_y = track.velocity_mps
    rate = now.east * (vx - own_x) + now.north * (vy - own_y)
    return bearing, np.asarray(rate / now.stretch)


EMISSIONS = 2
"""Times that the moment of emission is sought again where the velocity changes: what is
left of it is a change of velocity over some milliseconds."""


def _line_of_sight(track: ObserverTrack, state: FloatArray, medium: Medium) -> _Sight:
    time = track.time_s
    sight = _straight_sight(track, state[:, :STRAIGHT], medium)
    if state.shape[1] == STRAIGHT:
        return sight
    for _ in range(EMISSIONS if medium.slowness_spm else 1):
        at = np.broadcast_to(sight.time_s, (len(state), time.size))
        alterations = Alteration.of(state, at)
        # at its emission every node sees the straight motion that touches the way there
        local = np.repeat(state[:, :STRAIGHT, np.newaxis], time.size, axis=2)
        for one in alterations:
            gone, faster = one.way - at * one.velocity, one.velocity
            local += np.stack([gone.real, gone.imag, faster.real, faster.imag], 1)
        sight = replace(_straight_sight(track, local, medium), alterations=alterations)
    return sight


def _straight_sight(track: ObserverTrack, state: FloatArray, medium: Medium) -> _Sight:
    """See straight motions, (trials, 4), or those of every node, (trials, 4, nodes)."""
    x, y, vx, vy = (state[:, k] if state.ndim == 3 else state[:, k, np.newaxis] for k in range(4))
    time = track.time_s
    east = x + vx * time - track.east_m
    north = y + vy * time - track.north_m
    squared = east**2 + north**2 + medium.height_m**2
    slowness = medium.slowness_spm
    if not slowness:
        distance = np.maximum(np.sqrt(squared), 1e-6)
        stretch = np.ones((state.shape[0], 1))
        return _Sight(time, distance, east / distance, north / distance, stretch, (vx, vy), ())
    opening = slowness * (east * vx + north * vy)
    scale = 1.0 - slowness**2 * (vx**2 + vy**2)
    distance = (np.sqrt(opening**2 + scale * squared) - opening) / scale
    distance = np.maximum(distance, 1e-6)
    delay = slowness * distance
    east, north = (east - vx * delay) / distance, (north - vy * delay) / distance
    stretch = 1.0 + slowness * (east * vx + north * vy)
    return _Sight(time - delay, distance, east, north, stretch, (vx, vy), ())


def _rate_of_the_instant(
    track: ObserverTrack, now: _Sight, slowness_spm: float, range_jacobian: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Range rate u.w / D of the relative velocity w, with its derivatives.

    With c = w - s rate v: d(rate) = (du.c + (1 - s rate) u.dv) / D, where
    du = (dP - s v dr - u dr) / r.
    """
    vx, vy = now.velocity_mps
    relative_x, relative_y = vx - track.velocity_mps[0], vy - track.velocity_mps[1]
    rate = (now.east * relative_x + now.north * relative_y) / now.stretch
    late = slowness_spm * rate
    x, y = relative_x - late * vx, relative_y - late * vy
    along = slowness_spm * (vx * x + vy * y) + now.east * x + now.north * y
    jacobian = now.place_columns(x, y)
    jacobian -= range_jacobian * along[:, np.newaxis]
    jacobian /= now.range_m[:, np.newaxis]
    east, north = (1.0 - late) * now.east, (1.0 - late) * now.north
    if now.alterations:
        jacobian += now.velocity_columns(east, north)
    else:
        jacobian[:, 2] += east
        jacobian[:, 3] += north
    return rate, jacobian / now.stretch[:, np.newaxis]
