"""Deviations that nobody stated, and deviations of measurements that overlap."""

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.target_motion.problem import wrap_rad

FEWEST = 6
"""Values from which a scatter can be estimated."""


def white_scatter(values: FloatArray, *, circular: bool = False) -> float:
    """Estimate the deviation of white noise on a smooth course of values.

    Parameters
    ----------
    values
        Values in the order of time; nan where there is none; rad if circular.
    circular
        Whether the values are angles.

    Notes
    -----
    Median absolute second difference over 0.6745 sqrt(6): a straight course
    cancels, and outliers do not count.
    """
    heard = values[~np.isnan(values)]
    if heard.size < FEWEST:
        return float("nan")
    first = np.diff(heard)
    if circular:
        first = wrap_rad(first)
    second = wrap_rad(np.diff(first)) if circular else np.diff(first)
    return float(np.median(np.abs(second)) / (0.6745 * np.sqrt(6.0)))


def overlap_inflation(z: FloatArray, heard: FloatArray, lags: int) -> float:
    """Return the variance factor that overlapping measurements need, at least 1.

    Parameters
    ----------
    z
        Whitened residuals (stream, row).
    heard
        Which of them were measured.
    lags
        Largest distance in rows at which measurements still overlap.

    Notes
    -----
    s^2 (1 + 2 sum rho_l): the variance of a mean of correlated errors
    (Bayley & Hammersley 1946), with s^2 the mean square of the residuals.
    """
    valid = heard > 0
    if np.count_nonzero(valid) < FEWEST:
        return 1.0
    z = np.clip(np.where(valid, z, 0.0), -5.0, 5.0)
    power = float((z**2).sum() / np.count_nonzero(valid))
    total = power
    for lag in range(1, min(lags, z.shape[1] - 1) + 1):
        pairs = np.count_nonzero(valid[:, lag:] & valid[:, :-lag])
        if pairs >= FEWEST:
            total += 2.0 * float((z[:, lag:] * z[:, :-lag]).sum() / pairs)
    return max(total, power, 1.0)
