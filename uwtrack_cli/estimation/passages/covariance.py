"""Covariance of a fitted passage, the eliminated linear unknowns included.

**Method.** The normal matrix of the four unknowns holds the elimination already; a
linear unknown adds its own variance and the way it follows the others.

**Conventions.** The covariance is over (t0 in s, d/v in s, v in m/s, bearing in
degrees); rows and columns of what the data cannot tell are nan.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.least_squares import inverse_or_nan
from uwtrack_cli.estimation.passages.doppler import DopplerSums
from uwtrack_cli.estimation.passages.normal import JointNormal, Weighted


@dataclass(frozen=True)
class Spread:
    """Covariance of the motion and deviations of the rest frequencies (relative)."""

    covariance: FloatArray
    rest_std: FloatArray


def passage_covariance(
    theta: FloatArray, data: Weighted, normal: JointNormal
) -> Spread:
    """Return covariance and deviations at the optimum of every row.

    Parameters
    ----------
    theta
        Fitted unknowns, shape (batch, 4).
    data
        Measurements with their final weights.
    normal
        Normal equations at the optimum.
    """
    inner = inverse_or_nan(normal.matrix)[:, :3, :3]
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
    full = np.full((theta.shape[0], 4, 4), np.nan)
    full[:, :3, :3] = inner
    cross = np.einsum("bpq,bq->bp", inner, follow)
    full[:, :3, 3] = full[:, 3, :3] = cross
    full[:, 3, 3] = 1 / size + (cross * follow).sum(axis=-1)
    return Spread(
        _in_units(full, theta, data, has_bearing),
        _rest_std(data, normal.doppler, inner),
    )


def _in_units(
    full: FloatArray, theta: FloatArray, data: Weighted, has_bearing: BoolArray
) -> FloatArray:
    unit = np.ones((theta.shape[0], 4))
    unit[:, 1] = np.exp(theta[:, 1])
    unit[~data.is_free[:, 2], 2] = np.nan
    unit[:, 3] = np.where(has_bearing, np.rad2deg(1.0), np.nan)
    scaled: FloatArray = full * unit[:, :, None] * unit[:, None, :]
    sound = np.einsum("bii->bi", scaled) > 0
    return np.where(sound[:, :, None] & sound[:, None, :], scaled, np.nan)


def _rest_std(data: Weighted, doppler: DopplerSums, inner: FloatArray) -> FloatArray:
    measured = data.shift_weight.sum(axis=-1) > 0
    moved = ((doppler.follow @ inner) * doppler.follow).sum(axis=-1)
    variance: FloatArray = np.where(measured, doppler.variance + moved, np.nan)
    return np.sqrt(np.where(variance > 0, variance, np.nan))
