"""The slow noise of a passage's frequencies, bearings and levels.

**Method.** Each kind is condensed to one residual per instant (its lines wander
together); strength and memory of its slow part come from the restricted likelihood
with the partials of the passage as the design.

**Conventions.** One data set: the batch has one row.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.passage_normal import (
    Losses,
    Weighted,
    bearing_residual,
    level_residual,
)
from uwtrack_cli.estimation.passage_state import State
from uwtrack_cli.estimation.slow_noise import SlowNoise, fit_slow_noise, slow_inverse


def slow_noises(
    theta: FloatArray, state: State, data: Weighted
) -> tuple[tuple[SlowNoise, ...], Losses]:
    """Find the slow noise of every kind, and what it takes from the information.

    Parameters
    ----------
    theta
        Unknowns, one row.
    state
        Residuals at these unknowns.
    data
        Measurements with the weights of their white noise.
    """
    bearing_slope = bearing_residual(state.law, data)[1][0]
    level_slope = level_residual(theta, state.law, data)[1][0]
    series = (
        (state.residuals[0][0], data.shift_weight[0], state.law.shift_d[0]),
        (data.bearing[0] - _bearing_model(state, data), data.bearing_weight, None),
        (state.residuals[2][0], data.level_weight, None),
    )
    designs = (series[0][2], bearing_slope[:, :3], level_slope)
    width = float(np.exp(theta[0, 1]))
    found: list[SlowNoise] = []
    losses: list[FloatArray | None] = []
    for (residual, weight, _), design in zip(series, designs, strict=True):
        mean, size = _combine(np.atleast_2d(residual), np.atleast_2d(weight))
        columns = np.concatenate([design, np.ones((size.size, 1))], axis=1)
        noise = fit_slow_noise(mean, size, data.time_s, columns, width)
        found.append(noise)
        losses.append(
            None
            if noise.is_white
            else np.diag(size) - slow_inverse(size, data.time_s, noise)
        )
    return tuple(found), (losses[0], losses[1], losses[2])


def _bearing_model(state: State, data: Weighted) -> FloatArray:
    model: FloatArray = state.bearing[0] + data.turn[0] * state.law.angle[0]
    return model


def _combine(residual: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """One residual per instant from all rows, and its inverse variance."""
    size = weight.sum(axis=0)
    mean = (weight * residual).sum(axis=0) / np.where(size > 0, size, 1.0)
    return mean, size
