"""Straight motion on the plane from the closest approaches to several sensors.

**Method.** Every closest approach measures some of: time, range over speed, speed and
bearing. The motion (position and velocity at a reference time) is fitted to all of
them by weighted Gauss-Newton steps from many starts; distinct minima are kept. A
closest approach with speed, bearing and side gives a start by itself; two with
bearings give the speed by the corrected quadratic; what is missing is filled by a fan
of courses, both sides and a few speeds.

**Conventions.** Unknowns are (east m, north m, east m/s, north m/s) at the reference
time; a measurement row is (time s, range over speed s, speed m/s, bearing rad).

**References.** Choi et al. (2014), eqs. 1 and 8-18, with A = t_d^2 - |D|^2 in eq. 15
and the side per sensor.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.rows import Rows
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.estimation.least_squares import Evaluation, damped_least_squares, inverse_or_nan


@dataclass(frozen=True)
class Approaches(Rows):
    """Closest approaches as numbers, one row each; nan is not measured.

    In a study, ``measured`` and ``sensor`` may have a leading axis of runs.
    """

    measured: FloatArray
    """Time (s), range over speed (s), speed (m/s) and bearing (rad), shape (...,
    rows, 4)."""
    covariance: FloatArray
    """Their covariance, shape (rows, 4, 4)."""
    turn: FloatArray
    """Sign of the bearing trend, +1 or -1; 0 where the side is not known, shape
    (rows,)."""
    sensor: FloatArray
    """East and north of the sensor, m, shape (..., rows, 2)."""
    position_std_m: FloatArray
    """Deviation of each coordinate of the sensor, m, shape (rows,)."""
    height_m: FloatArray
    """Depth between sensor and source, m, shape (rows,)."""
    delay: FloatArray
    """1/c in s/m where the time is that of arrival (no speed known), else 0, shape
    (rows,)."""

    velocity_mps: FloatArray | None = None
    """Velocity of the sensor east and north, m/s, shape (rows, 2): its place is that at
    the measured time. None is a sensor at rest."""

    def place_at(self, time_s: float) -> FloatArray:
        """Return east and north of the sensors at a time, m, shape (..., rows, 2)."""
        if self.velocity_mps is None:
            return self.sensor
        lag = time_s - np.nan_to_num(self.measured[..., 0], nan=time_s)
        return self.sensor + self.velocity_mps * lag[..., None]


@dataclass(frozen=True)
class MotionFit:
    """Fitted motions, one row per start: state, covariance and chi-square."""

    state: FloatArray
    """East, north (m), east and north velocity (m/s), shape (starts, 4)."""
    covariance: FloatArray
    """Covariance of the state, shape (starts, 4, 4)."""
    chi_square: FloatArray
    """Weighted sum of squares, shape (starts,)."""
    degrees_of_freedom: int
    """Measured values less four."""


def fit_motion(approaches: Approaches, start: FloatArray, reference_s: float) -> MotionFit:
    """Fit a straight motion, shape (4,) at the reference time, from every start."""

    def evaluate(state: FloatArray, _: IntArray) -> Evaluation:
        predicted, slope = predict_approaches(state, approaches, reference_s)
        information = _information(approaches, slope)
        known = np.isfinite(approaches.measured)
        residual = np.where(known, approaches.measured - predicted, 0.0)
        residual[..., 3] = wrap_rad(residual[..., 3])
        weighted = np.einsum("bmij,bmj->bmi", information, residual)
        cost = 0.5 * (weighted * residual).sum(axis=(1, 2))
        gradient = -np.einsum("bmip,bmi->bp", slope, weighted)
        matrix = np.einsum("bmip,bmij,bmjq->bpq", slope, information, slope)
        return cost, gradient, matrix

    def limit(state: FloatArray, step: FloatArray) -> FloatArray:
        speed = np.hypot(state[:, 2], state[:, 3])
        size = np.hypot(step[:, 2], step[:, 3])
        factor = np.minimum(1.0, 0.5 * speed / np.maximum(size, 1e-300))
        limited: FloatArray = step * factor[:, None]
        return limited

    state = damped_least_squares(evaluate, start, limit, max_steps=60, tolerance=1e-9)
    cost, _, matrix = evaluate(state, np.arange(len(state)))
    count = np.isfinite(approaches.measured).sum(axis=(-2, -1))
    return MotionFit(state, inverse_or_nan(matrix), 2 * cost, int(np.max(count)) - 4)


def predict_approaches(
    state: FloatArray, approaches: Approaches, reference_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return the measurements of every approach by motions (batch, 4), and partials."""
    rel = state[:, None, :2] - approaches.place_at(reference_s)
    own = 0.0 if approaches.velocity_mps is None else approaches.velocity_mps
    vel = np.broadcast_to(state[:, None, 2:] - own, rel.shape)
    speed = np.hypot(vel[..., 0], vel[..., 1])
    ahead = np.stack([vel[..., 1], -vel[..., 0]], axis=-1) / speed[..., None]
    lag = -(rel * vel).sum(axis=-1) / speed**2
    miss = (rel * ahead).sum(axis=-1)
    slant = np.hypot(miss, approaches.height_m)
    course = np.arctan2(vel[..., 0], vel[..., 1])
    bearing = course + np.where(miss >= 0, 0.5, -0.5) * np.pi
    predicted = np.stack(
        [reference_s + lag + slant * approaches.delay, slant / speed, speed, bearing], axis=-1
    )
    slope = _slopes(rel, vel, speed, ahead, (lag, miss, slant, approaches.delay))
    return predicted, slope


