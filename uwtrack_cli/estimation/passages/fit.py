"""Joint maximum likelihood of a passage from all that a contact offers.

**Method.** Rounds of Levenberg-Marquardt steps with fixed weights, and of weights from
the residuals: a robust loss, scales from the data, and the long-run variance of noise
with a memory. All rows of the batch go at once, be they starts of one data set or data
sets of a study. A single data set whose noise has a memory is then fitted again with
the covariance of that noise (`fit_with_memory`).

**Conventions.** As in `normal`; the covariance that leaves this module is over
(t0 in s, d/v in s, v in m/s, bearing in degrees).

**References.** Choi et al. (2014), eqs. 4-6 with free rest frequency, level and floor.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.least_squares import Evaluation, damped_least_squares
from uwtrack_cli.estimation.passages.block_noise import (
    Noises,
    block_noises,
    rough_weight,
)
from uwtrack_cli.estimation.passages.blocks import NEPER_DB, Blocks
from uwtrack_cli.estimation.passages.covariance import passage_covariance
from uwtrack_cli.estimation.passages.memory import slow_noises
from uwtrack_cli.estimation.passages.normal import (
    NO_LOSS,
    JointNormal,
    Losses,
    Medium,
    Weighted,
    free_unknowns,
    normal_equations,
)
from uwtrack_cli.estimation.passages.slow_noise import SlowNoise
from uwtrack_cli.estimation.passages.state import Fixed, State, passage_state, weigh
from uwtrack_cli.estimation.robust import median_where
from uwtrack_cli.physics.passage import Passage

MEMORY_IN_PASSAGES = 1.5
"""Bartlett's window in units of d/v: 60 s where d/v is 40 s."""

ROUGH_ROUNDS = 2
"""Rounds with simple robust weights before those that judge the noise in full."""

ROUGH_TOLERANCE = 20.0
"""Gain in log-likelihood at which a rough round ends, with one more step."""

TOLERANCE = 1e-2
"""Gain at which the last round ends, with one more step: a seventh of a deviation
before that step, and far less after it."""


@dataclass(frozen=True)
class PassageFit:
    """Result of a fit, one row per start or data set; see `normal`."""

    theta: FloatArray
    turn: FloatArray
    bearing_deg: FloatArray
    rest_hz: FloatArray
    rest_std_hz: FloatArray
    level_db: FloatArray
    covariance: FloatArray
    cost: FloatArray
    noises: Noises
    losses: Losses = NO_LOSS
    slow: tuple[SlowNoise, ...] = ()

    @property
    def range_over_speed_s(self) -> FloatArray:
        """Slant range over speed, s."""
        return np.exp(self.theta[:, 1])


