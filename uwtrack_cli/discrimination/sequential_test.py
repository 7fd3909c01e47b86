"""Wald's sequential probability ratio test, and what a test of fixed length costs.

**Method.** Log likelihood ratios are added up until they leave an interval. Crossing its
upper end decides for the alternative, crossing the lower for the null hypothesis.

**Conventions.** A miss is deciding for the null hypothesis when the alternative holds; a
false alarm is the opposite. Scans lie on the first axis, further axes are tests run
together.

**References.** Wald (1947); Siegmund (1985) for the overshoot; Jeong and Hong (1996),
equations 1-4.
"""

import math
import sys
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray

_OVERSHOOT = 0.5826
"""Mean overshoot of a Gaussian walk in deviations of its step (Siegmund 1985)."""


@dataclass(frozen=True)
class Thresholds:
    """Ends of the interval in which another scan is taken."""

    lower: float
    """Log odds that decide for the null hypothesis."""
    upper: float
    """Log odds that decide for the alternative."""


class Crossing(NamedTuple):
    """Where tests left their interval."""

    scan: IntArray
    """Scan, counted from 0; -1 for never."""
    decision: IntArray
    """1 for the alternative, -1 for the null hypothesis, 0 for undecided."""


def wald_thresholds(miss: float, false_alarm: float) -> Thresholds:
    """Return the thresholds for two error probabilities in (0, 1), their sum below 1.

    Notes
    -----
    ln((1 - P_M) / P_F) and ln(P_M / (1 - P_F)) (Wald 1947).

    Examples
    --------
    >>> round(wald_thresholds(0.05, 0.05).upper, 3)
    2.944
    """
    return Thresholds(
        math.log(miss / (1.0 - false_alarm)), math.log((1.0 - miss) / false_alarm)
    )


def first_crossing(log_odds: FloatArray, thresholds: Thresholds) -> "Crossing":
    """Find where walks of log odds, ``(scan, ...)``, first leave the interval."""
    above = log_odds >= thresholds.upper
    outside = above | (log_odds <= thresholds.lower)
    decided = outside.any(axis=0)
    scan = outside.argmax(axis=0)
    up = np.take_along_axis(above, scan[None], axis=0)[0]
    decision = np.where(decided, np.where(up, 1, -1), 0)
    return Crossing(np.where(decided, scan, -1), decision)


def expected_scans(
    mean: float, deviation: float, thresholds: Thresholds, error: float
) -> float:
    """Return the mean number of scans until a decision, wrong with a probability.

    Mean, above 0, and deviation are those of the log likelihood ratio per scan towards
    the truth.

    Notes
    -----
    Wald's identity with Siegmund's overshoot: E[n] = ((1 - e) h - e h) / mean, h the
    threshold plus 0.5826 deviations.

    Examples
    --------
    >>> symmetric = wald_thresholds(0.05, 0.05)
    >>> round(expected_scans(0.5, 1.0, symmetric, 0.02855), 3)
    6.651
    """
    height = 0.5 * (thresholds.upper - thresholds.lower) + _OVERSHOOT * deviation
    return (1.0 - 2.0 * error) * height / mean


def scans_to(walk: FloatArray, height: float, steady: float) -> float:
    """Return the mean number of scans after which walks like one seen reach a height.

    Log odds towards the truth, ``(scan,)``, need not grow evenly: the scans below the
    height are counted, of which as many come too early as too late. ``steady`` is the
    number at even growth, for a walk that ends below.

    Examples
    --------
    >>> scans_to(np.array([0.1, 0.3, 2.0, 4.0, 3.5]), 2.5, 4.0)
    4.0
    """
    return steady if walk[-1] < height else float(np.count_nonzero(walk < height) + 1)


def overshoot_error(thresholds: Thresholds, deviation: float) -> float:
    """Return the error rate of a symmetric test, which its overshoot makes smaller.

    The deviation is that of the log likelihood ratio per scan.

    Examples
    --------
    >>> round(overshoot_error(wald_thresholds(0.05, 0.05), 1.0), 5)
    0.02855
    """
    odds = math.exp(-(thresholds.upper + _OVERSHOOT * deviation))
    return odds / (1.0 + odds)


def fixed_scans(mean: float, deviation: float, error: float) -> float:
    """Return the length of a test of fixed length with the same error, below 0.5.

    Mean and deviation are those of `expected_scans`.

    Notes
    -----
    n = (z_e deviation / mean)^2 with z_e the normal quantile, and at least one scan. An
    error too small for the number format counts as the smallest number.

    Examples
    --------
    >>> round(fixed_scans(0.5, 1.0, 0.02855), 2)
    14.48
    >>> fixed_scans(1e4, 100.0, 0.0)
    1.0
    """
    from scipy.special import ndtri

    quantile = float(ndtri(max(error, sys.float_info.min)))
    return max((quantile * deviation / mean) ** 2, 1.0)