def _slopes(
    rel: FloatArray,
    vel: FloatArray,
    speed: FloatArray,
    ahead: FloatArray,
    passage: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
) -> FloatArray:
    lag, miss, slant, delay = passage
    square = speed[..., None] ** 2
    miss_v = (
        np.stack([-rel[..., 1], rel[..., 0]], axis=-1) / speed[..., None]
        - miss[..., None] * vel / square
    )
    share = (miss / np.maximum(slant, 1e-12))[..., None]
    slope = np.zeros((*rel.shape[:-1], 4, 4))
    slope[..., 0, :2] = -vel / square + share * ahead * delay[:, None]
    slope[..., 0, 2:] = -(rel + 2 * lag[..., None] * vel) / square + share * miss_v * delay[:, None]
    slope[..., 1, :2] = share * ahead / speed[..., None]
    slope[..., 1, 2:] = share * miss_v / speed[..., None] - slant[..., None] * vel / (
        square * speed[..., None]
    )
    slope[..., 2, 2:] = vel / speed[..., None]
    slope[..., 3, 2:] = ahead / speed[..., None]
    return slope


def _information(approaches: Approaches, slope: FloatArray) -> FloatArray:
    """Inverse covariances, the sensors' own positions included."""
    known = np.isfinite(approaches.measured)
    both = known[..., :, None] & known[..., None, :]
    inner = np.where(both, approaches.covariance, 0.0)
    by_position = slope[..., :2] * approaches.position_std_m[..., None, None]
    moved = np.where(both, by_position @ np.swapaxes(by_position, -1, -2), 0.0)
    filled = inner + moved + np.where(known[..., :, None], 0.0, np.eye(4))
    scale = np.sqrt(np.einsum("...ii->...i", filled))
    outer = scale[..., :, None] * scale[..., None, :]
    inverse = np.linalg.inv(filled / outer) / outer
    information: FloatArray = np.where(both, inverse, 0.0)
    return information


