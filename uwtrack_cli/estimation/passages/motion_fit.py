"""Straight motion on the plane from the closest approaches to several sensors.

**Method.** Every closest approach measures some of: time, range over speed, speed and
bearing. The motion (position and velocity at a reference time) is fitted to all of
them by weighted Gauss-Newton steps from many starts; distinct minima are kept.

**Conventions.** Unknowns are (east m, north m, east m/s, north m/s) at the reference
time; a measurement row is (time s, range over speed s, speed m/s, bearing rad).

**References.** Choi et al. (2014), eqs. 8-16, with A = t_d^2 - |D|^2 in eq. 15.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.least_squares import (
    Evaluation,
    damped_least_squares,
    inverse_or_nan,
)
from uwtrack_cli.physics.geometry import wrap_rad


@dataclass(frozen=True)
class Approaches:
    """Closest approaches as numbers, one row each; nan is not measured.

    In a study, ``measured`` and ``sensor`` may have a leading axis of runs.
    ``delay`` is 1/c where the time is that of arrival (no speed known), else 0.
    ``turn`` is 0 where the side is not known.
    """

    measured: FloatArray
    covariance: FloatArray
    turn: FloatArray
    sensor: FloatArray
    position_std_m: FloatArray
    height_m: FloatArray
    delay: FloatArray

    def take(self, rows: list[int]) -> "Approaches":
        """Return some of the rows."""
        return Approaches(
            self.measured[rows],
            self.covariance[rows],
            self.turn[rows],
            self.sensor[rows],
            self.position_std_m[rows],
            self.height_m[rows],
            self.delay[rows],
        )


@dataclass(frozen=True)
class MotionFit:
    """Fitted motions, one row per start: state, covariance and chi-square."""

    state: FloatArray
    covariance: FloatArray
    chi_square: FloatArray
    degrees_of_freedom: int


def fit_motion(
    approaches: Approaches, start: FloatArray, reference_s: float
) -> MotionFit:
    """Fit a straight motion from every start.

    Parameters
    ----------
    approaches
        Closest approaches of one vessel.
    start
        States to start from, shape (batch, 4).
    reference_s
        Time of the state in seconds.
    """

    def evaluate(state: FloatArray) -> Evaluation:
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
    cost, _, matrix = evaluate(state)
    count = np.isfinite(approaches.measured).sum(axis=(-2, -1))
    return MotionFit(state, inverse_or_nan(matrix), 2 * cost, int(np.max(count)) - 4)


def predict_approaches(
    state: FloatArray, approaches: Approaches, reference_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return the measurements of every approach, and their partials.

    Parameters
    ----------
    state
        Motions, shape (batch, 4).
    approaches
        Sensors and depth differences.
    reference_s
        Time of the state in seconds.
    """
    rel = state[:, None, :2] - approaches.sensor
    vel = np.broadcast_to(state[:, None, 2:], rel.shape)
    speed = np.hypot(vel[..., 0], vel[..., 1])
    ahead = np.stack([vel[..., 1], -vel[..., 0]], axis=-1) / speed[..., None]
    lag = -(rel * vel).sum(axis=-1) / speed**2
    miss = (rel * ahead).sum(axis=-1)
    slant = np.hypot(miss, approaches.height_m)
    course = np.arctan2(vel[..., 0], vel[..., 1])
    bearing = course + np.where(miss >= 0, 0.5, -0.5) * np.pi
    predicted = np.stack(
        [
            reference_s + lag + slant * approaches.delay,
            slant / speed,
            speed,
            bearing,
        ],
        axis=-1,
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
    slope[..., 0, 2:] = (
        -(rel + 2 * lag[..., None] * vel) / square + share * miss_v * delay[:, None]
    )
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


def speed_from_two(
    sensor: FloatArray, time_s: FloatArray, miss: FloatArray
) -> FloatArray:
    """Return the speed from two closest approaches without Doppler, nan if none.

    Parameters
    ----------
    sensor
        Positions in metres, shape (..., 2, 2).
    time_s
        Times of the closest approaches in seconds, shape (..., 2).
    miss
        Range over speed times the unit vector of the bearing, seconds, shape
        (..., 2, 2).

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
