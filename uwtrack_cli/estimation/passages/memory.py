"""The slow noise of a passage's frequencies, bearings and levels.

**Method.** Each kind is condensed to one residual per instant (its lines wander
together); strength and memory of its slow part come from the restricted likelihood
with the partials of the passage as the design.

**Conventions.** One data set: the batch has one row.
"""

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.passages.blocks import Blocks
from uwtrack_cli.estimation.passages.normal import (
    Losses,
    Normal,
    Weighted,
    block_normals,
    pair_rows,
)
from uwtrack_cli.estimation.passages.slow_loss import SlowLoss, slow_loss
from uwtrack_cli.estimation.passages.slow_noise import SlowNoise, fit_slow_noise
from uwtrack_cli.estimation.passages.state import State


def slow_noises(
    theta: FloatArray, state: State, data: Weighted, blocks: Blocks
) -> tuple[tuple[SlowNoise, ...], Losses]:
    """Find the slow noise of every kind, and what it takes from the information.

    Parameters
    ----------
    theta
        Unknowns, one row.
    state
        Residuals at these unknowns.
    data
        Measurements with the weights of their white noise.
    blocks
        Measurements in fit units.
    """
    partials = np.swapaxes(pair_rows(theta, state.law, data)[0, :, 2:], -1, -2)
    model = state.bearing[0] + data.turn[0] * state.law.angle[0]
    lines, _, levels = blocks.parts
    series = (
        (state.residual[0, lines], data.shift_weight[0], -state.law.shift_d[0]),
        (data.pair[0, 0] - model, data.pair_weight[0, 0], partials[0, :, :3]),
        (state.residual[0, levels], data.pair_weight[0, 1], partials[1]),
    )
    normals = block_normals(theta, data, state.law)
    width = float(np.exp(theta[0, 1]))
    found: list[SlowNoise] = []
    losses: list[SlowLoss | None] = []
    for number, (residual, weight, design) in enumerate(series):
        mean, size = _combine(residual, weight)
        columns = np.concatenate([design, np.ones((size.size, 1))], axis=1)
        others = _others(normals, number, columns.shape[1], data.is_free[0])
        noise = fit_slow_noise(mean, size, data.time_s, columns, width, others)
        found.append(noise)
        losses.append(None if noise.is_white else slow_loss(size, data.time_s, noise))
    return tuple(found), (losses[0], losses[1], losses[2])


def _others(
    normals: list[Normal], number: int, n_columns: int, free: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Say what the other kinds tell of the unknowns, as rows of unit variance."""
    rest = [normal for k, normal in enumerate(normals) if k != number]
    matrix = np.sum([normal.matrix[0] for normal in rest], axis=0)
    gradient = np.sum([normal.gradient[0] for normal in rest], axis=0)
    keep = np.flatnonzero(free[:3])
    if matrix[3, 3] > 0:  # the floor is the levels' own unknown: eliminate it
        gradient = gradient - matrix[:, 3] * gradient[3] / matrix[3, 3]
        matrix = matrix - np.outer(matrix[:, 3], matrix[3]) / matrix[3, 3]
    matrix, gradient = matrix[np.ix_(keep, keep)], gradient[keep]
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    good = values > 1e-9 * max(float(values.max(initial=0.0)), 1e-12)
    values, vectors = values[good], vectors[:, good]
    rows = np.zeros((values.size, n_columns))
    rows[:, keep] = np.sqrt(values)[:, None] * vectors.T * scale
    # the kinds' gradients cancel at the optimum: the others' own optimum is off it;
    # designs are partials of residuals, hence the sign of the rows
    shift = -(vectors.T @ (gradient / scale)) / np.sqrt(values)
    return shift, -rows


def _combine(residual: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """One residual per instant from all rows, and its inverse variance."""
    residual, weight = np.atleast_2d(residual), np.atleast_2d(weight)
    size = weight.sum(axis=0)
    mean = (weight * residual).sum(axis=0) / np.where(size > 0, size, 1.0)
    return mean, size
