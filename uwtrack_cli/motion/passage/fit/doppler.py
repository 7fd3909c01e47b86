"""Normal equations of the frequencies, their rest frequencies eliminated.

**Method.** Rest frequencies are linear in the model, so they are projected out (Golub
and Pereyra 1973; Kaufman 1975). All lines share the law, so one product of the weights
with five functions of time gives every sum of every line at once. Coloured noise common
to the lines takes information from the combined measurement of an instant and couples
the lines.

**Conventions.** Rest frequencies are relative to the line's mean. The first axis is the
batch.

**References.** Golub and Pereyra (1973), SIAM J. Numer. Anal. 10, 413; Kaufman (1975),
BIT 15, 49.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.coloured_noise import InformationLoss
from uwtrack_cli.motion.passage.fit.source_patterns import Loss, PatternLoss
from uwtrack_cli.motion.passage.model.law import Passage


@dataclass(frozen=True)
class DopplerSums:
    """Cost, gradient and matrix of the frequencies, rest frequencies eliminated."""

    cost: FloatArray
    """Half the weighted sum of squares, shape (batch,)."""
    gradient: FloatArray
    """Its gradient, shape (batch, motion): 3 unknowns, or 4 with the depth difference."""
    matrix: FloatArray
    """Gauss-Newton matrix, shape (batch, motion, motion)."""
    rest: FloatArray
    """Eliminated rest frequencies over the line's mean, less one, shape (batch,
    lines)."""
    variance: FloatArray
    """Their variance at a known motion, shape (batch, lines)."""
    follow: FloatArray
    """By how much they fall with the motion, shape (batch, lines, motion)."""


@dataclass(frozen=True)
class LineSums:
    """What one round needs of frequencies and weights, whatever the motion."""

    factors: FloatArray
    """Weights, then weights times values, shape (batch, 2 lines, n)."""
    size: FloatArray
    """Sum of the weights, shape (batch, lines)."""
    first: FloatArray
    """Sum of weights times values, same shape."""
    second: FloatArray
    """Sum of weights times squared values, same shape."""


@dataclass(frozen=True)
class _Moments:
    """Weighted sums of products of every line.

    Of q = 1 + shift with itself, of q with e = value - shift and the partials of the
    shift, and of e and these partials among themselves.
    """

    qq: FloatArray
    """Sum of weights times q^2, shape (batch, lines)."""
    q: FloatArray
    """Sums of q times e and the partials, shape (batch, lines, 1 + motion)."""
    all: FloatArray
    """Sums of products of e and the partials, shape (batch, lines, 1 + motion,
    1 + motion)."""


def line_sums(shift: FloatArray, weight: FloatArray) -> LineSums:
    """Return what is the same for all steps of a round.

    Parameters
    ----------
    shift
        Frequencies over the line's mean, less one; shape (batch, lines, n).
    weight
        Inverse variances of the white part.
    """
    batch, lines, n = weight.shape
    factors = np.empty((batch, 2 * lines, n))
    value = factors[:, lines:]
    factors[:, :lines] = weight
    np.multiply(weight, shift, out=value)
    sums = factors.sum(axis=-1)
    square = (value * shift).sum(axis=-1)
    return LineSums(factors, sums[:, :lines], sums[:, lines:], square)


def doppler_sums(
    law: Passage, shift: FloatArray, weight: FloatArray, sums: LineSums, loss: Loss
) -> DopplerSums:
    """Return the normal equations of the frequencies alone.

    Parameters
    ----------
    law
        The passage at the times of the measurements.
    shift
        Frequencies over the line's mean, less one; shape (batch, lines, n).
    weight
        Inverse variances of the white part.
    sums
        Sums of these two.
    loss
        Information lost to coloured noise, or None.
    """
    moments = _sums(law, weight, sums)
    if loss is None:
        return _separate(moments)
    return _coupled(moments, law, shift, weight, loss)


def _sums(law: Passage, weight: FloatArray, sums: LineSums) -> _Moments:
    rows = law.rows[:, 0]
    batch, k, n = rows.shape
    lines = weight.shape[1]
    products = (rows[:, :, None] * rows[:, None]).reshape(batch, k * k, n)
    full = (weight @ np.swapaxes(products, 1, 2)).reshape(batch, lines, k, k)
    single = sums.factors @ np.swapaxes(rows, 1, 2)
    of_value = single[:, lines:]
    with_q = single[:, :lines] + full[..., 0, :]
    qq = sums.size + single[:, :lines, 0] + with_q[..., 0]
    with_e = of_value - full[..., 0, :]
    with_q[..., 0] = sums.first + of_value[..., 0] - with_q[..., 0]
    with_e[..., 0] = sums.second - of_value[..., 0] - with_e[..., 0]
    full[..., 0, :] = full[..., :, 0] = with_e
    return _Moments(np.where(qq > 0, qq, 1.0), with_q, full)


def _separate(sums: _Moments) -> DopplerSums:
    """Eliminate every line's rest frequency by itself: no noise in common."""
    shared = sums.q / sums.qq[..., None]
    rest = shared[..., 0]
    factor = np.empty_like(shared)
    factor[..., 0] = 1.0
    factor[..., 1:] = -(1 + rest)[..., None]
    left = sums.all - sums.q[..., :, None] * shared[..., None, :]
    left *= factor[..., :, None] * factor[..., None, :]
    total = left.sum(axis=1)
    return DopplerSums(
        0.5 * total[:, 0, 0],
        total[:, 1:, 0],
        total[:, 1:, 1:],
        rest,
        1 / sums.qq,
        -(factor * shared)[..., 1:],
    )


