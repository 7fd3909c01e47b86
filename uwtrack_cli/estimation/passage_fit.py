"""Joint maximum likelihood of a passage from all that a contact offers.

**Method.** Rounds of Levenberg-Marquardt steps with fixed weights, and of weights
from the residuals: a robust loss, scales from the data, and the long-run variance of
noise with a memory. All rows of the batch go at once, be they starts of one data set
or data sets of a study.

**Conventions.** As in `passage_normal`; the covariance that leaves this module is
over (t0 in s, d/v in s, v in m/s, bearing in degrees).

**References.** papers: Choi et al. (2014), eqs. 4-6 with free rest frequency, level
and floor; Nielsen, Madsen and Tingleff (2004) for the damping.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.estimation.block_noise import BlockNoise, block_noise
from uwtrack_cli.estimation.least_squares import Evaluation, damped_least_squares
from uwtrack_cli.estimation.passage_covariance import passage_covariance
from uwtrack_cli.estimation.passage_data import NEPER_DB, Blocks
from uwtrack_cli.estimation.passage_normal import (
    Medium,
    Weighted,
    combine_bearings,
    free_unknowns,
    normal_equations,
    rest_shift,
)
from uwtrack_cli.physics.geometry import wrap_rad
from uwtrack_cli.physics.passage import Passage, passage_law

MEMORY_IN_PASSAGES = 1.5
"""Bartlett's window in units of d/v: 60 s where d/v is 40 s."""


@dataclass(frozen=True)
class PassageFit:
    """Result of a fit, one row per start or data set; see `passage_normal`."""

    theta: FloatArray
    turn: FloatArray
    bearing_deg: FloatArray
    rest_hz: FloatArray
    rest_std_hz: FloatArray
    level_db: FloatArray
    covariance: FloatArray
    cost: FloatArray
    frequency_noise: BlockNoise
    bearing_noise: BlockNoise
    level_noise: BlockNoise

    @property
    def range_over_speed_s(self) -> FloatArray:
        """Slant range over speed, s."""
        return np.exp(self.theta[:, 1])


@dataclass(frozen=True)
class _State:
    law: Passage
    bearing: FloatArray
    residuals: tuple[FloatArray, FloatArray, FloatArray]
    rest: FloatArray
    level: FloatArray


def fit_passage(
    blocks: Blocks,
    start: FloatArray,
    turn: FloatArray,
    medium: Medium,
    *,
    rounds: int = 4,
    is_slow_noise: bool = True,
) -> PassageFit:
    """Fit a straight passage to every row of a batch.

    Parameters
    ----------
    blocks
        Measurements in fit units; one row serves all starts.
    start
        Unknowns to start from, shape (batch, 4).
    turn
        Sign of the bearing trend of every row, +1 or -1.
    medium
        Sound speed and depth difference.
    rounds
        Rounds of weights.
    is_slow_noise
        Whether noise with a memory is looked for.
    """
    theta = start
    free = free_unknowns(blocks, start.shape[0])
    floor = start[:, 3]
    for number in range(rounds):
        memory = _memory(theta, blocks) if is_slow_noise and number > 0 else None
        state = _state(theta, turn, blocks, medium, None)
        noises = _noises(state, blocks, memory)
        data = _weigh(state, noises, blocks, (turn, floor, free))
        theta = damped_least_squares(
            _evaluator(data, medium),
            theta,
            _limiter(medium),
            max_steps=25 if number == rounds - 1 else 6,
        )
    state = _state(theta, turn, blocks, medium, noises)
    memory = _memory(theta, blocks) if is_slow_noise else None
    return _result(theta, turn, blocks, medium, (floor, free, memory, state))


def _memory(theta: FloatArray, blocks: Blocks) -> float:
    span = float(blocks.time_s[-1] - blocks.time_s[0])
    step = span / max(blocks.time_s.size - 1, 1)
    passage = float(np.exp(np.median(theta[:, 1])))
    longest = max(MEMORY_IN_PASSAGES * passage, 6 * step)
    return min(longest, span / 3)


def _state(
    theta: FloatArray,
    turn: FloatArray,
    blocks: Blocks,
    medium: Medium,
    noises: tuple[BlockNoise, BlockNoise, BlockNoise] | None,
) -> _State:
    law = passage_law(
        blocks.time_s, theta[:, :3], medium.sound_speed_mps, medium.height_m
    )
    weights = (
        (noises[0].weight, noises[1].weight, noises[2].weight)
        if noises
        else (blocks.shift.weight, blocks.bearing.weight, blocks.level.weight)
    )
    rest = rest_shift(law, blocks.shift.value, weights[0])
    shift = law.shift[:, None, :]
    doppler = blocks.shift.value - shift - rest[..., None] * (1 + shift)
    around = blocks.bearing.value - (turn[:, None] * law.angle)[:, None, :]
    centre = _circular_centre(around, weights[1])
    total = np.logaddexp(law.spread, theta[:, 3:4])[:, None, :]
    above = blocks.level.value - total
    level = _centre(above, weights[2], noises is None)
    return _State(
        law,
        centre,
        (
            doppler,
            wrap_rad(around - centre[:, None, None]),
            above - level[:, None, None],
        ),
        rest,
        level,
    )