def fit_passage(
    blocks: Blocks,
    start: FloatArray,
    turn: FloatArray,
    medium: Medium,
    *,
    rounds: int = 1,
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
        Rounds of full weights, after those that find the way.
    is_slow_noise
        Whether noise with a memory is looked for.
    """
    theta = start
    fixed = Fixed(turn, start[:, 3], free_unknowns(blocks, start.shape[0]))
    state = passage_state(theta, fixed, blocks, medium, None)
    for _ in range(ROUGH_ROUNDS):
        weight = rough_weight(state.residual, blocks)
        data = weigh(state, weight, blocks, fixed)
        theta, normal = _descend(theta, data, medium, state.law, 8, ROUGH_TOLERANCE)
        state = passage_state(theta, fixed, blocks, medium, weight, normal)
    for _ in range(rounds):
        memory = _memory(theta, blocks) if is_slow_noise else None
        noises = block_noises(state.residual, blocks, memory)
        weight = weight_of(noises)
        data = weigh(state, weight, blocks, fixed)
        theta, normal = _descend(theta, data, medium, state.law, 25)
        state = passage_state(theta, fixed, blocks, medium, weight, normal)
    if normal is None:
        normal = normal_equations(theta, data, medium, state.law)
    return _result(theta, data, blocks, (state, noises, normal))


def weight_of(noises: Noises) -> FloatArray:
    """Return the weights that follow from the noise, of all rows.

    Parameters
    ----------
    noises
        Noise of the three kinds.
    """
    return np.concatenate([noise.weight for noise in noises], axis=1)


def take_row(fit: PassageFit, row: int) -> PassageFit:
    """Return one row of a batch.

    Parameters
    ----------
    fit
        Fit of a batch.
    row
        Row that is wanted.
    """
    one = slice(row, row + 1)
    noises = tuple(
        type(noise)(*(getattr(noise, f.name)[one] for f in fields(noise)))
        for noise in fit.noises
    )
    return PassageFit(
        fit.theta[one],
        fit.turn[one],
        fit.bearing_deg[one],
        fit.rest_hz[one],
        fit.rest_std_hz[one],
        fit.level_db[one],
        fit.covariance[one],
        fit.cost[one],
        (noises[0], noises[1], noises[2]),
    )


def fit_with_memory(
    fit: PassageFit, blocks: Blocks, medium: Medium, *, rounds: int = 2
) -> PassageFit:
    """Fit one data set again with the covariance of its slow noise.

    Returned as it is where the noise has no memory.

    Parameters
    ----------
    fit
        Fit of one row.
    blocks
        Measurements in fit units, one row.
    medium
        Sound speed and depth difference.
    rounds
        Rounds of noise and fit.
    """
    theta, noises = fit.theta, fit.noises
    free = free_unknowns(blocks, 1)
    fixed = Fixed(fit.turn, theta[:, 3], free)
    slow: tuple[SlowNoise, ...] = ()
    losses = NO_LOSS
    state = passage_state(theta, fixed, blocks, medium, weight_of(noises))
    for _ in range(rounds):
        noises = block_noises(state.residual, blocks, 0.0)
        weight = weight_of(noises)
        data = weigh(state, weight, blocks, fixed)
        slow, losses = slow_noises(theta, state, data, blocks)
        if all(noise.is_white for noise in slow):
            return fit
        data = weigh(state, weight, blocks, fixed, losses)
        theta, normal = _descend(theta, data, medium, state.law, 15)
        state = passage_state(theta, fixed, blocks, medium, weight, normal)
    if normal is None:
        normal = normal_equations(theta, data, medium, state.law)
    return _result(theta, data, blocks, (state, noises, normal), slow)


def _descend(
    theta: FloatArray,
    data: Weighted,
    medium: Medium,
    law: Passage,
    max_steps: int,
    tolerance: float = TOLERANCE,
) -> tuple[FloatArray, JointNormal | None]:
    """Minimise with fixed weights; ``law`` is the passage at the start.

    Also returned is what was evaluated at the result, if anything was.
    """
    last: list[tuple[FloatArray, JointNormal]] = []

    def evaluate(trial: FloatArray) -> Evaluation:
        known = law if trial is theta else None
        normal = normal_equations(trial, data, medium, known)
        last[:] = [(trial, normal)]
        return normal.cost, normal.gradient, normal.matrix

    found = damped_least_squares(
        evaluate, theta, _limiter(medium), max_steps=max_steps, tolerance=tolerance
    )
    trial, normal = last[0]
    return found, normal if trial is found else None


def _memory(theta: FloatArray, blocks: Blocks) -> float:
    span = float(blocks.time_s[-1] - blocks.time_s[0])
    step = span / max(blocks.time_s.size - 1, 1)
    passage = float(np.exp(median_where(theta[:, 1], np.ones(theta.shape[0]))))
    longest = max(MEMORY_IN_PASSAGES * passage, 6 * step)
    return min(longest, span / 3)


def _limiter(medium: Medium) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Keep steps within the reach of the linearisation, and the speed below sound."""
    fastest = 0.8 * medium.sound_speed_mps

    def limit(theta: FloatArray, step: FloatArray) -> FloatArray:
        reach = np.empty_like(step)
        reach[:, 0] = 2 * np.exp(theta[:, 1])
        reach[:, 1:] = 1.0, np.inf, 2.0
        limited: FloatArray = np.minimum(np.maximum(step, -reach), reach)
        speed = np.minimum(np.maximum(theta[:, 2] + step[:, 2], -fastest), fastest)
        limited[:, 2] = speed - theta[:, 2]
        return limited

    return limit


def _result(
    theta: FloatArray,
    data: Weighted,
    blocks: Blocks,
    last: tuple[State, Noises, JointNormal],
    slow: tuple[SlowNoise, ...] = (),
) -> PassageFit:
    state, noises, normal = last
    spread = passage_covariance(theta, data, normal)
    rest = blocks.mean_hz * (1 + state.rest)
    return PassageFit(
        theta,
        data.turn,
        np.rad2deg(state.bearing) % 360.0,
        rest,
        np.broadcast_to(blocks.mean_hz, rest.shape) * spread.rest_std,
        NEPER_DB * state.level,
        spread.covariance,
        noises[0].cost + noises[1].cost + noises[2].cost,
        noises,
        data.losses,
        slow,
    )
