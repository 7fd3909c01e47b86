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
    t0, r, v = (
        parameters[..., 0:1],
        np.exp(parameters[..., 1:2]),
        parameters[..., 2:3],
    )
    mach = v / sound_speed_mps
    lag = time_s - t0
    h = np.sqrt(lag**2 + (1 - mach**2) * r**2)
    over = 1 / h
    rows = np.empty((*h.shape[:-1], 3, 4, h.shape[-1]))
    _shift(rows[..., 0, :, :], lag * over, over, mach, sound_speed_mps)
    _angle(rows[..., 1, :, :], (lag, h, over), r, v, (sound_speed_mps, height_m))
    _spread(rows[..., 2, :, :], (lag, h, over), r, mach, sound_speed_mps)
    return Passage(rows)


def _shift(
    rows: FloatArray, ratio: FloatArray, over: FloatArray, mach: FloatArray, c: float
) -> None:
    gamma = 1 - mach**2
    small = mach / gamma
    slope = small - small * ratio**2
    rows[..., 0, :] = small * (mach - ratio)
    rows[..., 1, :] = slope * over
    rows[..., 2, :] = slope * ratio
    rows[..., 3, :] = (2 * small - ratio * ((1 + mach**2) / gamma + mach * slope)) / (
        c * gamma
    )


def _angle(
    rows: FloatArray,
    lags: tuple[FloatArray, FloatArray, FloatArray],
    r: FloatArray,
    v: FloatArray,
    medium: tuple[float, float],
) -> None:
    lag, h, over_h = lags
    c, height = medium
    mach = v / c
    gamma = 1 - mach**2
    u = (lag - mach * h) / gamma
    slow = np.where(v > 0, v, np.inf)
    # a source can be no nearer than the depth difference: keep the root real
    flat = np.sqrt(np.maximum(r**2 - (height / slow) ** 2, 1e-4 * r**2))
    by_flat = 1 / (u**2 + flat**2)
    by_u = flat * by_flat
    by_flat *= u
    pull = (mach * r**2) * over_h
    rows[..., 0, :] = np.arctan(u / flat)
    rows[..., 1, :] = by_u * ((mach / gamma) * (lag * over_h) - 1 / gamma)
    rows[..., 2, :] = -by_u * pull - by_flat * (r**2 / flat)
    rows[..., 3, :] = by_u * (2 * mach * u - h + mach * pull) / (
        c * gamma
    ) - by_flat * (height**2 / (slow**3 * flat))


def _spread(
    rows: FloatArray,
    lags: tuple[FloatArray, FloatArray, FloatArray],
    r: FloatArray,
    mach: FloatArray,
    c: float,
) -> None:
    lag, h, over_h = lags
    gamma = 1 - mach**2
    over = 1 / (h - mach * lag)
    pull = r**2 * over_h
    rows[..., 0, :] = 2 * np.log((r * gamma) * over)
    over *= 2
    rows[..., 1, :] = over * (lag * over_h - mach)
    rows[..., 2, :] = 2 - gamma * (pull * over)
    rows[..., 3, :] = (over * (mach * pull + lag) - 4 * mach / gamma) / c


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
