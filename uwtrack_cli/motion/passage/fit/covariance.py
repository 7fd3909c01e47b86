"""Covariance of a passage from the normal equations at its optimum.

**Method.** The inverse of the Gauss-Newton matrix; an unknown that was eliminated has
its own variance and follows the others.

**Conventions.** Rows and columns that the data do not determine are nan. The first axis
is the batch.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.least_squares import inverse_or_nan
from uwtrack_cli.motion.passage.fit.doppler import DopplerSums
from uwtrack_cli.motion.passage.fit.normal_equations import JointNormalEquations, WeightedData
from uwtrack_cli.motion.passage.model.law import bounded_speed, slant_over_speed_s
from uwtrack_cli.motion.passage.model.unknowns import heights_m, motion_places


@dataclass(frozen=True)
class PassageCovariance:
    """Covariance of the motion and deviations of the rest frequencies (relative)."""

    full: FloatArray
    """Of t0 (s), horizontal range over speed (s), v (m/s), bearing (degrees), depth
    difference (m) and what changed, shape (batch, 5 or more, same); a known depth
    difference has zeros."""
    slant: FloatArray
    """Of t0 (s), slant range over speed (s), v (m/s) and bearing (degrees), shape
    (batch, 4, 4)."""
    rest_std: FloatArray
    """Relative deviation of the rest frequencies, shape (batch, lines)."""


def passage_covariance(
    theta: FloatArray, data: WeightedData, normal: JointNormalEquations, medium: Medium
) -> PassageCovariance:
    """Return covariance and deviations at the optimum of every row.

    Parameters
    ----------
    theta
        Fitted unknowns, shape (batch, 4 or more).
    data
        Measurements with their final weights.
    normal
        Normal equations at the optimum.
    medium
        Sound speed and depth difference.
    """
    places = np.array(motion_places(theta))
    inner = inverse_or_nan(normal.matrix)[:, places[:, None], places]
    constant = data.pair_weight[:, 0]
    if data.losses[1] is not None:
        constant = constant - data.losses[1].times(np.ones_like(constant))
    bearing_size = constant.sum(axis=-1)
    has_bearing = bearing_size > 0
    size = np.where(has_bearing, bearing_size, 1.0)
    follow = (
        data.turn[:, None]
        * -(normal.law.rows[:, 1, 1:] @ constant[..., None])[..., 0]
        / size[:, None]
    )
    count = max(theta.shape[1], 5)
    full = np.zeros((theta.shape[0], count, count))
    to = np.array([0, 1, 2, *range(4, count)][: places.size])
    full[:, to[:, None], to] = inner
    cross = np.einsum("bpq,bq->bp", inner, follow)
    full[:, to, 3] = full[:, 3, to] = cross
    full[:, 3, 3] = 1 / size + (cross * follow).sum(axis=-1)
    unit = np.ones((theta.shape[0], count))
    unit[:, 1] = np.exp(theta[:, 1])
    unit[:, 3] = np.rad2deg(1.0)
    full *= unit[:, :, None] * unit[:, None, :]
    known = np.ones((theta.shape[0], count), np.bool_)
    known[:, 2] = data.is_free[:, 2]
    known[:, 3] = has_bearing
    turn = slant_partials(theta, medium)
    return PassageCovariance(
        _or_nan(full, known),
        _or_nan(turn @ full[:, :5, :5] @ np.swapaxes(turn, 1, 2), known[:, :4]),
        _rest_std(data, normal.doppler, inner),
    )


def slant_partials(theta: FloatArray, medium: Medium) -> FloatArray:
    """Differentiate (t0, slant over speed, v, bearing) by the horizontal unknowns.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    medium
        Sound speed and depth difference.

    Returns
    -------
    FloatArray
        Shape (batch, 4, 5); the last unknown is the depth difference.
    """
    height = heights_m(theta, medium)
    slant = slant_over_speed_s(np.exp(theta[:, 1]), theta[:, 2], height)
    speed, slope = bounded_speed(theta[:, 2])
    turn = np.zeros((theta.shape[0], 4, 5))
    turn[:, range(4), range(4)] = 1.0
    turn[:, 1, 1] = np.exp(theta[:, 1]) / slant
    turn[:, 1, 2] = -(height**2) / (speed**3 * slant) * slope
    turn[:, 1, 4] = height / (speed**2 * slant)
    return turn


def _or_nan(covariance: FloatArray, known: BoolArray) -> FloatArray:
    """Put nan where a quantity is not known, or its variance is not positive."""
    sound = (np.einsum("bii->bi", covariance) >= 0) & known
    return np.where(sound[:, :, None] & sound[:, None, :], covariance, np.nan)


def _rest_std(data: WeightedData, doppler: DopplerSums, inner: FloatArray) -> FloatArray:
    measured = data.shift_weight.sum(axis=-1) > 0
    moved = ((doppler.follow @ inner) * doppler.follow).sum(axis=-1)
    variance: FloatArray = np.where(measured, doppler.variance + moved, np.nan)
    return np.sqrt(np.where(variance > 0, variance, np.nan))
