"""Model, weights and normal equations of a passage: all three kinds together.

**Method.** The bearing at closest approach and the level are linear in the model and
projected out, as the rest frequencies are (`doppler`): four unknowns remain however
many lines there are, and those of the depth difference and of what changed.

**Conventions.** Unknowns as in `unknowns`; the rows of the three kinds are under one
another as in `Blocks`. The first axis is the batch: starts of one data set, or data sets
of a study.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.estimation.robust import median_where
from uwtrack_cli.motion.coloured_noise import InformationLoss
from uwtrack_cli.motion.passage.fit.doppler import DopplerSums, LineSums, doppler_sums, line_sums
from uwtrack_cli.motion.passage.fit.line_levels import LineLevels
from uwtrack_cli.motion.passage.fit.source_patterns import Loss
from uwtrack_cli.motion.passage.model.law import Passage
from uwtrack_cli.motion.passage.model.measurements import Blocks
from uwtrack_cli.motion.passage.model.unknowns import (
    CHANGED,
    FLOOR,
    HEIGHT,
    Change,
    law_of,
    motion_places,
)

FLOOR_PRIOR_DEVIATION = 4.0
"""Weak prior of ln floor about its start, so that an invisible floor is harmless."""

Losses = tuple[Loss, InformationLoss | None, Loss]
"""That of frequencies (patterns of the image), bearings and levels (of the source)."""

NO_LOSS: Losses = (None, None, None)


@dataclass(frozen=True)
class FitConstants:
    """What a fit does not change: turn, start of the floor, what is free, what changed."""

    turn: FloatArray
    """Sign of the bearing trend, +1 or -1, shape (batch,)."""
    floor: FloatArray
    """ln of the floor at the start, shape (batch,)."""
    free: BoolArray
    """Which unknowns the data can change, shape (batch, unknowns)."""
    change: Change | None = None
    """What changed beside the passage."""


@dataclass(frozen=True)
class WeightedData:
    """Blocks with the weights of one round, for every row of the batch."""

    time_s: FloatArray
    """Times of reception, s, shape (n,)."""
    shift: FloatArray
    """Frequencies over the line's mean, less one, shape (1 or batch, lines, n)."""
    shift_weight: FloatArray
    """Their inverse variances, shape (batch, lines, n)."""
    sums: LineSums
    """Sums of these two, the same for all steps of a round."""
    pair: FloatArray
    """One unwrapped combined bearing (rad) and the level (ln) per time, shape
    (batch, 2, n)."""
    pair_weight: FloatArray
    """Their inverse variances, same shape."""
    floor_start: FloatArray
    """ln of the floor at the start, the mean of its prior, shape (batch,)."""
    turn: FloatArray
    """Sign of the bearing trend, shape (batch,)."""
    is_free: BoolArray
    """Which unknowns the data can change, shape (batch, unknowns)."""
    losses: Losses = NO_LOSS
    """Information that coloured noise takes from frequencies, bearings and levels."""
    change: Change | None = None
    """What changed beside the passage."""
    line_levels: LineLevels | None = None
    """Levels of the lines, for a batch of one; None: they are not used."""


@dataclass(frozen=True)
class NormalEquations:
    """Cost and normal equations at one set of unknowns."""

    cost: FloatArray
    """Half the weighted sum of squares, shape (batch,)."""
    gradient: FloatArray
    """Its gradient, shape (batch, unknowns)."""
    matrix: FloatArray
    """Gauss-Newton matrix, shape (batch, unknowns, unknowns)."""


@dataclass(frozen=True)
class JointNormalEquations(NormalEquations):
    """Those of all kinds, the frequencies' own part, and the passage."""

    doppler: DopplerSums
    """The frequencies' own part."""
    law: Passage
    """The passage at these unknowns."""


@dataclass(frozen=True)
class PassageResiduals:
    """The law, the linear unknowns and the residuals of all rows."""

    law: Passage
    """The passage at the trial unknowns."""
    rest: FloatArray
    """Rest frequencies over the line's mean, less one, shape (batch, lines)."""
    bearing: FloatArray
    """Bearing at closest approach, rad, shape (batch,)."""
    level: FloatArray
    """Level at closest approach, ln of power, shape (batch,)."""
    residual: FloatArray
    """Measured less modelled, shape (batch, rows, n)."""


