"""Scales and weights that a few wild measurements cannot move.

**Method.** The scale of residuals is 1.4826 times their median absolute value; the
weights are Tukey's bisquare with a wide constant, so that Gaussian data lose 1 % of
their efficiency and wild ones have no say at all.

**Conventions.** Missing measurements have weight zero; sums run over the last axis.

**References.** Huber and Ronchetti (2009), Robust Statistics, sections 5.1 and 7.8.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.angles import wrap_rad

CONSTANT = 7.0
"""Deviations beyond so many scales have no weight: 99 % efficient on Gaussians."""

GAUSSIAN_CORRECTION = 1.0867
"""Makes the bisquare-weighted mean square of Gaussians their variance."""

SHARE_CORRECTION = 1.1257
"""Makes bisquare-weighted Gaussians of variance one again."""

FEWEST_VALUES = 6
"""Values from which a scatter can be estimated."""

PRIOR_COUNT = 8.0
"""Measurements that the expected scale of one counts for."""


def median_scale(residual: FloatArray, weight: FloatArray) -> FloatArray:
    """Return 1.4826 times the median of |residual| where the weight is positive.

    Examples
    --------
    >>> z = np.array([-1.0, 1.0, 1.0, 300.0, 0.0])
    >>> float(median_scale(z, np.ones(5)))
    1.4826
    """
    middle = median_where(np.abs(residual), weight)
    scale: FloatArray = np.where(np.isfinite(middle), 1.4826 * middle, 1.0)
    return scale


def median_where(value: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the median where the weight is positive; inf where it nowhere is."""
    if weight.all():
        ordered, size = np.sort(value, axis=-1), value.shape[-1]
        both: FloatArray = ordered[..., (size - 1) // 2] + ordered[..., size // 2]
        return 0.5 * both
    valid = weight > 0
    last = np.maximum(valid.sum(axis=-1) - 1, 0)[..., None]
    ordered = np.sort(np.where(valid, value, np.inf), axis=-1)
    low = np.take_along_axis(ordered, last // 2, axis=-1)
    high = np.take_along_axis(ordered, (last + 1) // 2, axis=-1)
    middle: FloatArray = 0.5 * (low + high)[..., 0]
    return middle


def median_centred(value: FloatArray, weight: FloatArray) -> FloatArray:
    """Return every row less its median where the weight is positive, and zero elsewhere.

    Examples
    --------
    >>> median_centred(np.array([[1.0, 2.0, 6.0, np.nan]]), np.array([[1, 1, 1, 0.0]]))
    array([[-1.,  0.,  4.,  0.]])
    """
    middle = median_where(value, weight)[..., None]
    used = (weight > 0) & np.isfinite(middle)
    return np.where(used, value - np.where(np.isfinite(middle), middle, 0.0), 0.0)


def neighbour_scale(
    residual: FloatArray, weight: FloatArray, correlation: FloatArray | float = 0.0
) -> FloatArray:
    """Return the scale of the part of the residuals that changes at every step.

    Slow variation does not move it: it looks at differences of neighbours in time only,
    whose ``correlation`` may be known, of all rows or of each. It leans on the expected
    scale of one, that of the weights' inverse variances, with the say of a few
    measurements.

    Notes
    -----
    Mean square successive difference (von Neumann 1941) over its expectation,
    with bisquare weights about the median; missing values are stepped over.
    """
    packed, precision = residual, weight
    if has_missing := not weight.all():
        missing = weight <= 0
        order = np.argsort(missing, axis=-1, kind="stable")
        packed = np.take_along_axis(residual, order, axis=-1)
        precision = np.take_along_axis(weight, order, axis=-1)
    with np.errstate(divide="ignore"):
        variance = 1 / precision
    variance = variance[..., 1:] + variance[..., :-1]
    both = np.isfinite(variance)
    variance *= np.asarray(1 - correlation)[..., None]
    step = packed[..., 1:] - packed[..., :-1]
    step /= np.sqrt(variance, out=variance)
    rough = np.maximum(median_scale(step, both), 1e-12)
    share = bisquare_weight(step / rough[..., None])
    if has_missing:
        share *= both
    step *= step
    step *= share
    square = step.sum(axis=-1) * GAUSSIAN_CORRECTION
    total = share.sum(axis=-1) + PRIOR_COUNT
    scale: FloatArray = np.sqrt((square + PRIOR_COUNT) / total)
    return scale


def bisquare_weight(deviation: FloatArray) -> FloatArray:
    """Return Tukey's weights of deviations that are given in scales.

    Examples
    --------
    >>> bisquare_weight(np.array([0.0, 8.0])).tolist()
    [1.0, 0.0]
    """
    weight = np.asarray(deviation / CONSTANT)
    weight *= weight
    np.subtract(1.0, weight, out=weight)
    np.maximum(weight, 0.0, out=weight)
    weight *= weight
    return weight


def white_scatter(values: FloatArray, *, circular: bool = False) -> float:
    """Estimate the deviation of white noise on a smooth course of values in time.

    Missing ones are nan; angles are in rad.

    Notes
    -----
    Median absolute second difference over 0.6745 sqrt(6): a straight course
    cancels, and outliers do not count.
    """
    heard = values[~np.isnan(values)]
    if heard.size < FEWEST_VALUES:
        return float("nan")
    first = np.diff(heard)
    if circular:
        first = wrap_rad(first)
    second = wrap_rad(np.diff(first)) if circular else np.diff(first)
    return float(np.median(np.abs(second)) / (0.6745 * np.sqrt(6.0)))
