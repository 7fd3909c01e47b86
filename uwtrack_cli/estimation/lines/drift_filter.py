"""The filter of a contact that only drifts, on its bearing alone.

**Method.** An extended Kalman filter of bearing and inverse range: a repeater answers with
a false range and range rate, so that own ship's motion past it must tell the range.

**Conventions.** As in `uwtrack_cli.estimation.pairs.contact_filters`; the density of the
innovation has no factor of 2 pi, as the moving filter's has none.

**References.** Jeong and Hong (1996), equations 7-16 as corrected; Aidala and Hammel
(1983) for the modified polar state.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.pairs.contact_filters import Fit, Observation, wrap


@dataclass(frozen=True)
class Drift:
    """State of the drifting filter: bearing and inverse range."""

    mean: FloatArray
    covariance: FloatArray


def start_drift(seen: Observation, relative_std: float = 0.5) -> Drift:
    """Begin a drifting filter at a measurement.

    Parameters
    ----------
    seen
        The measurement; its range is only a first guess.
    relative_std
        Standard deviation of the inverse range over the inverse of the range measured.

    Notes
    -----
    P = diag(s_b^2, (0.5 / z_range)^2). The source prints 2 / z_range, which does worse.
    """
    inverse = 1.0 / seen.measured[..., 0]
    mean = np.stack([seen.measured[..., 1], inverse], axis=-1)
    covariance = np.zeros((*inverse.shape, 2, 2))
    covariance[..., 0, 0] = seen.variance[..., 1]
    covariance[..., 1, 1] = (relative_std * inverse) ** 2
    return Drift(mean, covariance)


def predict_drift(
    drift: Drift, interval_s: float, displacement: FloatArray, speed_std_mps: float
) -> Drift:
    """Carry a drifting filter over own ship's displacement.

    Parameters
    ----------
    drift
        The filter after the last scan.
    interval_s
        Time step in s.
    displacement
        Own ship's way east and north in the step, ``(..., 2)`` in m.
    speed_std_mps
        Root intensity of the drift in m/s^(1/2).

    Notes
    -----
    S1 = s (u1 sin theta - u2 cos theta), S2 = 1 - s (u1 cos theta + u2 sin theta);
    theta + atan2(S1, S2), s / sqrt(S1^2 + S2^2) (Jeong and Hong 1996, eqs. 10-14).
    """
    theta, inverse = drift.mean[..., 0], drift.mean[..., 1]
    sine, cosine = np.sin(theta), np.cos(theta)
    u1, u2 = displacement[..., 0], displacement[..., 1]
    side = u1 * sine - u2 * cosine
    ahead = u1 * cosine + u2 * sine
    s1, s2 = inverse * side, 1.0 - inverse * ahead
    square = s1**2 + s2**2
    mean = np.stack(
        [wrap(theta + np.arctan2(s1, s2)), inverse / np.sqrt(square)], axis=-1
    )
    # d atan2(S1, S2) = (S2 dS1 - S1 dS2) / (S1^2 + S2^2), and likewise for the range.
    s1_theta, s2_theta = inverse * ahead, inverse * side
    s1_s, s2_s = side, -ahead
    root = square**-1.5
    slope = np.stack(
        [
            1.0 + (s2 * s1_theta - s1 * s2_theta) / square,
            (s2 * s1_s - s1 * s2_s) / square,
            -inverse * (s1 * s1_theta + s2 * s2_theta) * root,
            square**-0.5 - inverse * (s1 * s1_s + s2 * s2_s) * root,
        ],
        axis=-1,
    ).reshape(*theta.shape, 2, 2)
    covariance = slope @ drift.covariance @ np.swapaxes(slope, -1, -2)
    walk = interval_s * speed_std_mps**2
    covariance[..., 0, 0] += inverse**2 * walk
    covariance[..., 1, 1] += inverse**4 * walk
    return Drift(mean, covariance)


def update_drift(drift: Drift, seen: Observation) -> tuple[Drift, Fit]:
    """Correct a drifting filter by a bearing.

    Parameters
    ----------
    drift
        The filter, predicted.
    seen
        The measurement; range and range rate are not used.

    Returns
    -------
    tuple
        The filter after the scan, and how well it had foreseen it.
    """
    bearing = seen.measured[..., 1]
    known = np.isfinite(bearing)
    residual = np.where(known, wrap(bearing - drift.mean[..., 0]), 0.0)
    column = np.where(known[..., None], drift.covariance[..., 0], 0.0)
    spread = np.where(known, drift.covariance[..., 0, 0] + seen.variance[..., 1], 1.0)
    gain = column / spread[..., None]
    mean = drift.mean + gain * residual[..., None]
    # A range cannot be negative; the bearing alone does not know that.
    mean[..., 1] = np.maximum(mean[..., 1], 1e-6)
    covariance = drift.covariance - gain[..., :, None] * column[..., None, :]
    distance2 = residual**2 / spread
    density = -0.5 * (np.log(spread) + distance2)
    return Drift(mean, covariance), Fit(density, distance2, known.astype(np.int64))
