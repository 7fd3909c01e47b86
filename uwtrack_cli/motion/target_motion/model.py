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
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.motion.target_motion.own_ship import ObserverTrack


def to_state(q: FloatArray, *, polar: bool = False) -> FloatArray:
    """Turn solver coordinates into (x, y, vx, vy)."""
    distance = np.exp(q[..., 0])
    x, y = distance * np.sin(q[..., 1]), distance * np.cos(q[..., 1])
    vx, vy = q[..., 2], q[..., 3]
    if polar:
        vx, vy = vx * np.sin(vy), vx * np.cos(vy)
    return np.stack([x, y, vx, vy], -1)


def state_jacobian(q: FloatArray, *, polar: bool = False) -> FloatArray:
    """Differentiate the state by the solver coordinates (trial, state, q)."""
    distance = np.exp(q[:, 0])
    x, y = distance * np.sin(q[:, 1]), distance * np.cos(q[:, 1])
    jacobian = np.zeros((q.shape[0], 4, 4))
    jacobian[:, 0, 0], jacobian[:, 0, 1] = x, y
    jacobian[:, 1, 0], jacobian[:, 1, 1] = y, -x
    if polar:
        sine, cosine = np.sin(q[:, 3]), np.cos(q[:, 3])
        jacobian[:, 2, 2], jacobian[:, 2, 3] = sine, q[:, 2] * cosine
        jacobian[:, 3, 2], jacobian[:, 3, 3] = cosine, -q[:, 2] * sine
    else:
        jacobian[:, 2, 2] = jacobian[:, 3, 3] = 1.0
    return jacobian


def to_polar(q: FloatArray) -> FloatArray:
    """Turn (ln R, bearing, vx, vy) into (ln R, bearing, speed, course)."""
    speed = np.hypot(q[..., 2], q[..., 3])
    course = np.arctan2(q[..., 2], q[..., 3])
    return np.stack([q[..., 0], q[..., 1], speed, course], -1)


def from_motion(
    range_m: FloatArray, bearing_rad: FloatArray, speed_mps: FloatArray,
    course_rad: FloatArray,
) -> FloatArray:  # fmt: skip
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


def motion_jacobian(q: FloatArray) -> FloatArray:
    """Differentiate (R, bearing, speed, course) by solver coordinates."""
    speed = np.hypot(q[:, 2], q[:, 3])
    # at rest any course will do: north
    sine = np.where(speed > 1e-9, q[:, 2] / np.maximum(speed, 1e-9), 0.0)
    cosine = np.where(speed > 1e-9, q[:, 3] / np.maximum(speed, 1e-9), 1.0)
    speed = np.maximum(speed, 1e-9)
    jacobian = np.zeros((q.shape[0], 4, 4))
    jacobian[:, 0, 0] = np.exp(q[:, 0])
    jacobian[:, 1, 1] = 1.0
    jacobian[:, 2, 2], jacobian[:, 2, 3] = sine, cosine
    jacobian[:, 3, 2], jacobian[:, 3, 3] = cosine / speed, -sine / speed
    return jacobian


@dataclass(frozen=True, eq=False)
class Prediction:
    """Model values per trial and row; Jacobians (trial, state, row)."""

    bearing_rad: FloatArray
    """Bearings, rad, shape (trials, rows)."""
    rate_mps: FloatArray
    """Range rates, m/s, shape (trials, rows)."""
    bearing_jacobian: FloatArray
    """Partials of the bearings, shape (trials, 4, rows)."""
    rate_jacobian: FloatArray
    """Partials of the range rates, shape (trials, 4, rows)."""


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

    def at(self, index: IntArray) -> "_Sight":
        return _Sight(
            self.time_s[..., index],
            self.range_m[:, index],
            self.east[:, index],
            self.north[:, index],
            self.stretch[:, index] if self.stretch.shape[1] > 1 else self.stretch,
        )

    def range_jacobian(self) -> FloatArray:
        east, north = self.east / self.stretch, self.north / self.stretch
        return np.stack([east, north, self.time_s * east, self.time_s * north], 1)


