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
class _Sums:
    qq: FloatArray
    qe: FloatArray
    ee: FloatArray
    qd: FloatArray
    ed: FloatArray
    dd: FloatArray


def doppler_sums(
    law: Passage, shift: FloatArray, weight: FloatArray, loss: FloatArray | None
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
    loss
        Information lost to slow noise, shape (n, n), or None.
    """
    sums = _sums(law, shift, weight)
    if loss is None:
        return _separate(sums)
    return _coupled(sums, law, shift, weight, loss)


def _sums(law: Passage, shift: FloatArray, weight: FloatArray) -> _Sums:
    columns = np.empty((*law.shift.shape, 5))
    columns[..., 0], columns[..., 1], columns[..., 2:] = 1.0, law.shift, law.shift_d
    columns = columns[:, None]
    weighted = weight[..., None] * columns
    moments = np.swapaxes(weighted, -1, -2) @ columns
    values = (shift[..., None, :] @ weighted)[..., 0, :]
    square = (weight * shift**2).sum(axis=-1)
    both = moments[..., 0, :] + moments[..., 1, :]
    qq = both[..., 0] + both[..., 1]
    return _Sums(
        np.where(qq > 0, qq, 1.0),
        values[..., 0] + values[..., 1] - both[..., 1],
        square - 2 * values[..., 1] + moments[..., 1, 1],
        both[..., 2:],
        values[..., 2:] - moments[..., 1, 2:],
        moments[..., 2:, 2:],
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
