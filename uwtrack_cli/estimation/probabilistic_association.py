"""Probabilistic data association: one target among false measurements.

**Method.** Every measurement in the gate may be the target's, or none. The filter is
corrected by the mean over these hypotheses, and its covariance grows by their spread.

**Conventions.** The state interleaves each measured component with its rate (z_1, v_1,
z_2, v_2 ...), so that observing is taking every second entry. Leading axes are runs,
targets or motion models stepped together; measurements lie on the axis ``k`` and are
padded, with a mask. Measurement noise has a ``k`` axis too, of length one when it is
common to a scan. The gate's radius is in standard deviations.

**References.** Bar-Shalom and Tse (1975); Fortmann, Bar-Shalom and Scheffe (1983); Choi,
Kim and Hong (2001), equations 1-16 as corrected. Measurements of unequal accuracy follow
from the same mixture with a gain of their own each.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.data.rows import Rows
from uwtrack_cli.errors import DataError

_TINY = float(np.finfo(np.float64).tiny)
_SIGNS = np.array([[1.0, -1.0], [-1.0, 1.0]])
"""Of the entries of a symmetric matrix of two rows, turned by half a circle, that make its
adjugate."""


class Expected(NamedTuple):
    """What is expected to be measured of a state, where that is not its components."""

    measured: FloatArray
    """Measurement, ``(..., m)``."""
    slope: FloatArray
    """Its derivative by the state, ``(..., m, n)``."""


@dataclass(frozen=True)
class Innovation(Rows):
    """What a scan brings against a prediction, before any association."""

    residual: FloatArray
    """Measured minus predicted, ``(..., k, m)``; 0 where there is no measurement."""
    covariance: FloatArray
    """S of each measurement, ``(..., k or 1, m, m)``."""
    gain: FloatArray
    """Kalman gain W of each, ``(..., k or 1, n, m)``."""
    distance2: FloatArray
    """Squared Mahalanobis distance, ``(..., k)``; infinite without measurement."""
    determinant: FloatArray
    """|S|, ``(..., k or 1)``."""
    move: FloatArray
    """Change of the state W nu by each measurement, ``(..., k, n)``."""
    reduction: FloatArray
    """Decrease of the covariance W S W', ``(..., k or 1, n, n)``."""
    density: FloatArray
    """Gaussian density of each measurement, ``(..., k)``; 0 where there is none."""


@dataclass(frozen=True)
class Association(Rows):
    """Probabilities of the hypotheses of one scan."""

    miss: FloatArray
    """Probability that no measurement is the target's, ``(...)``."""
    weight: FloatArray
    """Probability that a measurement is the target's, ``(..., k)``."""
    log_likelihood_ratio: FloatArray
    """ln p(scan | target) - ln p(scan | clutter alone), ``(...)``."""


def innovate(
    mean: FloatArray,
    covariance: FloatArray,
    measured: FloatArray,
    present: BoolArray,
    noise: FloatArray,
    period: FloatArray | None = None,
    expected: Expected | None = None,
) -> Innovation:
    """Compare a scan with a predicted state.

    Parameters
    ----------
    mean
        Predicted state, ``(..., n)``.
    covariance
        Its covariance, ``(..., n, n)``.
    measured
        Measurements, ``(..., k, m)``; any value where not present.
    present
        Which of them exist, ``(..., k)``.
    noise
        Covariance of the measurements, ``(..., k or 1, m, m)``.
    period
        Period of each component, ``(m,)``, infinite for none: 360 for a bearing in
        degrees. Residuals are the short way round.
    expected
        What is expected of the state; its components when not given.

    Returns
    -------
    Innovation
        Residuals, their covariance, gains and distances.

    Raises
    ------
    DataError
        A covariance of the innovation is not positive definite.
    """
    if expected is None:
        predicted = mean[..., None, ::2]
        cross = covariance[..., None, :, ::2]
        spread = covariance[..., None, ::2, ::2] + noise
    else:
        predicted = expected.measured[..., None, :]
        slope = expected.slope
        cross = (covariance @ slope.swapaxes(-1, -2))[..., None, :, :]
        spread = slope[..., None, :, :] @ cross + noise
    residual = np.where(present[..., None], measured - predicted, 0.0)
    if period is not None:
        whole = np.where(np.isfinite(period), period, 0.0)
        residual = residual - np.round(residual / period) * whole
    determinant = _determinant(spread)
    # up to two components a positive determinant and one variance are enough
    smallest = spread[..., 0, 0]
    if spread.shape[-1] > 2:
        smallest = spread.diagonal(0, -2, -1).min(axis=-1)
    if not np.minimum(determinant, smallest).min() > 0.0:
        raise DataError(
            "the covariance of an innovation is not positive definite: check the "
            "covariances of the state and of the measurements."
        )
    inverse = _inverse(spread, determinant)
    gain = cross @ inverse
    turned = cross.swapaxes(-1, -2)
    if spread.shape[-3] == 1:  # one product for all measurements
        whitened = residual @ inverse[..., 0, :, :]
        move = whitened @ turned[..., 0, :, :]
    else:
        whitened = (inverse @ residual[..., None])[..., 0]
        move = (cross @ whitened[..., None])[..., 0]
    distance2 = np.where(present, (residual * whitened).sum(axis=-1), np.inf)
    constant = (2.0 * math.pi) ** (-0.5 * spread.shape[-1])
    density = np.exp(-0.5 * distance2)
    density *= constant / np.sqrt(determinant)
    return Innovation(residual, spread, gain, distance2, determinant, move, gain @ turned, density)


