"""Covariance of a fitted passage, the eliminated linear unknowns included.

**Method.** The normal matrix of the four unknowns holds the elimination already; a
linear unknown adds its own variance and the way it follows the others.

**Conventions.** The covariance is over (t0 in s, d/v in s, v in m/s, bearing in
degrees); rows and columns of what the data cannot tell are nan.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.least_squares import inverse_or_nan
from uwtrack_cli.estimation.passage_normal import Medium, Weighted, normal_equations
from uwtrack_cli.physics.passage import Passage


@dataclass(frozen=True)
class Spread:
    """Covariance of the motion and deviations of the rest frequencies (relative)."""

    covariance: FloatArray
    rest_std: FloatArray


def passage_covariance(
    theta: FloatArray, data: Weighted, medium: Medium, law: Passage
) -> Spread:
    """Return covariance and deviations at the optimum of every row.

    Parameters
    ----------
    theta
        Fitted unknowns, shape (batch, 4).
    data
        Measurements with their final weights.
    medium
        Sound speed and depth difference.
    law
        The passage at the optimum.
    """
    inner = inverse_or_nan(normal_equations(theta, data, medium).matrix)[:, :3, :3]
    bearing_size = data.bearing_weight.sum(axis=-1)
    has_bearing = bearing_size > 0
    size = np.where(has_bearing, bearing_size, 1.0)
    follow = (
        -data.turn[:, None]
        * np.einsum("bn,bnp->bp", data.bearing_weight, law.angle_d)
        / size[:, None]
    )
    full = np.full((theta.shape[0], 4, 4), np.nan)
    full[:, :3, :3] = inner
    cross = np.einsum("bpq,bq->bp", inner, follow)
    full[:, :3, 3] = full[:, 3, :3] = cross
    full[:, 3, 3] = 1 / size + (cross * follow).sum(axis=-1)
    return Spread(
        _in_units(full, theta, data, has_bearing), _rest_std(data, law, inner)
    )


def _in_units(
    full: FloatArray, theta: FloatArray, data: Weighted, has_bearing: FloatArray
) -> FloatArray:
    ones = np.ones(theta.shape[0])
    unit = np.stack(
        [
            ones,
            np.exp(theta[:, 1]),
            np.where(data.is_free[:, 2], 1.0, np.nan),
            np.where(has_bearing, np.rad2deg(1.0), np.nan),
        ],
        axis=-1,
    )
    scaled: FloatArray = full * unit[:, :, None] * unit[:, None, :]
    return scaled


def _rest_std(data: Weighted, law: Passage, inner: FloatArray) -> FloatArray:
    q = (1 + law.shift)[:, None, :]
    size = (data.shift_weight * q**2).sum(axis=-1)
    size = np.where(size > 0, size, np.nan)
    follow = (data.shift_weight * q) @ law.shift_d / size[..., None]
    variance = 1 / size + np.einsum("bkp,bpq,bkq->bk", follow, inner, follow)
    deviation: FloatArray = np.sqrt(variance)
    return deviation
