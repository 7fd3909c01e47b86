"""Residuals of a passage at trial unknowns, and the weights that follow from them.

**Conventions.** As in `normal`; one row of the batch per start or data set, and
the rows of the three kinds under one another as in `Blocks`.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.passages.blocks import Blocks
from uwtrack_cli.estimation.passages.doppler import line_sums
from uwtrack_cli.estimation.passages.normal import (
    NO_LOSS,
    JointNormal,
    Losses,
    Medium,
    Weighted,
    law_of,
)
from uwtrack_cli.estimation.robust import median_where
from uwtrack_cli.physics.geometry import wrap_rad
from uwtrack_cli.physics.passage import Passage


@dataclass(frozen=True)
class State:
    """The law, the linear unknowns and the residuals of all rows."""

    law: Passage
    rest: FloatArray
    bearing: FloatArray
    level: FloatArray
    residual: FloatArray


@dataclass(frozen=True)
class Fixed:
    """What a fit does not change: turn, start of the floor, which unknowns are free."""

    turn: FloatArray
    floor: FloatArray
    free: BoolArray


def passage_state(
    theta: FloatArray,
    fixed: Fixed,
    blocks: Blocks,
    medium: Medium,
    weight: FloatArray | None,
    normal: JointNormal | None = None,
) -> State:
    """Evaluate the model, and its linear unknowns by weighted means.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4).
    fixed
        Turn of every row.
    blocks
        Measurements in fit units.
    medium
        Sound speed and depth difference.
    weight
        Weights of the last round; None takes the nominal ones.
    normal
        What was evaluated at these unknowns already, if anything.
    """
    law = law_of(theta, blocks.time_s, medium) if normal is None else normal.law
    is_rough = weight is None
    if weight is None:
        weight = blocks.weight
    lines, bearings, levels = blocks.parts
    residual = np.empty((theta.shape[0], *blocks.value.shape[1:]))
    of_line, basis = residual[:, lines], 1 + law.shift
    np.subtract(blocks.value[:, lines], law.shift[:, None], out=of_line)
    rest = _mean_ratio(of_line, basis, weight[:, lines])
    of_line -= rest[..., None] * basis[:, None]
    angle = fixed.turn[:, None] * law.angle
    around = blocks.value[:, bearings] - angle[:, None]
    centre = _circular_centre(around, weight[:, bearings])
    residual[:, bearings] = wrap_rad(around - centre[:, None, None])
    total = np.logaddexp(law.spread, theta[:, 3:4])
    above = blocks.value[:, levels] - total[:, None]
    level = _level_centre(above, weight[:, levels], is_rough)
    np.subtract(above, level[:, None, None], out=residual[:, levels])
    return State(law, rest, centre, level, residual)


def weigh(
    state: State,
    weight: FloatArray,
    blocks: Blocks,
    fixed: Fixed,
    losses: Losses = NO_LOSS,
) -> Weighted:
    """Put measurements and weights of one round together.

    Parameters
    ----------
    state
        The model at the present unknowns.
    weight
        Inverse variances of all rows.
    blocks
        Measurements in fit units.
    fixed
        Turn, floor and freedom.
    losses
        Information lost to slow noise.
    """
    lines, bearings, levels = blocks.parts
    size = weight[:, bearings].sum(axis=1)
    near = (weight[:, bearings] * state.residual[:, bearings]).sum(axis=1)
    angle = fixed.turn[:, None] * state.law.angle
    pair = np.empty((fixed.turn.size, 2, blocks.time_s.size))
    pair[:, 0] = state.bearing[:, None] + angle + near / np.where(size > 0, size, 1.0)
    pair[:, 1] = blocks.value[:, levels][:, 0]
    pair_weight = np.empty_like(pair)
    pair_weight[:, 0] = size
    pair_weight[:, 1] = weight[:, levels][:, 0]
    return Weighted(
        blocks.time_s,
        blocks.value[:, lines],
        weight[:, lines],
        line_sums(blocks.value[:, lines], weight[:, lines]),
        pair,
        pair_weight,
        fixed.floor,
        fixed.turn,
        fixed.free,
        losses,
    )


def _mean_ratio(value: FloatArray, basis: FloatArray, weight: FloatArray) -> FloatArray:
    """Fit value = ratio * basis (one basis for all rows) by weighted least squares."""
    below = (weight @ (basis**2)[..., None])[..., 0]
    above = ((weight * value) @ basis[..., None])[..., 0]
    ratio: FloatArray = above / np.where(below > 0, below, 1.0)
    return ratio


def _circular_centre(angle: FloatArray, weight: FloatArray) -> FloatArray:
    """Average directions, with one Newton step to the least-squares mean."""
    east = (weight * np.sin(angle)).sum(axis=(1, 2))
    north = (weight * np.cos(angle)).sum(axis=(1, 2))
    centre = np.arctan2(east, north)
    size = weight.sum(axis=(1, 2))
    near = wrap_rad(angle - centre[:, None, None])
    mean = (weight * near).sum(axis=(1, 2)) / np.where(size > 0, size, 1.0)
    turned: FloatArray = centre + mean
    return turned


def _level_centre(value: FloatArray, weight: FloatArray, is_rough: bool) -> FloatArray:
    if is_rough:
        flat = value.reshape(value.shape[0], -1)
        known = np.broadcast_to(weight, value.shape).reshape(flat.shape)
        middle = median_where(flat, known)
        return np.where(np.isfinite(middle), middle, 0.0)
    size = weight.sum(axis=(1, 2))
    mean: FloatArray = (weight * value).sum(axis=(1, 2)) / np.where(size > 0, size, 1.0)
    return mean
