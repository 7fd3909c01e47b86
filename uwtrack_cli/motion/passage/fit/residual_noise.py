"""Noise of the three kinds of measurement, judged from the residuals of a fit.

**Method.** A scale per row from neighbouring residuals, a variance common to all rows
of an instant (a shaft whose speed jitters moves all its lines together), and the
long-run excess of that common part, which decides how uncertain a sum over a passage
is. Outliers get Tukey's weights.

**Conventions.** Arrays are (batch, rows, n) with the rows of all kinds under one
another; precision is an inverse variance, zero where a value is missing.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.robust import (
    CONSTANT,
    FEWEST_VALUES,
    SHARE_CORRECTION,
    bisquare_weight,
    median_scale,
    neighbour_scale,
)
from uwtrack_cli.motion.correlation import long_run_excess
from uwtrack_cli.motion.passage.model.measurements import Blocks


@dataclass(frozen=True)
class BlockNoise:
    """Weights of one kind for the next round, and what they were made from."""

    weight: FloatArray
    """Inverse variances for the next round, shape (batch, rows, n)."""
    scale: FloatArray
    """Deviation of a row over its nominal one, shape (batch, rows)."""
    common_variance: FloatArray
    """Variance common to all rows of an instant, shape (batch,)."""
    long_run_variance: FloatArray
    """Long-run excess of the common part, shape (batch,)."""
    inflation: FloatArray
    """Variance of sums over a passage relative to that of independent noise, shape
    (batch,)."""
    cost: FloatArray
    """Negative log-likelihood of the residuals, apart from what is the same for all
    fits to the same data, shape (batch,)."""


Noises = tuple[BlockNoise, BlockNoise, BlockNoise]
"""Noise of the frequencies, the bearings and the levels."""


def block_noises(
    residual: FloatArray, blocks: Blocks, passage_s: float, correlation_time_s: float | None
) -> Noises:
    """Judge the noise of the three kinds of measurement.

    Parameters
    ----------
    residual
        Measured less modelled, shape (batch, rows, n).
    blocks
        The measurements with their nominal inverse variances.
    passage_s
        Time over which what a row wanders by itself is summed, seconds.
    correlation_time_s
        Longest correlation time of coloured noise to allow for, seconds; None treats
        the common part as independent from instant to instant, and zero leaves coloured
        noise out of the weights (for a fit that knows its covariance).
    """
    kinds = blocks.kinds
    scale = neighbour_scale(residual, blocks.weight, blocks.correlation)
    scale[..., blocks.parts[0]] *= _wander(residual, blocks, scale, passage_s)
    precision = blocks.weight / scale[..., None] ** 2
    root = np.sqrt(precision)
    deviation = residual * root
    typical = median_scale(deviation, precision)
    share = bisquare_weight(deviation / np.maximum(typical, 1.0)[..., None])
    total = kinds @ (precision * (share > 0))
    mean = kinds @ (root * deviation * share)
    mean *= SHARE_CORRECTION / np.where(total > 0, total, 1.0)
    common = long_run_excess(mean, total, blocks.time_s, None)
    slow = common
    if correlation_time_s is not None:
        slow = 0 * common
        if correlation_time_s:
            slow = long_run_excess(mean, total, blocks.time_s, correlation_time_s)
    cost = (precision > 0).sum(axis=-1) * np.log(scale)
    if common.any():
        excess = 1 + precision * (kinds.T @ common[..., None])
        cost = cost + 0.5 * np.log(excess).sum(axis=-1)
        deviation = deviation / np.sqrt(excess)
        typical = np.maximum(median_scale(deviation, precision), 1.0)
        share = bisquare_weight(deviation / typical[..., None])
    slowed = 1 + slow[..., None] * total
    weight = precision * share
    if slow.any():
        weight /= kinds.T @ slowed
    inflation = _inflation(total, slowed)
    cost = (cost + _loss(deviation)) @ kinds.T
    first, second, third = (
        BlockNoise(
            weight[:, rows], scale[:, rows], common[:, kind], slow[:, kind],
            inflation[:, kind], cost[:, kind],
        )
        for kind, rows in enumerate(blocks.parts)
    )  # fmt: skip
    return first, second, third


def _wander(
    residual: FloatArray, blocks: Blocks, scale: FloatArray, passage_s: float
) -> FloatArray:
    """Return by how much more than its neighbours tell a line scatters over a passage.

    A line that was followed through noise is smooth, and goes anywhere. One that scatters
    less from step to step than it states is believed beyond that only as far as its sums
    over a passage bear it out. It is held against the mean of the others: what all
    share is not its own, and a line alone has nothing to be held against. Returned is a
    factor on the scale of every line, shape (batch, lines), which brings it to what it
    states at most: what wanders farther is for other readings to tell.
    """
    lines = blocks.parts[0]
    scale, residual = scale[..., lines], residual[..., lines, :]
    if scale.shape[-1] < 2 or np.all(scale >= 1):
        return np.ones(scale.shape)
    precision = blocks.weight[..., lines, :] / scale[..., None] ** 2
    deviation = residual * np.sqrt(precision)
    typical = np.maximum(median_scale(deviation, precision), 1.0)[..., None]
    kept = np.where(bisquare_weight(deviation / typical) > 0, precision, 0.0)
    mean_precision = kept.sum(axis=-1) / np.maximum((kept > 0).sum(axis=-1), 1)
    # no line is believed beyond what it states before its wander is known
    variance = np.maximum(1.0 / scale**2, 1.0)
    for _ in range(2):
        weight = kept / variance[..., None]
        others = np.maximum(weight.sum(axis=-2, keepdims=True) - weight, 0.0)
        total = weight * residual
        mean = total.sum(axis=-2, keepdims=True) - total
        apart = residual - mean / np.where(others > 0, others, 1.0)
        both = kept * others / np.where(kept > 0, kept + others, 1.0)
        own = long_run_excess(apart, both, blocks.time_s, passage_s)
        variance = 1 + mean_precision * own
    factor: FloatArray = np.minimum(np.sqrt(variance), np.maximum(1.0 / scale, 1.0))
    return factor


def rough_weight(residual: FloatArray, blocks: Blocks) -> FloatArray:
    """Return weights of a rough round: one scale per row, outliers left out.

    A row of few measurements keeps its nominal scale: the residual of a single one is
    zero, whatever its noise.

    Parameters
    ----------
    residual
        Measured less modelled, shape (batch, rows, n).
    blocks
        The measurements with their nominal inverse variances.
    """
    deviation = residual * np.sqrt(blocks.weight)
    weight = np.broadcast_to(blocks.weight, residual.shape)
    is_judged = (weight > 0).sum(axis=-1) >= FEWEST_VALUES
    scale = np.where(is_judged, median_scale(deviation, weight), 1.0)
    scale = np.maximum(scale, 1e-9)[..., None]
    rough: FloatArray = blocks.weight / scale**2 * bisquare_weight(deviation / scale)
    return rough


def clip_wild(residual: FloatArray, precision: FloatArray) -> FloatArray:
    """Hold outliers at four scales, for estimates of variances.

    Parameters
    ----------
    residual
        Residuals, shape (..., n).
    precision
        Inverse variances expected; zero is missing.
    """
    deviation = residual * np.sqrt(precision)
    bound = 4 * np.maximum(median_scale(deviation, precision), 1e-9)[..., None]
    reach = bound / np.sqrt(np.where(precision > 0, precision, 1.0))
    return np.clip(residual, -reach, reach)


def _inflation(total: FloatArray, slowed: FloatArray) -> FloatArray:
    """Information lost to coloured noise: the mean factor on the variances."""
    before = total.sum(axis=-1)
    after = (total / slowed).sum(axis=-1)
    inflation: FloatArray = np.where(before > 0, before / np.maximum(after, 1e-300), 1)
    return inflation


def _loss(deviation: FloatArray) -> FloatArray:
    """Tukey's loss of the deviations of every row."""
    left = np.maximum(1 - (deviation / CONSTANT) ** 2, 0.0)
    total: FloatArray = (CONSTANT**2 / 6) * (1 - left**3).sum(axis=-1)
    return total
