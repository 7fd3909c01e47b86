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
from uwtrack_cli.estimation.passages.blocks import Blocks
from uwtrack_cli.estimation.passages.doppler import (
    DopplerSums,
    LineSums,
    doppler_sums,
)
from uwtrack_cli.estimation.passages.slow_loss import SlowLoss
from uwtrack_cli.physics.passage import Passage, passage_law

N_UNKNOWNS = 4
FLOOR_PRIOR_DEVIATION = 4.0
"""Weak prior of ln floor about its start, so that an invisible floor is no trouble."""


Losses = tuple[SlowLoss | None, SlowLoss | None, SlowLoss | None]
"""What slow noise takes from frequencies, bearings and levels; None is white noise."""

NO_LOSS: Losses = (None, None, None)


@dataclass(frozen=True)
class Medium:
    """What is known: sound speed and the depth difference of sensor and source."""

    sound_speed_mps: float
    height_m: float = 0.0


@dataclass(frozen=True)
class Weighted:
    """Blocks with the weights of one round, for every row of the batch.

    ``pair`` (batch, 2, n) holds one unwrapped combined bearing and the level per time;
    ``sums`` what the frequencies need once per round. The losses are what slow noise
    takes from the information of an instant's frequencies, bearing and level.
    """

    time_s: FloatArray
    shift: FloatArray
    shift_weight: FloatArray
    sums: LineSums
    pair: FloatArray
    pair_weight: FloatArray
    floor_start: FloatArray
    turn: FloatArray
    is_free: BoolArray
    losses: Losses = NO_LOSS


@dataclass(frozen=True)
class Normal:
    """Cost and normal equations at one set of unknowns."""

    cost: FloatArray
    gradient: FloatArray
    matrix: FloatArray


@dataclass(frozen=True)
class JointNormal(Normal):
    """Those of all kinds, the frequencies' own part, and the passage."""

    doppler: DopplerSums
    law: Passage


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


def law_of(theta: FloatArray, time_s: FloatArray, medium: Medium) -> Passage:
    """Evaluate the passage of every row.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4).
    time_s
        Times in seconds.
    medium
        Sound speed and depth difference.
    """
    c, height = medium.sound_speed_mps, medium.height_m
    if theta.shape[0] == 1:
        return Passage(passage_law(time_s, theta[0], c, height).rows[None])
    return passage_law(time_s, theta, c, height)


def normal_equations(
    theta: FloatArray, data: Weighted, medium: Medium, law: Passage | None = None
) -> JointNormal:
    """Return half the weighted square sum, its gradient and Gauss-Newton matrix.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4).
    data
        Measurements and weights.
    medium
        Sound speed and depth difference.
    law
        The passage at these unknowns, if it is known already.
    """
    if law is None:
        law = law_of(theta, data.time_s, medium)
    doppler = doppler_sums(
        law, data.shift, data.shift_weight, data.sums, data.losses[0]
    )
    full = _reduced(theta, law, data).sum(axis=1)
    offset = (theta[:, 3] - data.floor_start) / FLOOR_PRIOR_DEVIATION
    cost = doppler.cost + 0.5 * (full[:, 0, 0] + offset**2)
    gradient, matrix = full[:, 1:, 0], full[:, 1:, 1:]
    gradient[:, :3] += doppler.gradient
    matrix[:, :3, :3] += doppler.matrix
    gradient[:, 3] += offset / FLOOR_PRIOR_DEVIATION
    matrix[:, 3, 3] += FLOOR_PRIOR_DEVIATION**-2
    free = data.is_free
    if not free.all():
        both = free[:, :, None] & free[:, None, :]
        gradient = np.where(free, gradient, 0.0)
        matrix = np.where(both, matrix, np.eye(N_UNKNOWNS))
    return JointNormal(cost, gradient, matrix, doppler, law)


def block_normals(theta: FloatArray, data: Weighted, law: Passage) -> list[Normal]:
    """Return the normal equations of frequencies, bearings and levels apart.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4).
    data
        Measurements and weights.
    law
        The passage at these unknowns.
    """
    doppler = doppler_sums(
        law, data.shift, data.shift_weight, data.sums, data.losses[0]
    )
    wide = ((0, 0), (0, 1))
    first = Normal(
        doppler.cost,
        np.pad(doppler.gradient, wide),
        np.pad(doppler.matrix, (*wide, (0, 1))),
    )
    full = _reduced(theta, law, data)
    others = [
        Normal(0.5 * full[:, k, 0, 0], full[:, k, 1:, 0], full[:, k, 1:, 1:])
        for k in range(2)
    ]
    return [first, *others]


def pair_rows(theta: FloatArray, law: Passage, data: Weighted) -> FloatArray:
    """Return a one, the residual but for its constant, and its partials.

    Shape (batch, 2, 6, n), for the bearings and the levels.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4).
    law
        The passage at the times of the measurements.
    data
        Measurements and weights.
    """
    turn = data.turn[:, None]
    floor = theta[:, 3:4]
    total = np.logaddexp(law.spread, floor)
    share = np.exp(law.spread - total)
    rows = np.empty((*data.pair.shape[:2], 2 + N_UNKNOWNS, data.pair.shape[-1]))
    rows[:, :, 0] = 1.0
    rows[:, 0, 1] = data.pair[:, 0] - turn * law.angle
    rows[:, 1, 1] = data.pair[:, 1] - total
    np.multiply(law.rows[:, 1, 1:], -turn[..., None], out=rows[:, 0, 2:5])
    np.multiply(law.rows[:, 2, 1:], -share[:, None], out=rows[:, 1, 2:5])
    rows[:, 0, 5] = 0.0
    rows[:, 1, 5] = share - 1
    return rows


def _reduced(theta: FloatArray, law: Passage, data: Weighted) -> FloatArray:
    """Sum products of residual and partials, the constants projected out."""
    rows = pair_rows(theta, law, data)
    weighted = data.pair_weight[:, :, None] * rows
    for kind, loss in enumerate(data.losses[1:]):
        if loss is not None:
            weighted[:, kind] -= loss.times(rows[:, kind])
    full = weighted @ np.swapaxes(rows, -1, -2)
    first = full[..., 0, :]
    size = np.where(first[..., 0] > 0, first[..., 0], 1.0)[..., None]
    out: FloatArray = full - first[..., :, None] * (first / size)[..., None, :]
    return out[..., 1:, 1:]