def _circular_centre(angle: FloatArray, weight: FloatArray) -> FloatArray:
    """Weighted mean direction, with one Newton step to the least-squares one."""
    vector = (weight * np.exp(1j * angle)).sum(axis=(1, 2))
    centre = np.angle(vector)
    size = np.broadcast_to(weight, angle.shape).sum(axis=(1, 2))
    near = wrap_rad(angle - centre[:, None, None])
    mean = (weight * near).sum(axis=(1, 2)) / np.where(size > 0, size, 1.0)
    turned: FloatArray = centre + mean
    return turned


def _centre(value: FloatArray, weight: FloatArray, is_rough: bool) -> FloatArray:
    size = np.broadcast_to(weight, value.shape).sum(axis=(1, 2))
    if is_rough and bool(np.any(size > 0)):
        known = np.where(np.broadcast_to(weight, value.shape) > 0, value, np.nan)
        middle: FloatArray = np.nanmedian(known, axis=(1, 2))
        return middle
    mean: FloatArray = (weight * value).sum(axis=(1, 2)) / np.where(size > 0, size, 1.0)
    return mean


def _noises(
    state: _State, blocks: Blocks, memory_s: float | None
) -> tuple[BlockNoise, BlockNoise, BlockNoise]:
    kinds = (blocks.shift, blocks.bearing, blocks.level)
    first, second, third = (
        block_noise(residual, block, blocks.time_s, memory_s)
        for residual, block in zip(state.residuals, kinds, strict=True)
    )
    return first, second, third


def _weigh(
    state: _State,
    noises: tuple[BlockNoise, BlockNoise, BlockNoise],
    blocks: Blocks,
    fixed: tuple[FloatArray, FloatArray, BoolArray],
) -> Weighted:
    turn, floor, free = fixed
    batch = turn.size
    predicted = state.bearing[:, None] + turn[:, None] * state.law.angle
    bearing, size = combine_bearings(
        np.broadcast_to(blocks.bearing.value, noises[1].weight.shape),
        noises[1].weight,
        predicted,
    )
    return Weighted(
        blocks.time_s,
        np.broadcast_to(blocks.shift.value, (batch, *blocks.shift.value.shape[1:])),
        noises[0].weight,
        bearing,
        size,
        np.broadcast_to(blocks.level.value, (batch, 1, blocks.time_s.size))[:, 0],
        noises[2].weight[:, 0],
        floor,
        turn,
        free,
    )


def _evaluator(data: Weighted, medium: Medium) -> Callable[[FloatArray], Evaluation]:
    def evaluate(theta: FloatArray) -> Evaluation:
        normal = normal_equations(theta, data, medium)
        return normal.cost, normal.gradient, normal.matrix

    return evaluate


def _limiter(medium: Medium) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Keep steps within the reach of the linearisation, and the speed below sound."""
    fastest = 0.8 * medium.sound_speed_mps

    def limit(theta: FloatArray, step: FloatArray) -> FloatArray:
        reach = 2 * np.exp(theta[:, 1])
        speed = np.clip(theta[:, 2] + step[:, 2], -fastest, fastest)
        return np.stack(
            [
                np.clip(step[:, 0], -reach, reach),
                np.clip(step[:, 1], -1.0, 1.0),
                speed - theta[:, 2],
                np.clip(step[:, 3], -2.0, 2.0),
            ],
            axis=-1,
        )

    return limit


def _result(
    theta: FloatArray,
    turn: FloatArray,
    blocks: Blocks,
    medium: Medium,
    parts: tuple[FloatArray, BoolArray, float | None, _State],
) -> PassageFit:
    floor, free, memory, state = parts
    noises = _noises(state, blocks, memory)
    data = _weigh(state, noises, blocks, (turn, floor, free))
    spread = passage_covariance(theta, data, medium, state.law)
    rest = blocks.mean_hz * (1 + state.rest)
    return PassageFit(
        theta,
        turn,
        np.rad2deg(state.bearing) % 360.0,
        rest,
        np.broadcast_to(blocks.mean_hz, rest.shape) * spread.rest_std,
        NEPER_DB * state.level,
        spread.covariance,
        noises[0].cost + noises[1].cost + noises[2].cost,
        *noises,
    )