def passage_state(
    theta: FloatArray,
    fixed: FitConstants,
    blocks: Blocks,
    medium: Medium,
    weight: FloatArray | None,
    normal: JointNormalEquations | None = None,
) -> PassageResiduals:
    """Evaluate the model, and its linear unknowns by weighted means.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
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
    law = law_of(theta, blocks.time_s, medium, fixed.change) if normal is None else normal.law
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
    return PassageResiduals(law, rest, centre, level, residual)


def weigh(
    state: PassageResiduals,
    weight: FloatArray,
    blocks: Blocks,
    fixed: FitConstants,
    losses: Losses = NO_LOSS,
) -> WeightedData:
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
        Information lost to coloured noise.
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
    return WeightedData(
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
        fixed.change,
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


def normal_equations(
    theta: FloatArray, data: WeightedData, medium: Medium, law: Passage | None = None
) -> JointNormalEquations:
    """Return half the weighted square sum, its gradient and Gauss-Newton matrix.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    data
        Measurements and weights.
    medium
        Sound speed and depth difference.
    law
        The passage at these unknowns, if it is known already.
    """
    if law is None:
        law = law_of(theta, data.time_s, medium, data.change)
    doppler = doppler_sums(law, data.shift, data.shift_weight, data.sums, data.losses[0])
    full = _reduced(theta, law, data).sum(axis=1)
    cost = doppler.cost + 0.5 * full[:, 0, 0]
    gradient, matrix = full[:, 1:, 0], full[:, 1:, 1:]
    gradient[:, :3] += doppler.gradient[:, :3]
    matrix[:, :3, :3] += doppler.matrix[:, :3, :3]
    priors: list[tuple[int, FloatArray | float, float]] = [
        (FLOOR, data.floor_start, FLOOR_PRIOR_DEVIATION)
    ]
    if theta.shape[1] > HEIGHT:
        gradient[:, HEIGHT:] += doppler.gradient[:, 3:]
        matrix[:, HEIGHT:, HEIGHT:] += doppler.matrix[:, 3:, 3:]
        matrix[:, HEIGHT:, :3] += doppler.matrix[:, 3:, :3]
        matrix[:, :3, HEIGHT:] += doppler.matrix[:, :3, 3:]
        if medium.height_std_m:
            priors.append((HEIGHT, medium.height_m, medium.height_std_m))
    if data.change is not None:
        stds = enumerate(data.change.std, CHANGED)
        priors += [(place, 0.0, float(std)) for place, std in stds]
    for place, mean, std in priors:
        offset = (theta[:, place] - mean) / std
        cost = cost + 0.5 * offset**2
        gradient[:, place] += offset / std
        matrix[:, place, place] += std**-2
    if data.line_levels is not None:
        own = data.line_levels.normal(theta, medium, data.change)
        cost, gradient, matrix = cost + own[0], gradient + own[1], matrix + own[2]
    free = data.is_free
    if not free.all():
        both = free[:, :, None] & free[:, None, :]
        gradient = np.where(free, gradient, 0.0)
        matrix = np.where(both, matrix, np.eye(theta.shape[1]))
    return JointNormalEquations(cost, gradient, matrix, doppler, law)


def block_normals(theta: FloatArray, data: WeightedData, law: Passage) -> list[NormalEquations]:
    """Return the normal equations of frequencies, bearings and levels apart.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    data
        Measurements and weights.
    law
        The passage at these unknowns.
    """
    doppler = doppler_sums(law, data.shift, data.shift_weight, data.sums, data.losses[0])
    places = motion_places(theta)
    gradient = np.zeros(theta.shape)
    gradient[:, places] = doppler.gradient
    matrix = np.zeros((*theta.shape, theta.shape[1]))
    matrix[:, np.array(places)[:, None], places] = doppler.matrix
    first = NormalEquations(doppler.cost, gradient, matrix)
    full = _reduced(theta, law, data)
    others = [
        NormalEquations(0.5 * full[:, k, 0, 0], full[:, k, 1:, 0], full[:, k, 1:, 1:])
        for k in range(2)
    ]
    return [first, *others]


def pair_rows(theta: FloatArray, law: Passage, data: WeightedData) -> FloatArray:
    """Return a one, the residual but for its constant, and its partials.

    Shape (batch, 2, 2 + unknowns, n), for the bearings and the levels.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    law
        The passage at the times of the measurements.
    data
        Measurements and weights.
    """
    turn = data.turn[:, None]
    floor = theta[:, 3:4]
    total = np.logaddexp(law.spread, floor)
    share = np.exp(law.spread - total)
    rows = np.empty((*data.pair.shape[:2], 2 + theta.shape[1], data.pair.shape[-1]))
    rows[:, :, 0] = 1.0
    rows[:, 0, 1] = data.pair[:, 0] - turn * law.angle
    rows[:, 1, 1] = data.pair[:, 1] - total
    np.multiply(law.rows[:, 1, 1:4], -turn[..., None], out=rows[:, 0, 2:5])
    np.multiply(law.rows[:, 2, 1:4], -share[:, None], out=rows[:, 1, 2:5])
    rows[:, 0, 2 + FLOOR] = 0.0
    rows[:, 1, 2 + FLOOR] = share - 1
    if theta.shape[1] > HEIGHT:
        others = slice(2 + HEIGHT, None)
        np.multiply(law.rows[:, 1, 4:], -turn[..., None], out=rows[:, 0, others])
        np.multiply(law.rows[:, 2, 4:], -share[:, None], out=rows[:, 1, others])
    return rows


def _reduced(theta: FloatArray, law: Passage, data: WeightedData) -> FloatArray:
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
