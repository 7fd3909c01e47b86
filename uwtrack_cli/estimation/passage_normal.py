"""Normal equations of a passage with the linear unknowns eliminated.

**Method.** Rest frequencies, the bearing at closest approach and the level are linear
in the model, so they are projected out (Golub and Pereyra 1973; Kaufman 1975): four
unknowns remain however many lines there are.

**Conventions.** Unknowns, in this order: t0 (s), ln(d/v in s), v (m/s) and the
natural logarithm of the floor relative to the level at closest approach. The first
axis is the batch.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.passage_data import Blocks
from uwtrack_cli.estimation.passage_doppler import DopplerSums, doppler_sums
from uwtrack_cli.physics.geometry import wrap_rad
from uwtrack_cli.physics.passage import Passage, passage_law

N_UNKNOWNS = 4
FLOOR_PRIOR_DEVIATION = 4.0
"""Weak prior of ln floor about its start, so that an invisible floor is no trouble."""


Losses = tuple[FloatArray | None, FloatArray | None, FloatArray | None]
"""Matrices (n, n) for frequencies, bearings and levels; None is white noise."""


@dataclass(frozen=True)
class Medium:
    """What is known: sound speed and the depth difference of sensor and source."""

    sound_speed_mps: float
    height_m: float = 0.0


@dataclass(frozen=True)
class Weighted:
    """Blocks with the weights of one round, for every row of the batch.

    ``bearing`` holds one unwrapped combined bearing per time. The losses are what slow
    noise takes from the information of an instant's frequencies, bearing and level.
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
    losses: Losses = (None, None, None)


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
    parts = block_normals(theta, data, medium)
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


def block_normals(theta: FloatArray, data: Weighted, medium: Medium) -> list[Normal]:
    """Return the normal equations of frequencies, bearings and levels apart.

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
    doppler = doppler_sums(law, data.shift, data.shift_weight, data.losses[0])
    bearing, bearing_slope = bearing_residual(law, data)
    level, level_slope = level_residual(theta, law, data)
    return [
        _with_floor(doppler),
        _reduced(bearing, bearing_slope, data.bearing_weight, data.losses[1]),
        _reduced(level, level_slope, data.level_weight, data.losses[2]),
    ]


def bearing_residual(law: Passage, data: Weighted) -> tuple[FloatArray, FloatArray]:
    """Return bearings less the model without its constant, and their partials.

    Parameters
    ----------
    law
        The passage at the times of the measurements.
    data
        Measurements and weights.
    """
    turn = data.turn[:, None]
    residual = data.bearing - turn * law.angle
    slope = np.zeros((*residual.shape, N_UNKNOWNS))
    slope[..., :3] = -turn[..., None] * law.angle_d
    return residual, slope


def level_residual(
    theta: FloatArray, law: Passage, data: Weighted
) -> tuple[FloatArray, FloatArray]:
    """Return levels less the model without its constant, and their partials.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4).
    law
        The passage at the times of the measurements.
    data
        Measurements and weights.
    """
    floor = theta[:, 3:4]
    total = np.logaddexp(law.spread, floor)
    share = np.exp(law.spread - total)
    slope = np.zeros((*total.shape, N_UNKNOWNS))
    slope[..., :3] = -share[..., None] * law.spread_d
    slope[..., 3] = share - 1
    return data.level - total, slope


def _reduced(
    residual: FloatArray,
    slope: FloatArray,
    weight: FloatArray,
    loss: FloatArray | None,
) -> Normal:
    """Build normal equations with a free constant projected out."""
    columns = np.empty((*slope.shape[:-1], slope.shape[-1] + 2))
    columns[..., 0], columns[..., 1], columns[..., 2:] = 1.0, residual, slope
    full = np.swapaxes(columns, 1, 2) @ information_times(weight, loss, columns)
    size = np.where(full[:, 0, 0] > 0, full[:, 0, 0], 1.0)
    first = full[:, 0, 1:]
    full = full[:, 1:, 1:] - first[:, :, None] * first[:, None, :] / size[:, None, None]
    return Normal(0.5 * full[:, 0, 0], full[:, 1:, 0], full[:, 1:, 1:])


def information_times(
    weight: FloatArray, loss: FloatArray | None, columns: FloatArray
) -> FloatArray:
    """Multiply columns (batch, n, p) by the information of the measurements.

    Parameters
    ----------
    weight
        Inverse variances of the white part, shape (batch, n).
    loss
        What slow noise takes away, shape (n, n), or None.
    columns
        Values to multiply.
    """
    product: FloatArray = weight[..., None] * columns
    return product if loss is None else product - loss @ columns


def _with_floor(doppler: DopplerSums) -> Normal:
    """Add the row of the floor, which frequencies know nothing about."""
    batch = doppler.cost.size
    gradient = np.zeros((batch, N_UNKNOWNS))
    matrix = np.zeros((batch, N_UNKNOWNS, N_UNKNOWNS))
    gradient[:, :3], matrix[:, :3, :3] = doppler.gradient, doppler.matrix
    return Normal(doppler.cost, gradient, matrix)


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