def predict(track: ObserverTrack, state: FloatArray, medium: Medium) -> Prediction:
    """Predict bearings and range rates with their derivatives.

    Own ship is at the nodes, the trial states (x, y, vx, vy), m and m/s, one per row.

    Notes
    -----
    With u the unit vector along the line of sight, s the slowness and
    D = 1 + s u.v: dr = u.dP / D, the vessel is seen at dP - s v dr, and the bearing
    changes by the part of that across the line of sight, over the horizontal range.
    """
    nodes = _line_of_sight(track, state, medium)
    now = nodes.at(track.now)
    range_jacobian = now.range_jacobian()
    north, east, time = now.north, now.east, now.time_s
    turn: FloatArray = np.stack([north, -east, time * north, -time * east], 1)
    if medium.slowness_spm:
        drift = medium.slowness_spm * (north * state[:, 2:3] - east * state[:, 3:4])
        turn = turn - drift[:, np.newaxis] * range_jacobian
    level = now.range_m * (east**2 + north**2) if medium.height_m else now.range_m
    bearing_jacobian = turn / level[:, np.newaxis]
    if track.before is not None:
        before = nodes.at(track.before)
        rate: FloatArray = (now.range_m - before.range_m) / track.interval_s
        change = range_jacobian - before.range_jacobian()
        rate_jacobian: FloatArray = change / track.interval_s
    else:
        rate, rate_jacobian = _rate_of_the_instant(
            track, now, state, medium.slowness_spm, range_jacobian
        )
    return Prediction(np.arctan2(east, north), rate, bearing_jacobian, rate_jacobian)


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
    relative = state[:, 2:4, np.newaxis] - track.velocity_mps
    rate = now.east * relative[:, 0] + now.north * relative[:, 1]
    return bearing, np.asarray(rate / now.stretch)


def _line_of_sight(track: ObserverTrack, state: FloatArray, medium: Medium) -> _Sight:
    vx, vy = state[:, 2:3], state[:, 3:4]
    time = track.time_s
    east = state[:, 0:1] + vx * time - track.east_m
    north = state[:, 1:2] + vy * time - track.north_m
    squared = east**2 + north**2 + medium.height_m**2
    slowness = medium.slowness_spm
    if not slowness:
        distance = np.maximum(np.sqrt(squared), 1e-6)
        stretch = np.ones((state.shape[0], 1))
        return _Sight(time, distance, east / distance, north / distance, stretch)
    opening = slowness * (east * vx + north * vy)
    scale = 1.0 - slowness**2 * (vx**2 + vy**2)
    distance = (np.sqrt(opening**2 + scale * squared) - opening) / scale
    distance = np.maximum(distance, 1e-6)
    delay = slowness * distance
    east, north = (east - vx * delay) / distance, (north - vy * delay) / distance
    stretch = 1.0 + slowness * (east * vx + north * vy)
    return _Sight(time - delay, distance, east, north, stretch)


def _rate_of_the_instant(
    track: ObserverTrack,
    now: _Sight,
    state: FloatArray,
    slowness_spm: float,
    range_jacobian: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Range rate u.w / D of the relative velocity w, with its derivatives.

    With c = w - s rate v: d(rate) = (du.c + (1 - s rate) u.dv) / D, where
    du = (dP - s v dr - u dr) / r.
    """
    vx, vy = state[:, 2:3], state[:, 3:4]
    relative_x, relative_y = vx - track.velocity_mps[0], vy - track.velocity_mps[1]
    rate = (now.east * relative_x + now.north * relative_y) / now.stretch
    late = slowness_spm * rate
    x, y = relative_x - late * vx, relative_y - late * vy
    along = slowness_spm * (vx * x + vy * y) + now.east * x + now.north * y
    jacobian = np.stack([x, y, now.time_s * x, now.time_s * y], 1)
    jacobian -= range_jacobian * along[:, np.newaxis]
    jacobian /= now.range_m[:, np.newaxis]
    jacobian[:, 2] += (1.0 - late) * now.east
    jacobian[:, 3] += (1.0 - late) * now.north
    return rate, jacobian / now.stretch[:, np.newaxis]
