"""What a sensor receives from a source that passes on a straight line.

**Method.** A source at constant velocity is heard with a delay; solving for the time
of emission gives closed forms in the time of *reception* for the frequency ratio, the
direction and the spreading loss. With T = t - t0, M = v/c, r = d/v and
h = sqrt(T^2 + (1 - M^2) r^2)::

    f / f0 = (1 - M T / h) / (1 - M^2)
    u      = (T - M h) / (1 - M^2)          time of emission after closest approach
    R      = v (h - M T) / (1 - M^2)        range at emission
    bearing = b0 + turn * atan(u / r_h)

**Conventions.** t0 is the geometric instant of closest approach; its sound arrives
d/c later. r = d/v holds the slant range and r_h its horizontal part. Partials are with
respect to (t0, ln r, v), in this order on the last axis.

**References.** Choi et al. (2014), eq. 5 corrected: with a plus sign under the root
it is this law after relabelling f0 and d (see `straight_shift`).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray


@dataclass(frozen=True)
class Passage:
    """Values of the law at the reception times, and their partials.

    Attributes
    ----------
    rows
        Shape (..., 3, 4, n): of shift, angle and spread the value, then its partials,
        each with the times side by side.
    """

    rows: FloatArray

    @property
    def shift(self) -> FloatArray:
        """f/f0 - 1."""
        return self.rows[..., 0, 0, :]

    @property
    def angle(self) -> FloatArray:
        """Bearing relative to that at closest approach without its sign, radians."""
        return self.rows[..., 1, 0, :]

    @property
    def spread(self) -> FloatArray:
        """Natural logarithm of (d/R)^2."""
        return self.rows[..., 2, 0, :]

    @property
    def shift_d(self) -> FloatArray:
        """Partials of the shift, shape (..., n, 3)."""
        return np.swapaxes(self.rows[..., 0, 1:, :], -1, -2)

    @property
    def angle_d(self) -> FloatArray:
        """Partials of the angle, shape (..., n, 3)."""
        return np.swapaxes(self.rows[..., 1, 1:, :], -1, -2)

    @property
    def spread_d(self) -> FloatArray:
        """Partials of the spreading, shape (..., n, 3)."""
        return np.swapaxes(self.rows[..., 2, 1:, :], -1, -2)


def passage_law(
    time_s: FloatArray,
    parameters: FloatArray,
    sound_speed_mps: float,
    height_m: float = 0.0,
) -> Passage:
    """Evaluate frequency shift, angle and spreading of a straight passage.

    Parameters
    ----------
    time_s
        Reception times in seconds, shape (n,).
    parameters
        Rows of (t0 in s, ln of d/v in s, v in m/s), shape (..., 3); a speed of
        zero leaves out the delays.
    sound_speed_mps
        Sound speed in m/s.
    height_m
        Difference of the depths of sensor and source, in metres.

    Notes
    -----
    Retarded-time solution of a source in uniform motion; see the module's head.
    """
    # plain numbers for one passage: much cheaper than arrays of one element
    one = parameters.ndim == 1
    t0, log_r, v = (
        parameters[k] if one else parameters[..., k, None] for k in range(3)
    )
    r = np.exp(log_r)
    mach = v / sound_speed_mps
    lag = time_s - t0
    h = np.sqrt(lag**2 + (1 - mach**2) * r**2)
    over = 1 / h
    parts = _Parts(lag, h, over, lag * over, (mach * r**2) * over)
    rows = np.empty((*h.shape[:-1], 3, 4, h.shape[-1]))
    _shift(rows[..., 0, :, :], parts, mach, sound_speed_mps)
    _angle(rows[..., 1, :, :], parts, r, v, (sound_speed_mps, height_m))
    _spread(rows[..., 2, :, :], parts, r, mach, sound_speed_mps)
    return Passage(rows)


class _Parts(NamedTuple):
    """T, h, 1/h, T/h and M r^2/h: what the three laws share."""

    lag: FloatArray
    h: FloatArray
    over: FloatArray
    ratio: FloatArray
    pull: FloatArray


def _shift(rows: FloatArray, parts: _Parts, mach: FloatArray, c: float) -> None:
    gamma = 1 - mach**2
    unit = 1 / (c * gamma)
    small = mach / gamma
    slope = parts.pull * parts.over
    rows[..., 0, :] = small * mach - small * parts.ratio
    np.multiply(slope, parts.over, out=rows[..., 1, :])
    np.multiply(slope, parts.ratio, out=rows[..., 2, :])
    slope *= mach * unit
    slope += (1 + mach**2) / gamma * unit
    slope *= parts.ratio
    np.subtract(2 * small * unit, slope, out=rows[..., 3, :])


def _angle(
    rows: FloatArray,
    parts: _Parts,
    r: FloatArray,
    v: FloatArray,
    medium: tuple[float, float],
) -> None:
    c, height = medium
    mach = v / c
    gamma = 1 - mach**2
    unit = 1 / (c * gamma)
    u = (parts.lag - mach * parts.h) / gamma
    slow = np.where(v > 0, v, np.inf)
    # a source can be no nearer than the depth difference: keep the root real
    square = np.maximum(r**2 - (height / slow) ** 2, 1e-4 * r**2)
    flat = np.sqrt(square)
    by_flat = 1 / (u**2 + square)
    by_u = flat * by_flat
    by_flat *= u
    np.arctan(u * (1 / flat), out=rows[..., 0, :])
    np.multiply(by_u, (mach / gamma) * parts.ratio - 1 / gamma, out=rows[..., 1, :])
    rows[..., 2, :] = (-(r**2) / flat) * by_flat - by_u * parts.pull
    u *= 2 * mach * unit
    u -= unit * parts.h
    u += (mach * unit) * parts.pull
    u *= by_u
    by_flat *= height**2 / (slow**3 * flat)
    np.subtract(u, by_flat, out=rows[..., 3, :])


def _spread(
    rows: FloatArray, parts: _Parts, r: FloatArray, mach: FloatArray, c: float
) -> None:
    gamma = 1 - mach**2
    over = 2 / (parts.h - mach * parts.lag)
    np.log((0.5 * r * gamma) * over, out=rows[..., 0, :])
    rows[..., 0, :] *= 2
    np.multiply(over, parts.ratio - mach, out=rows[..., 1, :])
    rows[..., 2, :] = 2 - (gamma * r**2) * (parts.over * over)
    rows[..., 3, :] = over * ((parts.pull + parts.lag) / c) - 4 * mach / (gamma * c)


def straight_shift(
    time_s: FloatArray, time_closest_s: float, range_m: float, speed_mps: float,
    sound_speed_mps: float,
) -> FloatArray:  # fmt: skip
    """Return f/f0' - 1 by the paper's formula with its sign corrected.

    It equals `passage_law` exactly when f0' = f0 / (1 - M^2) and the range is
    d sqrt(1 - M^2): a straight-line fit without delays is right in v and d.

    Parameters
    ----------
    time_s
        Reception times in seconds.
    time_closest_s
        Geometric closest approach in seconds.
    range_m
        Relabelled range d sqrt(1 - M^2) in metres.
    speed_mps
        Speed in m/s.
    sound_speed_mps
        Sound speed in m/s.

    Notes
    -----
    Choi et al. (2014), eq. 5 with a plus sign under the root.
    """
    lag = np.asarray(time_s, float) - time_closest_s
    root = np.sqrt((range_m / speed_mps) ** 2 + lag**2)
    shift: FloatArray = -(speed_mps / sound_speed_mps) * lag / root
    return shift
