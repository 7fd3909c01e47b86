"""Scales and weights that a few wild measurements cannot move.

**Method.** The scale of residuals is 1.4826 times their median absolute value; the
weights are Tukey's bisquare with a wide constant, so that Gaussian data lose 1 % of
their efficiency and wild ones have no say at all.

**Conventions.** Missing measurements have weight zero; sums run over the last axis.

**References.** Huber and Ronchetti (2009), Robust Statistics, sections 5.1 and 7.8.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray

CONSTANT = 7.0
"""Deviations beyond so many scales have no weight: 99 % efficient on Gaussians."""

GAUSSIAN_CORRECTION = 1.0867
"""Makes the bisquare-weighted mean square of Gaussians their variance."""

PRIOR_COUNT = 8.0
"""Measurements that the expected scale of one counts for."""


def median_scale(residual: FloatArray, weight: FloatArray) -> FloatArray:
    """Return 1.4826 times the median of |residual| where the weight is positive.

    Parameters
    ----------
    residual
        Residuals, shape (..., n).
    weight
        Weights; zero marks a missing value.

    Examples
    --------
    >>> z = np.array([-1.0, 1.0, 1.0, 300.0, 0.0])
    >>> float(median_scale(z, np.ones(5)))
    1.4826
    """
    valid = weight > 0
    size = np.abs(residual)
    if valid.all() and size.shape[-1]:
        half = size.shape[-1] // 2
        low = size.shape[-1] - 1 - half
        ordered = np.partition(size, (low, half), axis=-1)
        return 0.7413 * np.asarray(ordered[..., low] + ordered[..., half])
    count = valid.sum(axis=-1)
    ordered = np.sort(np.where(valid, size, np.inf), axis=-1)
    middle = np.maximum(count - 1, 0)
    low = np.take_along_axis(ordered, (middle // 2)[..., None], axis=-1)[..., 0]
    high = np.take_along_axis(ordered, ((middle + 1) // 2)[..., None], axis=-1)[..., 0]
    scale: FloatArray = np.where(count > 0, 1.4826 * 0.5 * (low + high), 1.0)
    return scale


def neighbour_scale(
    residual: FloatArray, weight: FloatArray, correlation: float = 0.0
) -> FloatArray:
    """Return the scale of the part of the residuals that changes at every step.

    Slow wander does not move it: it looks at differences of neighbours only. It
    leans on the expected scale of one with the say of a few measurements.

    Parameters
    ----------
    residual
        Residuals in order of time, shape (..., n).
    weight
        Inverse variances expected; zero marks a missing value.
    correlation
        Known correlation of neighbouring measurements.

    Notes
    -----
    Mean square successive difference (von Neumann 1941) over its expectation,
    with bisquare weights about the median; missing values are stepped over.
    """
    packed, precision = residual, weight
    missing = weight <= 0
    if missing.any():
        order = np.argsort(missing, axis=-1, kind="stable")
        packed = np.take_along_axis(residual, order, axis=-1)
        precision = np.take_along_axis(weight, order, axis=-1)
    both = (precision[..., 1:] > 0) & (precision[..., :-1] > 0)
    with np.errstate(divide="ignore"):
        variance = (1 / precision[..., 1:] + 1 / precision[..., :-1]) * (
            1 - correlation
        )
    step = np.where(both, np.diff(packed, axis=-1), 0.0) / np.sqrt(
        np.where(both, variance, 1.0)
    )
    rough = np.maximum(median_scale(step, both.astype(float)), 1e-12)
    share = np.where(both, bisquare_weight(step / rough[..., None]), 0.0)
    square = (share * step**2).sum(axis=-1) * GAUSSIAN_CORRECTION
    total = share.sum(axis=-1) + PRIOR_COUNT
    scale: FloatArray = np.sqrt((square + PRIOR_COUNT) / total)
    return scale


def bisquare_weight(deviation: FloatArray) -> FloatArray:
    """Return Tukey's weights of deviations that are given in scales.

    Parameters
    ----------
    deviation
        Residuals divided by their scale.

    Examples
    --------
    >>> bisquare_weight(np.array([0.0, 8.0])).tolist()
    [1.0, 0.0]
    """
    weight: FloatArray = np.maximum(1 - (deviation / CONSTANT) ** 2, 0.0) ** 2
    return weight