def _coupled(
    sums: _Moments,
    law: Passage,
    shift: FloatArray,
    weight: FloatArray,
    loss: InformationLoss | PatternLoss,
) -> DopplerSums:
    """Eliminate the rest frequencies together: coloured noise couples the lines."""
    total = weight.sum(axis=1)
    share = weight / np.where(total > 0, total, 1.0)[:, None, :]
    basis = share * (1 + law.shift)[:, None, :]
    mean = (share * (shift - law.shift[:, None, :])).sum(axis=1)
    lost_mean = loss.times(mean)
    inner = np.eye(basis.shape[1]) * sums.qq[:, None, :]
    inner = inner - basis @ np.swapaxes(loss.times(basis), 1, 2)
    right = sums.q[..., 0] - np.einsum("bkt,bt->bk", basis, lost_mean)
    inverse = np.linalg.inv(inner)
    rest = np.einsum("bkl,bl->bk", inverse, right)
    factor = 1 + rest
    cost = sums.all[..., 0, 0].sum(axis=-1) - (lost_mean * mean).sum(axis=-1)
    cost = 0.5 * (cost - (rest * right).sum(axis=-1))
    slope = -np.einsum("bkt,bk->bt", share, factor)[:, None, :] * np.swapaxes(law.shift_d, -1, -2)
    lost = loss.times(slope)
    left = mean - np.einsum("bkt,bk->bt", basis, rest)
    with_e, with_q = sums.all[..., 0, 1:], sums.q[..., 1:]
    gradient = -(factor[..., None] * (with_e - rest[..., None] * with_q)).sum(1)
    gradient = gradient - np.einsum("bpt,bt->bp", lost, left)
    cross = -factor[..., None] * with_q - basis @ np.swapaxes(lost, 1, 2)
    matrix = np.einsum("bk,bkpq->bpq", factor**2, sums.all[..., 1:, 1:])
    matrix = matrix - slope @ np.swapaxes(lost, 1, 2)
    follow = -np.einsum("bkl,blp->bkp", inverse, cross)
    matrix = matrix + np.einsum("bkp,bkq->bpq", cross, follow)
    variance = np.einsum("bkk->bk", inverse)
    return DopplerSums(cost, gradient, matrix, rest, variance, follow)