def clock_errors(
    approaches: Approaches, state: FloatArray, reference_s: float, clock_std_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Estimate the clock error of every row from a fitted motion, with its covariance.

    The covariance of the approaches holds the clocks, whose prior deviations are given,
    s.

    Notes
    -----
    Best linear unbiased prediction of a random effect (Robinson 1991, Statist. Sci. 6,
    15): S E' P y with P = V^-1 - V^-1 H (H' V^-1 H)^-1 H' V^-1.
    """
    predicted, slope = predict_approaches(state[None], approaches, reference_s)
    information = _information(approaches, slope)[0]
    residual = np.where(np.isfinite(approaches.measured), approaches.measured - predicted[0], 0.0)
    residual[:, 3] = wrap_rad(residual[:, 3])
    weighted = information @ slope[0]
    cross = inverse_or_nan(np.einsum("mip,miq->pq", slope[0], weighted)[None])[0]
    times = weighted[:, 0]
    variance = clock_std_s**2
    # the residuals are those of the fit, so that V^-1 y is P y already
    offset = variance * np.einsum("mj,mj->m", information[:, 0], residual)
    projector = np.diag(information[:, 0, 0]) - times @ cross @ times.T
    spread = np.diag(variance) - np.outer(variance, variance) * projector
    return offset, spread


def speed_from_two(sensor: FloatArray, time_s: FloatArray, miss: FloatArray) -> FloatArray:
    """Return the speed from two closest approaches without Doppler, nan if none.

    Of positions of the sensors, m, and range over speed times the unit vector of the
    bearing, s, shape (..., 2, 2), and the times, s, shape (..., 2).

    Notes
    -----
    Choi et al. (2014), eqs. 15-16 corrected: A v^2 - 2 B v - C = 0 with
    A = t_d^2 - |D|^2, B = ds . D, C = |ds|^2; no speed where A <= 0.

    Examples
    --------
    Two sensors 1000 m apart on opposite sides, 100 m off a track at 10 m/s.

    >>> s = np.array([[0.0, 0.0], [200.0, 1000.0]])
    >>> m = np.array([[10.0, 0.0], [-10.0, 0.0]])
    >>> float(speed_from_two(s, np.array([0.0, 100.0]), m))
    10.0
    """
    apart = time_s[..., 1] - time_s[..., 0]
    base = sensor[..., 1, :] - sensor[..., 0, :]
    turn = miss[..., 1, :] - miss[..., 0, :]
    a = apart**2 - (turn**2).sum(axis=-1)
    b = (base * turn).sum(axis=-1)
    c = (base**2).sum(axis=-1)
    good = a > 0
    root = np.sqrt(np.maximum(b**2 + a * c, 0.0))
    speed: FloatArray = np.where(good, (b + root) / np.where(good, a, 1.0), np.nan)
    return speed


N_COURSES = 36


def motion_starts(approaches: Approaches, reference_s: float) -> FloatArray:
    """Return states to start a motion fit from, shape (starts, 4)."""
    speeds = _speeds(approaches)
    found: list[FloatArray] = []
    for row in range(approaches.turn.size):
        time, width, speed, bearing = approaches.measured[row]
        if not np.isfinite(time + width):
            continue
        candidates = np.array([speed]) if np.isfinite(speed) else speeds
        if np.isfinite(bearing) and approaches.turn[row]:
            angle, turn = np.array([bearing]), np.array([approaches.turn[row]])
        elif len(found) < 4:
            fan = 2 * np.pi * np.arange(N_COURSES) / N_COURSES
            angle = np.tile(fan, 2)
            turn = np.repeat([1.0, -1.0], N_COURSES)
        else:
            continue
        found.append(_states(approaches, row, reference_s, (candidates, angle, turn)))
    return np.concatenate(found) if found else np.empty((0, 4))


def _speeds(approaches: Approaches) -> FloatArray:
    """Speeds measured, from pairs, or from the time between distant sensors."""
    measured = approaches.measured[:, 2]
    known = measured[np.isfinite(measured)]
    if known.size:
        return np.array([float(np.median(known))])
    time, width, _, bearing = approaches.measured.T
    vector = width[:, None] * np.stack([np.sin(bearing), np.cos(bearing)], axis=-1)
    speeds = []
    for pair in combinations(range(time.size), 2):
        rows = list(pair)
        base = float(np.hypot(*(np.diff(approaches.sensor[rows], axis=0)[0])))
        if base == 0:
            continue
        quadratic = float(speed_from_two(approaches.sensor[rows], time[rows], vector[rows]))
        apart = abs(float(np.diff(time[rows])[0])) + float(width[rows].sum())
        rough = base / max(apart, 1e-9)
        speeds += [quadratic] if quadratic > 0 else [rough, 3 * rough, 0.3 * rough]
    return np.array(speeds)


def _states(
    approaches: Approaches,
    row: int,
    reference_s: float,
    fan: tuple[FloatArray, FloatArray, FloatArray],
) -> FloatArray:
    speed, angle, turn = fan
    time, width = approaches.measured[row, :2]
    speed = np.repeat(speed, angle.size)
    angle, turn = np.resize(angle, speed.size), np.resize(turn, speed.size)
    height = approaches.height_m[row]
    flat = np.sqrt(np.maximum((width * speed) ** 2 - height**2, 1e-6))
    out = np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    along = turn[:, None] * np.stack([np.cos(angle), -np.sin(angle)], axis=-1)
    velocity = speed[:, None] * along
    if approaches.velocity_mps is not None:
        velocity = velocity + approaches.velocity_mps[row]
    nearest = approaches.sensor[row] + flat[:, None] * out
    return np.concatenate([nearest + velocity * (reference_s - time), velocity], axis=-1)