def _determinant(matrix: FloatArray) -> FloatArray:
    """Return the determinant of symmetric matrices, of small ones in closed form."""
    if matrix.shape[-1] == 1:
        return matrix[..., 0, 0]
    if matrix.shape[-1] > 2:
        return np.asarray(np.linalg.det(matrix))
    first, both, second = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 1]
    determinant: FloatArray = first * second - both * both
    return determinant


def _inverse(matrix: FloatArray, determinant: FloatArray) -> FloatArray:
    """Return the inverse of symmetric matrices, of small ones in closed form."""
    if matrix.shape[-1] == 1:
        return 1.0 / matrix
    if matrix.shape[-1] > 2:
        return np.asarray(np.linalg.inv(matrix))
    adjugate: FloatArray = matrix[..., ::-1, ::-1] * _SIGNS
    adjugate /= determinant[..., None, None]
    return adjugate


def associate(
    innovation: Innovation,
    allowed: BoolArray,
    *,
    clutter_density: FloatArray | float,
    detection_probability: FloatArray | float,
    gate_probability: float,
) -> Association:
    """Weigh the hypotheses: one of the allowed measurements, or none.

    Parameters
    ----------
    innovation
        The scan against the prediction.
    allowed
        Measurements in the gate and above the threshold, ``(..., k)``.
    clutter_density
        False measurements per unit of measurement space, ``(...)``, 0 or more.
    detection_probability
        Probability that the target crossed the threshold, ``(...)``, in (0, 1].
    gate_probability
        Probability that its measurement lies in the gate, in (0, 1].

    Returns
    -------
    Association
        Probabilities that sum to one over the measurements and the miss.

    Notes
    -----
    beta_i = e_i / (b + sum e), beta_0 = b / (b + sum e), with e_i the Gaussian density of
    the innovation and b = lambda (1 - P_D P_G) / P_D (Choi et al. 2001, eqs. 9-12).
    """
    density = innovation.density * allowed
    missed = 1.0 - np.asarray(detection_probability) * gate_probability
    none = np.asarray(clutter_density) * missed / detection_probability
    total = none + density.sum(axis=-1)
    # total / lambda * P_D; without clutter a gated measurement is surely the target.
    reference = np.log(np.maximum(clutter_density, _TINY))
    if total.min() > 0.0:
        ratio = np.log(total * detection_probability) - reference
        return Association(none / total, density / total[..., None], ratio)
    certain_miss = total <= 0.0  # neither clutter nor a measurement
    divisor = np.where(certain_miss, 1.0, total)
    ratio = np.log(divisor) + np.log(detection_probability) - reference
    empty = np.log(np.maximum(missed, _TINY))
    return Association(
        np.where(certain_miss, 1.0, none / divisor), density / divisor[..., None],
        np.where(certain_miss, empty, ratio),
    )  # fmt: skip


def correct(
    mean: FloatArray, covariance: FloatArray, innovation: Innovation, association: Association
) -> tuple[FloatArray, FloatArray]:
    """Correct a predicted state by the mean over the hypotheses.

    Parameters
    ----------
    mean
        Predicted state, ``(..., n)``.
    covariance
        Its covariance, ``(..., n, n)``.
    innovation
        The scan against the prediction.
    association
        The probabilities of the hypotheses.

    Returns
    -------
    tuple of FloatArray
        State and covariance after the scan.

    Notes
    -----
    P = P_ - sum beta_i W_i S_i W_i' + sum beta_i W_i nu_i nu_i' W_i' - (W nu)(W nu)'
    (Choi et al. 2001, eqs. 14-16; there with one gain for all).
    """
    weight, moves = association.weight, innovation.move
    weighted = weight[..., None] * moves
    shift = weighted.sum(axis=-2)
    spread = weighted.swapaxes(-1, -2) @ moves
    spread -= shift[..., :, None] * shift[..., None, :]
    reduction = innovation.reduction
    if reduction.shape[-3] == 1:
        learnt = (1.0 - association.miss)[..., None, None] * reduction[..., 0, :, :]
    else:
        learnt = (weight[..., None, None] * reduction).sum(axis=-3)
    return mean + shift, covariance - learnt + spread
