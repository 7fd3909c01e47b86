"""Residuals of a passage at trial unknowns, and the weights that follow from them.

**Conventions.** As in `passage_normal`; one row per start or data set.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.block_noise import BlockNoise, block_noise, rough_weight
from uwtrack_cli.estimation.passage_data import Blocks
from uwtrack_cli.estimation.passage_normal import (
    Losses,
    Medium,
    Weighted,
    combine_bearings,
)
from uwtrack_cli.physics.geometry import wrap_rad
from uwtrack_cli.physics.passage import Passage, passage_law

Weights = tuple[FloatArray, FloatArray, FloatArray]
"""Inverse variances of the frequencies, the bearings and the levels."""

Noises = tuple[BlockNoise, BlockNoise, BlockNoise]
"""Noise of the frequencies, the bearings and the levels."""


@dataclass(frozen=True)
class State:
    """The law, the linear unknowns and the residuals of the three kinds."""

    law: Passage
    rest: FloatArray
    bearing: FloatArray
    level: FloatArray
    residuals: Weights


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
    weights: Weights | None,
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
    weights
        Weights of the last round; None takes the nominal ones.
    """
    law = passage_law(
        blocks.time_s, theta[:, :3], medium.sound_speed_mps, medium.height_m
    )
    is_rough = weights is None
    if weights is None:
        weights = (blocks.shift.weight, blocks.bearing.weight, blocks.level.weight)
    shift = law.shift[:, None, :]
    rest = _mean_ratio(blocks.shift.value - shift, 1 + shift, weights[0])
    around = blocks.bearing.value - (fixed.turn[:, None] * law.angle)[:, None, :]
    centre = _circular_centre(around, weights[1])
    total = np.logaddexp(law.spread, theta[:, 3:4])[:, None, :]
    above = blocks.level.value - total
    level = _level_centre(above, weights[2], is_rough)
    residuals = (
        blocks.shift.value - shift - rest[..., None] * (1 + shift),
        wrap_rad(around - centre[:, None, None]),
        above - level[:, None, None],
    )
    return State(law, rest, centre, level, residuals)


def passage_noises(state: State, blocks: Blocks, memory_s: float | None) -> Noises:
    """Judge the noise of the three kinds from the residuals.

    Parameters
    ----------
    state
        Residuals.
    blocks
        Measurements with their nominal weights.
    memory_s
        See `block_noise`.
    """
    kinds = (blocks.shift, blocks.bearing, blocks.level)
    first, second, third = (
        block_noise(residual, block, blocks.time_s, memory_s)
        for residual, block in zip(state.residuals, kinds, strict=True)
    )
    return first, second, third


def rough_weights(state: State, blocks: Blocks) -> Weights:
    """Weigh the three kinds for the way to the optimum.

    Parameters
    ----------
    state
        Residuals.
    blocks
        Measurements with their nominal weights.
    """
    first, second, third = (
        rough_weight(residual, block)
        for residual, block in zip(
            state.residuals, (blocks.shift, blocks.bearing, blocks.level), strict=True
        )
    )
    return first, second, third


def weights_of(noises: Noises) -> Weights:
    """Return the weights that follow from the noise.

    Parameters
    ----------
    noises
        Noise of the three kinds.
    """
    return noises[0].weight, noises[1].weight, noises[2].weight


def weigh(
    state: State,
    weights: Weights,
    blocks: Blocks,
    fixed: Fixed,
    losses: Losses = (None, None, None),
) -> Weighted:
    """Put measurements and weights of one round together.

    Parameters
    ----------
    state
        The model at the present unknowns.
    weights
        Inverse variances of the three kinds.
    blocks
        Measurements in fit units.
    fixed
        Turn, floor and freedom.
    losses
        Information lost to slow noise.
    """
    batch = fixed.turn.size
    predicted = state.bearing[:, None] + fixed.turn[:, None] * state.law.angle
    bearing, size = combine_bearings(
        np.broadcast_to(blocks.bearing.value, weights[1].shape),
        weights[1],
        predicted,
    )
    return Weighted(
        blocks.time_s,
        np.broadcast_to(blocks.shift.value, (batch, *blocks.shift.value.shape[1:])),
        weights[0],
        bearing,
        size,
        np.broadcast_to(blocks.level.value, (batch, 1, blocks.time_s.size))[:, 0],
        weights[2][:, 0],
        fixed.floor,
        fixed.turn,
        fixed.free,
        losses,
    )


def _mean_ratio(value: FloatArray, basis: FloatArray, weight: FloatArray) -> FloatArray:
    below = (weight * basis**2).sum(axis=-1)
    ratio: FloatArray = (weight * basis * value).sum(axis=-1) / np.where(
        below > 0, below, 1.0
    )
    return ratio


def _circular_centre(angle: FloatArray, weight: FloatArray) -> FloatArray:
    """Average directions, with one Newton step to the least-squares mean."""
    vector = (weight * np.exp(1j * angle)).sum(axis=(1, 2))
    centre = np.angle(vector)
    size = np.broadcast_to(weight, angle.shape).sum(axis=(1, 2))
    near = wrap_rad(angle - centre[:, None, None])
    mean = (weight * near).sum(axis=(1, 2)) / np.where(size > 0, size, 1.0)
    turned: FloatArray = centre + mean
    return turned


def _level_centre(value: FloatArray, weight: FloatArray, is_rough: bool) -> FloatArray:
    weight = np.broadcast_to(weight, value.shape)
    size = weight.sum(axis=(1, 2))
    if is_rough and bool(np.any(size > 0)):
        middle: FloatArray = np.nanmedian(
            np.where(weight > 0, value, np.nan), axis=(1, 2)
        )
        return middle
    mean: FloatArray = (weight * value).sum(axis=(1, 2)) / np.where(size > 0, size, 1.0)
    return mean
