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

from uwtrack_cli.data.base import FloatArray


class State(NamedTuple):
    """Position and rate with the three entries of their covariance."""

    position: FloatArray
    rate: FloatArray
    variance: FloatArray
    covariance: FloatArray
    rate_variance: FloatArray


def predict(state: State, step_s: float, noise_density: FloatArray) -> State:
    """Carry the states over a time step with white acceleration.

    Parameters
    ----------
    state
        Filtered states.
    step_s
        Length of the step in s.
    noise_density
        Spectral density of the acceleration, unit^2/s^3 (not a variance).

    Notes
    -----
    x -> F x, P -> F P F' + q [T^3/3 T^2/2; T^2/2 T] (Choi 2014, eqs. 3 and 6).
    """
    rate_variance = state.rate_variance + noise_density * step_s
    covariance = (
        state.covariance
        + step_s * state.rate_variance
        + noise_density * (step_s**2 / 2.0)
    )
    variance = (
        state.variance
        + step_s * (2.0 * state.covariance + step_s * state.rate_variance)
        + noise_density * (step_s**3 / 3.0)
    )
    position = state.position + step_s * state.rate
    return State(position, state.rate, variance, covariance, rate_variance)


def update(state: State, innovation: FloatArray, noise_variance: FloatArray) -> State:
    """Improve predicted states by one measurement of each position.

    Parameters
    ----------
    state
        Predicted states.
    innovation
        Measured minus predicted position (bearings wrapped by the caller).
    noise_variance
        Variance of the measurement; ``inf`` where there is none.

    Notes
    -----
    For one scalar measurement Joseph's form reduces to the products below, which
    keep the covariance positive: every factor is in [0, 1].
    """
    total = state.variance + noise_variance
    gain = state.variance / total
    rate_gain = state.covariance / total
    keep = 1.0 - gain
    return State(
        state.position + gain * innovation,
        state.rate + rate_gain * innovation,
        keep * state.variance,
        keep * state.covariance,
        state.rate_variance - rate_gain * state.covariance,
    )


def smooth(
    filtered: State, smoothed: State, step_s: float, noise_density: FloatArray
) -> State:
    """Take one step back in time: smooth ``filtered`` by its smoothed successor.

    Parameters
    ----------
    filtered
        Filtered states at a time.
    smoothed
        Smoothed states one step later.
    step_s
        Length of the step in s.
    noise_density
        Density used in the prediction over that step, unit^2/s^3.

    Notes
    -----
    C = P F' inv(P-), x_s = x + C (x_s' - x-), P_s = P + C (P_s' - P-) C'
    (Rauch, Tung & Striebel 1965).
    """
    ahead = predict(filtered, step_s, noise_density)
    # P F' for F = [1 T; 0 1]
    a00 = filtered.variance + step_s * filtered.covariance
    a10 = filtered.covariance + step_s * filtered.rate_variance
    a01, a11 = filtered.covariance, filtered.rate_variance
    determinant = ahead.variance * ahead.rate_variance - ahead.covariance**2
    scale = 1.0 / np.maximum(determinant, np.finfo(float).tiny)
    c00 = (a00 * ahead.rate_variance - a01 * ahead.covariance) * scale
    c01 = (a01 * ahead.variance - a00 * ahead.covariance) * scale
    c10 = (a10 * ahead.rate_variance - a11 * ahead.covariance) * scale
    c11 = (a11 * ahead.variance - a10 * ahead.covariance) * scale
    dx = smoothed.position - ahead.position
    dv = smoothed.rate - ahead.rate
    d00 = smoothed.variance - ahead.variance
    d01 = smoothed.covariance - ahead.covariance
    d11 = smoothed.rate_variance - ahead.rate_variance
    e0, e1 = c00 * d00 + c01 * d01, c00 * d01 + c01 * d11
    return State(
        filtered.position + c00 * dx + c01 * dv,
        filtered.rate + c10 * dx + c11 * dv,
        filtered.variance + c00 * e0 + c01 * e1,
        filtered.covariance + c10 * e0 + c11 * e1,
        filtered.rate_variance + c10**2 * d00 + 2.0 * c10 * c11 * d01 + c11**2 * d11,
    )


def wrap_deg(angle_deg: FloatArray) -> FloatArray:
    """Bring angles in degrees to [-180, 180)."""
    return (angle_deg + 180.0) % 360.0 - 180.0
