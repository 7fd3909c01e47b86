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

    ``shift`` is f/f0 - 1; ``angle`` the bearing relative to that at closest approach
    without its sign, radians; ``spread`` the natural logarithm of (d/R)^2.
    """

    shift: FloatArray
    angle: FloatArray
    spread: FloatArray
    shift_d: FloatArray
    angle_d: FloatArray
    spread_d: FloatArray


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
    gamma = 1 - mach**2
    lag = time_s - t0
    h = np.sqrt(lag**2 + gamma * r**2)
    ratio = lag / h
    shift, shift_d = _shift(mach, gamma, h, ratio, sound_speed_mps)
    angle, angle_d = _angle(lag, h, r, v, (sound_speed_mps, height_m))
    spread, spread_d = _spread(lag, h, r, mach, sound_speed_mps)
    return Passage(shift, angle, spread, shift_d, angle_d, spread_d)


def _shift(
    mach: FloatArray, gamma: FloatArray, h: FloatArray, ratio: FloatArray, c: float
) -> tuple[FloatArray, FloatArray]:
    across = 1 - ratio**2
    slope = mach / gamma * across
    shift_d = np.empty((*h.shape, 3))
    shift_d[..., 0] = slope / h
    shift_d[..., 1] = slope * ratio
    shift_d[..., 2] = (
        2 * mach / gamma - ratio * ((1 + mach**2) / gamma + mach * slope)
    ) / (c * gamma)
    return mach * (mach - ratio) / gamma, shift_d


def _angle(
    lag: FloatArray,
    h: FloatArray,
    r: FloatArray,
    v: FloatArray,
    medium: tuple[float, float],
) -> tuple[FloatArray, FloatArray]:
    c, height = medium
    mach = v / c
    gamma = 1 - mach**2
    u = (lag - mach * h) / gamma
    slow = np.where(v > 0, v, np.inf)
    # a source can be no nearer than the depth difference: keep the root real
    flat = np.sqrt(np.maximum(r**2 - (height / slow) ** 2, 1e-4 * r**2))
    over = 1 / (u**2 + flat**2)
    by_u, by_flat = flat * over, u * over
    pull = mach * r**2 / h
    angle_d = np.empty((*h.shape, 3))
    angle_d[..., 0] = by_u * (mach * lag / h - 1) / gamma
    angle_d[..., 1] = -by_u * pull - by_flat * (r**2 / flat)
    angle_d[..., 2] = by_u * (2 * mach * u - h + mach * pull) / (
        c * gamma
    ) - by_flat * (height**2 / (slow**3 * flat))
    return np.arctan2(u, flat), angle_d


def _spread(
    lag: FloatArray, h: FloatArray, r: FloatArray, mach: FloatArray, c: float
) -> tuple[FloatArray, FloatArray]:
    gamma = 1 - mach**2
    over = 1 / (h - mach * lag)
    pull = r**2 / h
    spread_d = np.empty((*h.shape, 3))
    spread_d[..., 0] = 2 * over * (lag / h - mach)
    spread_d[..., 1] = 2 - 2 * gamma * pull * over
    spread_d[..., 2] = (2 * over * (mach * pull + lag) - 4 * mach / gamma) / c
    return 2 * np.log(r * gamma * over), spread_d


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
