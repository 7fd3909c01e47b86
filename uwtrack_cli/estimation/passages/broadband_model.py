"""Model of several passages in broadband levels and bearings, and its partials.

**Conventions.** Powers are natural logarithms, bearings radians clockwise from north;
unknowns as in `broadband_sum`.

**References.** Choi et al. (2014), eq. 3, as a sum.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.physics.geometry import wrap_rad

N_COMMON = 2
"""Unknowns common to all: background and law of spreading."""

N_EACH = 4
"""Unknowns of a source: time, ln of d/v, ln of its power, bearing."""


@dataclass(frozen=True)
class Sound:
    """Levels and bearings with their deviations, all (n,); nan is missing."""

    time_s: FloatArray
    power: FloatArray
    power_std: FloatArray
    bearing: FloatArray
    bearing_std: FloatArray


@dataclass(frozen=True)
class Known:
    """Sources whose motion is known: ln of (d/R)^2 and bearing, shape (m, n)."""

    spread: FloatArray
    bearing: FloatArray


def source_parts(
    theta: FloatArray, turn: FloatArray, time_s: FloatArray, known: Known
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Powers and intensities of all sources (batch, m + k, n), and the background.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 2 + m + 4 k).
    turn
        Sign of the bearing trend of the free sources, shape (batch, k).
    time_s
        Times of reception in seconds, shape (n,).
    known
        Sources of known motion.
    """
    n_known, batch = known.spread.shape[0], theta.shape[0]
    free = theta[:, N_COMMON + n_known :].reshape(batch, -1, N_EACH)
    law = theta[:, 1, None, None]
    x = (time_s - free[..., 0:1]) / np.exp(free[..., 1:2])
    moving = np.exp(free[..., 2:3] - law * np.log1p(x**2))
    angle = free[..., 3:4] + turn[..., None] * np.arctan(x)
    own = theta[:, N_COMMON : N_COMMON + n_known, None]
    steady = np.exp(own + law * known.spread)
    power = np.concatenate([steady, moving], axis=1)
    # a known source without bearings has no share in the intensity
    seen = np.nan_to_num(np.exp(1j * np.broadcast_to(known.bearing, steady.shape)))
    direction = np.concatenate([seen, np.exp(1j * angle)], axis=1)
    return power, power * direction, np.exp(theta[:, :1])


def sum_residuals(
    theta: FloatArray, turn: FloatArray, sound: Sound, known: Known
) -> tuple[FloatArray, FloatArray]:
    """Residuals of levels and bearings (batch, 2 n), and their partials.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 2 + m + 4 k).
    turn
        Sign of the bearing trend of the free sources, shape (batch, k).
    sound
        Levels and bearings.
    known
        Sources of known motion.
    """
    power, vector, background = source_parts(theta, turn, sound.time_s, known)
    n_known, (batch, n_all, n) = known.spread.shape[0], power.shape
    total = background + power.sum(axis=1)
    whole = vector.sum(axis=1)
    size = np.maximum(np.abs(whole) ** 2, 1e-300)
    turned = wrap_rad(np.nan_to_num(sound.bearing) - np.angle(whole))
    residual = np.concatenate(
        [np.nan_to_num(sound.power) - np.log(total), turned], axis=1
    )
    slope = np.zeros((batch, 2 * n, theta.shape[1]))
    slope[:, :n, 0] = -background / total
    share = power / total[:, None]
    pull = vector * (whole.conj() / size)[:, None]
    known_ones = slice(N_COMMON, N_COMMON + n_known)
    slope[:, :n, known_ones] = -np.swapaxes(share[:, :n_known], 1, 2)
    slope[:, n:, known_ones] = -np.swapaxes(pull[:, :n_known].imag, 1, 2)
    by_law = np.broadcast_to(known.spread, share[:, :n_known].shape)
    slope[:, :n, 1] = -(share[:, :n_known] * by_law).sum(axis=1)
    slope[:, n:, 1] = -(pull[:, :n_known].imag * by_law).sum(axis=1)
    law = theta[:, 1, None]
    for row in range(n_all - n_known):
        first = N_COMMON + n_known + N_EACH * row
        t0, width = theta[:, first, None], np.exp(theta[:, first + 1, None])
        x = (sound.time_s - t0) / width
        own, drawn = share[:, n_known + row], pull[:, n_known + row]
        twist = turn[:, row, None]
        slow = 1 / (1 + x**2)
        slope[:, :n, 1] += own * np.log1p(x**2)
        slope[:, n:, 1] += drawn.imag * np.log1p(x**2)
        slope[:, :n, first] = -own * law * 2 * x * slow / width
        slope[:, :n, first + 1] = -own * law * 2 * x**2 * slow
        slope[:, :n, first + 2] = -own
        fall, swing = 2 * law * x, 1j * twist
        slope[:, n:, first] = -(drawn * (fall - swing)).imag * slow / width
        slope[:, n:, first + 1] = -(drawn * (fall - swing) * x).imag * slow
        slope[:, n:, first + 2] = -drawn.imag
        slope[:, n:, first + 3] = -drawn.real
    return residual, slope
