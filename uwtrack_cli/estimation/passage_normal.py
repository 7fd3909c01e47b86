"""Normal equations of a passage with the linear unknowns eliminated.

**Method.** Rest frequencies, the bearing at closest approach and the level are linear
in the model, so they are projected out (Golub and Pereyra 1973; Kaufman 1975): four
unknowns remain however many lines there are. Lines share the law, so one product of
the weights with fifteen functions of time gives every sum of every line at once.

**Conventions.** Unknowns, in this order: t0 (s), ln(d/v in s), v (m/s) and the
natural logarithm of the floor relative to the level at closest approach. The first
axis is the batch.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.passage_data import Blocks
from uwtrack_cli.physics.geometry import wrap_rad
from uwtrack_cli.physics.passage import Passage, passage_law

N_UNKNOWNS = 4
FLOOR_PRIOR_DEVIATION = 4.0
"""Weak prior of ln floor about its start, so that an invisible floor is no trouble."""


@dataclass(frozen=True)
class Medium:
    """What is known: sound speed and the depth difference of sensor and source."""

    sound_speed_mps: float
    height_m: float = 0.0


@dataclass(frozen=True)
class Weighted:
    """Blocks with the weights of one round, for every row of the batch.

    ``bearing`` holds one unwrapped combined bearing per time.
    """

    time_s: FloatArray
    shift: FloatArray
    shift_weight: FloatArray
    bearing: FloatArray
    bearing_weight: FloatArray
    level: FloatArray
    level_weight: FloatArray
    floor_start: FloatArray
    turn: FloatArray
    is_free: BoolArray


@dataclass(frozen=True)
class Normal:
    """Cost and normal equations at one set of unknowns."""

    cost: FloatArray
    gradient: FloatArray
    matrix: FloatArray


def free_unknowns(blocks: Blocks, batch: int) -> BoolArray:
    """Tell which unknowns the data can say anything about.

    Parameters
    ----------
    blocks
        Measurements in fit units.
    batch
        Number of rows.
    """
    free = np.ones((batch, N_UNKNOWNS), dtype=np.bool_)
    free[:, 2] &= not blocks.shift.is_empty
    free[:, 3] &= not blocks.level.is_empty
    return free


def normal_equations(theta: FloatArray, data: Weighted, medium: Medium) -> Normal:
    """Return half the weighted square sum, its gradient and Gauss-Newton matrix.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4).
    data
        Measurements and weights.
    medium
        Sound speed and depth difference.
    """
    law = passage_law(
        data.time_s, theta[:, :3], medium.sound_speed_mps, medium.height_m
    )
    parts = [
        _doppler(law, data),
        _reduced(*_bearing_residual(law, data), data.bearing_weight),
        _reduced(*_level_residual(theta, law, data), data.level_weight),
    ]
    offset = (theta[:, 3] - data.floor_start) / FLOOR_PRIOR_DEVIATION
    cost = sum(part.cost for part in parts) + 0.5 * offset**2
    gradient = np.sum([part.gradient for part in parts], axis=0)
    matrix = np.sum([part.matrix for part in parts], axis=0)
    gradient[:, 3] += offset / FLOOR_PRIOR_DEVIATION
    matrix[:, 3, 3] += FLOOR_PRIOR_DEVIATION**-2
    free = data.is_free
    gradient = np.where(free, gradient, 0.0)
    matrix = np.where(free[:, :, None] & free[:, None, :], matrix, np.eye(N_UNKNOWNS))
    return Normal(np.asarray(cost), gradient, matrix)


def rest_shift(law: Passage, shift: FloatArray, weight: FloatArray) -> FloatArray:
    """Return f0 / mean - 1 of every line, the linear unknown of its row.

    Parameters
    ----------
    law
        The passage at the times of the measurements.
    shift
        Measured frequencies as fractions of the mean, less one.
    weight
        Inverse variances.
    """
    q = 1 + law.shift[..., None, :]
    above = (weight * q * (shift - law.shift[..., None, :])).sum(axis=-1)
    below = (weight * q**2).sum(axis=-1)
    rest: FloatArray = above / np.where(below > 0, below, 1.0)
    return rest


def _doppler(law: Passage, data: Weighted) -> Normal:
    e, q = law.shift, 1 + law.shift
    d = law.shift_d
    pairs = d[..., :, None] * d[..., None, :]
    functions = np.concatenate(
        [
            np.stack([q * q, q * e, e * e], axis=-1),
            q[..., None] * d,
            e[..., None] * d,
            pairs.reshape(*pairs.shape[:-2], 9),
        ],
        axis=-1,
    )
    sums = data.shift_weight @ functions
    weighted = data.shift_weight * data.shift
    by_value = weighted @ np.concatenate([np.stack([q, e], axis=-1), d], axis=-1)
    square = (weighted * data.shift).sum(axis=-1)
    return _eliminate(sums, by_value, square)


def _eliminate(sums: FloatArray, by_value: FloatArray, square: FloatArray) -> Normal:
    """Project every line's rest frequency out of the sums over time."""
    qq, qd = sums[..., 0], sums[..., 3:6]
    qq = np.where(qq > 0, qq, 1.0)
    qe = by_value[..., 0] - sums[..., 1]
    ee = square - 2 * by_value[..., 1] + sums[..., 2]
    ed = by_value[..., 2:5] - sums[..., 6:9]
    dd = sums[..., 9:18].reshape(*qq.shape, 3, 3)
    rest = qe / qq
    factor = (1 + rest)[..., None]
    cost = 0.5 * (ee - rest * qe).sum(axis=-1)
    gradient = -(factor * (ed - rest[..., None] * qd)).sum(axis=-2)
    projected = dd - qd[..., :, None] * qd[..., None, :] / qq[..., None, None]
    matrix = (factor[..., None] ** 2 * projected).sum(axis=-3)
    return Normal(cost, _pad(gradient, 1), _pad(matrix, 2))


