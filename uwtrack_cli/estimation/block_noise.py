"""How noisy one kind of measurement is, judged from the residuals of a fit.

**Method.** Three parts: a scale per row from neighbouring residuals, a variance common
to all rows of an instant (a shaft that wanders moves all its lines together), and the
long-run excess of that common part, which decides how uncertain a sum over a passage
is. Wild values get Tukey's weights.

**Conventions.** Arrays are (batch, rows, n); precision is an inverse variance.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.correlation import long_run_excess
from uwtrack_cli.estimation.passage_data import Block
from uwtrack_cli.estimation.robust import (
    CONSTANT,
    bisquare_weight,
    median_scale,
    neighbour_scale,
)


@dataclass(frozen=True)
class BlockNoise:
    """Weights for the next round, and what they were made from.

    ``cost`` is the negative log-likelihood of the residuals, apart from constants.
    ``inflation`` is the variance of sums over a passage relative to that of
    independent noise.
    """

    weight: FloatArray
    scale: FloatArray
    common_variance: FloatArray
    long_run_variance: FloatArray
    inflation: FloatArray
    cost: FloatArray


def block_noise(
    residual: FloatArray,
    block: Block,
    time_s: FloatArray,
    memory_s: float | None,
) -> BlockNoise:
    """Judge the noise of one kind of measurement.

    Parameters
    ----------
    residual
        Measured less modelled, shape (batch, rows, n).
    block
        The measurements with their nominal inverse variances.
    time_s
        Times in seconds.
    memory_s
        Longest memory of slow noise to allow for, seconds; None treats the common
        part as independent from instant to instant, and zero leaves slow noise out
        of the weights (for a fit that knows its covariance).
    """
    nominal = np.broadcast_to(block.weight, residual.shape)
    scale = neighbour_scale(residual, nominal, block.correlation)
    precision = nominal / scale[..., None] ** 2
    clipped = clip_wild(residual, precision)
    total = precision.sum(axis=1)
    mean = (precision * clipped).sum(axis=1) / np.where(total > 0, total, 1.0)
    common = long_run_excess(mean, total, time_s, None)
    slow = common
    if memory_s is not None:
        slow = (
            long_run_excess(mean, total, time_s, memory_s) if memory_s else 0 * common
        )
    deviation, variance = _deviation(residual, precision, common)
    typical = np.maximum(median_scale(deviation, precision), 1.0)
    share = bisquare_weight(deviation / typical[..., None])
    slowed = 1 + slow[:, None] * total
    weight = precision * share / slowed[:, None, :]
    return BlockNoise(
        weight, scale, common, slow,
        _inflation(total, slowed), _cost(deviation, variance, precision),
    )  # fmt: skip


def rough_weight(residual: FloatArray, block: Block) -> FloatArray:
    """Return weights for the way to the optimum: one scale per row, wild ones out.

    Parameters
    ----------
    residual
        Measured less modelled, shape (batch, rows, n).
    block
        The measurements with their nominal inverse variances.
    """
    if block.is_empty:
        return np.zeros(residual.shape)
    deviation = residual * np.sqrt(block.weight)
    weight = np.broadcast_to(block.weight, residual.shape)
    square = np.maximum(median_scale(deviation, weight), 1e-9)[..., None] ** 2
    share = np.maximum(1 - deviation**2 / (CONSTANT**2 * square), 0.0)
    rough: FloatArray = weight * share**2 / square
    return rough


def clip_wild(residual: FloatArray, precision: FloatArray) -> FloatArray:
    """Hold wild values at four scales, for estimates of variances.

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


def _deviation(
    residual: FloatArray, precision: FloatArray, common: FloatArray
) -> tuple[FloatArray, FloatArray]:
    known = precision > 0
    variance = 1 / np.where(known, precision, 1.0) + common[:, None, None]
    return np.where(known, residual, 0.0) / np.sqrt(variance), variance


def _inflation(total: FloatArray, slowed: FloatArray) -> FloatArray:
    """Information lost to slow noise: the mean factor on the variances."""
    before = total.sum(axis=-1)
    after = (total / slowed).sum(axis=-1)
    inflation: FloatArray = np.where(before > 0, before / np.maximum(after, 1e-300), 1)
    return inflation


def _cost(
    deviation: FloatArray, variance: FloatArray, precision: FloatArray
) -> FloatArray:
    share = np.minimum((deviation / CONSTANT) ** 2, 1.0)
    loss = CONSTANT**2 / 6 * (1 - (1 - share) ** 3)
    each = np.where(precision > 0, loss + 0.5 * np.log(variance), 0.0)
    total: FloatArray = each.sum(axis=(1, 2))
    return total
