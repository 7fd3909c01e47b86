"""Deviations that nobody stated, and deviations of measurements that overlap."""

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.target_motion.problem import wrap_rad

FITTED = 4
"""Parameters of a motion, that the residuals were fitted with."""

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


def correlation_inflation(z: FloatArray, heard: FloatArray, fewest_lags: int) -> float:
    """Return the variance factor that correlated measurements need, at least 1.

    Measurements of overlapping windows share samples, and all lines of a vessel
    wander with the speed of its shaft: neither is independent.

    Parameters
    ----------
    z
        Whitened residuals (stream, row).
    heard
        Weights; zero where nothing was measured.
    fewest_lags
        Distance in rows at which measurements still overlap.

    Notes
    -----
    Power of the residuals at zero frequency, s^2 (1 + 2 sum (1 - l/L) rho_l), with
    Bartlett's window over an eighth of the record (Newey & West 1987), for the sum
    over streams: correlation between streams counts as well. The window holds
    m = 1.5 n / L independent values of that power, and the fit of a motion has taken
    four of them away: the sum is raised by m / (m - 4).
    """
    valid = heard > 0
    count = np.count_nonzero(valid, axis=0)
    known = count > 0
    if np.count_nonzero(known) < FEWEST:
        return 1.0
    # outliers are for the loss to weigh, not for the deviations
    pooled = np.where(valid, np.clip(z, -5.0, 5.0), 0.0).sum(0)
    pooled = pooled / np.sqrt(np.maximum(count, 1))
    power = float((pooled**2).sum() / np.count_nonzero(known))
    total = power
    width = max(fewest_lags + 1, known.size // 8)
    for lag in range(1, width):
        pairs = np.count_nonzero(known[lag:] & known[:-lag])
        if pairs < FEWEST:
            break
        shared = float((pooled[lag:] * pooled[:-lag]).sum() / pairs)
        total += 2.0 * (1.0 - lag / width) * shared
    bands = 1.5 * known.size / width
    return float(max(total * bands / max(bands - FITTED, 1.0), power, 1.0))
