"""The frequencies' share of a passage's normal equations.

**Method.** Each line's rest frequency is linear and is projected out (Golub and
Pereyra 1973; Kaufman 1975). All lines share the law, so one product of the weights
with five functions of time gives every sum of every line at once. Slow noise
common to the lines takes information away: ``loss`` is what an instant's combined
measurement loses (diagonal of its weights less the inverse covariance).

**Conventions.** Unknowns (t0, ln r, v); rest frequencies relative to the line's mean.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.physics.passage import Passage


@dataclass(frozen=True)
class DopplerSums:
    """Cost, gradient and matrix, and the eliminated rest frequencies.

    ``inverse`` is the covariance of the rest frequencies at a known motion, and
    ``follow`` how they follow the motion.
    """

    cost: FloatArray
    gradient: FloatArray
    matrix: FloatArray
    rest: FloatArray
    inverse: FloatArray
    follow: FloatArray


@dataclass(frozen=True)
class LineSums:
    """What one round needs of frequencies and weights, whatever the motion.

    ``factors`` (batch, 2 lines, n) holds the weights and then weights times values.
    """

    factors: FloatArray
    size: FloatArray
    first: FloatArray
    second: FloatArray


@dataclass(frozen=True)
class _Sums:
    qq: FloatArray
    qe: FloatArray
    ee: FloatArray
    qd: FloatArray
    ed: FloatArray
    dd: FloatArray


def line_sums(shift: FloatArray, weight: FloatArray) -> LineSums:
    """Return what is the same for all steps of a round.

    Parameters
    ----------
    shift
        Frequencies over the line's mean, less one; shape (batch, lines, n).
    weight
        Inverse variances of the white part.
    """
    value = weight * shift
    return LineSums(
        np.concatenate([weight, value], axis=1),
        weight.sum(axis=-1),
        value.sum(axis=-1),
        (value * shift).sum(axis=-1),
    )


def doppler_sums(
    law: Passage,
    shift: FloatArray,
    weight: FloatArray,
    sums: LineSums,
    loss: FloatArray | None,
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
        Information lost to slow noise, shape (n, n), or None.
    """
    moments = _sums(law, weight, sums)
    if loss is None:
        return _separate(moments)
    return _coupled(moments, law, shift, weight, loss)


def _sums(law: Passage, weight: FloatArray, sums: LineSums) -> _Sums:
    rows = law.rows[:, 0]
    batch, _, n = rows.shape
    lines = weight.shape[1]
    products = (rows[:, :, None] * rows[:, None]).reshape(batch, 16, n)
    square = (weight @ np.swapaxes(products, 1, 2)).reshape(batch, lines, 4, 4)
    single = sums.factors @ np.swapaxes(rows, 1, 2)
    of_weight, of_value = single[:, :lines], single[:, lines:]
    twice = of_weight + square[..., 0, :]
    qq = sums.size + of_weight[..., 0] + twice[..., 0]
    return _Sums(
        np.where(qq > 0, qq, 1.0),
        sums.first + of_value[..., 0] - twice[..., 0],
        sums.second - 2 * of_value[..., 0] + square[..., 0, 0],
        twice[..., 1:],
        of_value[..., 1:] - square[..., 0, 1:],
        square[..., 1:, 1:],
    )


def _separate(sums: _Sums) -> DopplerSums:
    """Eliminate every line's rest frequency by itself: no noise in common."""
    rest = sums.qe / sums.qq
    factor = (1 + rest)[..., None]
    projected = (
        sums.dd
        - sums.qd[..., :, None] * sums.qd[..., None, :] / sums.qq[..., None, None]
    )
    return DopplerSums(
        0.5 * (sums.ee - rest * sums.qe).sum(axis=-1),
        -(factor * (sums.ed - rest[..., None] * sums.qd)).sum(axis=-2),
        (factor[..., None] ** 2 * projected).sum(axis=-3),
        rest,
        np.eye(rest.shape[-1]) / sums.qq[..., None],
        factor * sums.qd / sums.qq[..., None],
    )


def _coupled(
    sums: _Sums, law: Passage, shift: FloatArray, weight: FloatArray, loss: FloatArray
) -> DopplerSums:
    """Eliminate the rest frequencies together: slow noise couples the lines."""
    total = weight.sum(axis=1)
    share = weight / np.where(total > 0, total, 1.0)[:, None, :]
    basis = np.swapaxes(share * (1 + law.shift)[:, None, :], 1, 2)
    mean = (share * (shift - law.shift[:, None, :])).sum(axis=1)
    inner = np.eye(basis.shape[2]) * sums.qq[:, None, :]
    inner = inner - np.swapaxes(basis, 1, 2) @ (loss @ basis)
    right = sums.qe - np.einsum("btk,bt->bk", basis, mean @ loss)
    inverse = np.linalg.inv(inner)
    rest = np.einsum("bkl,bl->bk", inverse, right)
    factor = 1 + rest
    cost = sums.ee.sum(axis=-1) - np.einsum("bt,bt->b", mean @ loss, mean)
    cost = 0.5 * (cost - (rest * right).sum(axis=-1))
    slope = -law.shift_d * np.einsum("bkt,bk->bt", share, factor)[..., None]
    lost = loss @ slope
    left = mean - np.einsum("btk,bk->bt", basis, rest)
    gradient = -(factor[..., None] * (sums.ed - rest[..., None] * sums.qd)).sum(1)
    gradient = gradient - np.einsum("btp,bt->bp", lost, left)
    cross = -factor[..., None] * sums.qd - np.einsum("btk,btp->bkp", basis, lost)
    matrix = np.einsum("bk,bkpq->bpq", factor**2, sums.dd)
    matrix = matrix - np.swapaxes(slope, 1, 2) @ lost
    follow = -np.einsum("bkl,blp->bkp", inverse, cross)
    matrix = matrix + np.einsum("bkp,bkq->bpq", cross, follow)
    return DopplerSums(cost, gradient, matrix, rest, inverse, follow)
