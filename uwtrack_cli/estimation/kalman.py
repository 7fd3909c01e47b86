"""Two-state Kalman filters for many lines at once, element by element.

**Method.** The four-state filter of a line (bearing, its rate, frequency, its rate)
is block-diagonal, so it is two independent filters of position and rate. Each is
written in closed form on whole arrays: one call advances every line, for both
quantities, without a loop over the lines.

**Conventions.** Arrays have the quantity (frequency, bearing) as the first axis and
the line as the second, and any broadcastable shape works. A measurement without
information has the variance ``inf`` and leaves the state as it is.

**References.** Choi (2014), equations 1-8; Rauch, Tung & Striebel, AIAA J. 3(8),
1445-1450 (1965) for the smoother; Bar-Shalom, Li & Kirubarajan, "Estimation with
Applications to Tracking and Navigation" (2001), section 6.2 for the process noise.
"""

from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.constant_velocity import white_acceleration


class KalmanState(NamedTuple):
    """Position and rate with the three entries of their covariance, per quantity."""

    position: FloatArray
    """Position (frequency in Hz, bearing in degrees)."""
    rate: FloatArray
    """Its rate per second."""
    variance: FloatArray
    """Variance of the position."""
    covariance: FloatArray
    """Covariance of position and rate."""
    rate_variance: FloatArray
    """Variance of the rate."""


def predict(
    state: KalmanState, step_s: float | FloatArray, noise_density: FloatArray
) -> KalmanState:
    """Carry the states over a time step, s, with white acceleration.

    Its spectral density is in unit^2/s^3, and no variance.

    Notes
    -----
    x -> F x, P -> F P F' + q [T^3/3 T^2/2; T^2/2 T] (Choi 2014, eqs. 3 and 6).
    """
    noise = white_acceleration(step_s)
    rate_variance = state.rate_variance + noise_density * noise.rate
    covariance = state.covariance + step_s * state.rate_variance + noise_density * noise.covariance
    variance = (
        state.variance
        + step_s * (2.0 * state.covariance + step_s * state.rate_variance)
        + noise_density * noise.position
    )
    position = state.position + step_s * state.rate
    return KalmanState(position, state.rate, variance, covariance, rate_variance)


def advance(state: KalmanState, step_s: float, noise_density: FloatArray) -> None:
    """Carry the states over a time step in place, as `predict` does."""
    noise = white_acceleration(step_s)
    growth = step_s * state.rate_variance
    position, rate, variance, covariance, rate_variance = state
    position += step_s * rate
    variance += step_s * (2.0 * covariance + growth) + noise_density * noise.position
    covariance += growth + noise_density * noise.covariance
    rate_variance += noise_density * noise.rate


def update(state: KalmanState, innovation: FloatArray, noise_variance: FloatArray) -> KalmanState:
    """Improve predicted states by one measurement of each position.

    The innovation is measured minus predicted position, bearings wrapped by the caller;
    the variance is ``inf`` where there is none.

    Notes
    -----
    For one scalar measurement Joseph's form reduces to the products below, which
    keep the covariance positive: every factor is in [0, 1].
    """
    total = state.variance + noise_variance
    gain = state.variance / total
    rate_gain = state.covariance / total
    keep = 1.0 - gain
    return KalmanState(
        state.position + gain * innovation,
        state.rate + rate_gain * innovation,
        keep * state.variance,
        keep * state.covariance,
        state.rate_variance - rate_gain * state.covariance,
    )


def smooth_all(states: FloatArray, steps_s: FloatArray, noise_density: FloatArray,
               is_inside: BoolArray) -> None:  # fmt: skip
    """Smooth filtered states in place, from the last time back to the first.

    Parameters
    ----------
    states
        The five entries of `KalmanState` at every time, ``(time, 5, ...)``, filtered.
    steps_s
        Time from each time's predecessor in s, shape ``(time,)``.
    noise_density
        Density used in the predictions from every time but the last to the next one,
        unit^2/s^3, ``(...)`` or ``(time - 1, ...)``.
    is_inside
        Whether a time has a successor that belongs to the same line, ``(time, ...)``.

    Notes
    -----
    C = P F' inv(P-), x_s = x + C (x_s' - x-), P_s = P + C (P_s' - P-) C'
    (Rauch, Tung & Striebel 1965). C needs no smoothed state, so it is found for all
    times at once; what remains for each time is linear in the successor's state.
    """
    if states.shape[0] < 2:
        return
    now = KalmanState(*np.moveaxis(states[:-1], 1, 0))
    step = steps_s[1:].reshape(-1, *(1,) * (states.ndim - 2))
    ahead = predict(now, step, noise_density)
    gain = np.where(is_inside[:-1, None, None], _smoother_gain(now, ahead, step), 0.0)
    (a, b), (c, d) = np.moveaxis(gain, (1, 2), (0, 1))
    two = np.stack([
        np.stack([a * a, 2.0 * a * b, b * b], 1),
        np.stack([a * c, a * d + b * c, b * d], 1),
        np.stack([c * c, 2.0 * c * d, d * d], 1),
    ], 1)  # fmt: skip
    before = np.stack(ahead, 1)
    for k in range(states.shape[0] - 2, -1, -1):
        off = states[k + 1] - before[k]
        states[k, :2] += (gain[k] * off[:2]).sum(axis=1)
        states[k, 2:] += (two[k] * off[2:]).sum(axis=1)


def _smoother_gain(now: KalmanState, ahead: KalmanState, step_s: FloatArray) -> FloatArray:
    """Return C = P F' inv(P-) for F = [1 T; 0 1], shape ``(time, 2, 2, ...)``."""
    a00 = now.variance + step_s * now.covariance
    a10 = now.covariance + step_s * now.rate_variance
    a01, a11 = now.covariance, now.rate_variance
    determinant = ahead.variance * ahead.rate_variance - ahead.covariance**2
    scale = 1.0 / np.maximum(determinant, np.finfo(float).tiny)
    first = np.stack([
        a00 * ahead.rate_variance - a01 * ahead.covariance,
        a01 * ahead.variance - a00 * ahead.covariance,
    ], 1)  # fmt: skip
    second = np.stack([
        a10 * ahead.rate_variance - a11 * ahead.covariance,
        a11 * ahead.variance - a10 * ahead.covariance,
    ], 1)  # fmt: skip
    return np.stack([first, second], 1) * scale[:, None, None]