def _bearing_residual(law: Passage, data: Weighted) -> tuple[FloatArray, FloatArray]:
    turn = data.turn[:, None]
    residual = data.bearing - turn * law.angle
    slope = np.zeros((*residual.shape, N_UNKNOWNS))
    slope[..., :3] = -turn[..., None] * law.angle_d
    return residual, slope


def _level_residual(
    theta: FloatArray, law: Passage, data: Weighted
) -> tuple[FloatArray, FloatArray]:
    floor = theta[:, 3:4]
    total = np.logaddexp(law.spread, floor)
    share = np.exp(law.spread - total)
    slope = np.zeros((*total.shape, N_UNKNOWNS))
    slope[..., :3] = -share[..., None] * law.spread_d
    slope[..., 3] = share - 1
    return data.level - total, slope


def _reduced(residual: FloatArray, slope: FloatArray, weight: FloatArray) -> Normal:
    """Build normal equations with a free constant projected out."""
    size = weight.sum(axis=-1, keepdims=True)
    size = np.where(size > 0, size, 1.0)
    centred = residual - (weight * residual).sum(axis=-1, keepdims=True) / size
    mean = np.einsum("bn,bnp->bp", weight, slope) / size
    centred_slope = slope - mean[:, None, :]
    scaled = weight[..., None] * centred_slope
    return Normal(
        0.5 * (weight * centred**2).sum(axis=-1),
        np.einsum("bnp,bn->bp", scaled, centred),
        np.swapaxes(scaled, 1, 2) @ centred_slope,
    )


def _pad(values: FloatArray, n_axes: int) -> FloatArray:
    """Add the row of the floor, which frequencies know nothing about."""
    width = [(0, 0)] * (values.ndim - n_axes) + [(0, 1)] * n_axes
    return np.pad(values, width)


def combine_bearings(
    bearing: FloatArray, weight: FloatArray, predicted: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Merge the sources' bearings at each time, unwrapped about a prediction.

    Parameters
    ----------
    bearing
        Bearings in radians, shape (batch, sources, n).
    weight
        Inverse variances.
    predicted
        Bearings expected, shape (batch, n).
    """
    near = wrap_rad(bearing - predicted[:, None, :])
    size = weight.sum(axis=1)
    mean = (weight * near).sum(axis=1) / np.where(size > 0, size, 1.0)
    return predicted + mean, size
