"""What a sensor receives from a source that passes on a straight line.

**Method.** A source at constant velocity is received with a delay; solving for the
time of emission gives closed forms in the time of *reception* for the frequency ratio,
the direction and the spreading loss. With T = t - t0, M = v/c, the horizontal range
over speed q = d_h/v, the depth difference z, r^2 = q^2 + (z/v)^2 and
h = sqrt(T^2 + (1 - M^2) r^2)::

    f / f0 = (1 - M T / h) / (1 - M^2)
    u      = (T - M h) / (1 - M^2)          time of emission after closest approach
    R      = v (h - M T) / (1 - M^2)        range at emission
    bearing = b0 + turn * atan(u / q)

**Conventions.** t0 is the geometric instant of closest approach; its sound arrives
d/c later. The unknown is the horizontal range, so that the slant range d = r v can
never be below the depth difference. Partials are with respect to (t0, ln q, v, z), in
this order.

**References.** Choi et al. (2014), eq. 5 corrected: with a plus sign under the root
it is this law after relabelling f0 and d (see `straight_shift`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray


@dataclass(frozen=True)
class Passage:
    """Values of the law at the reception times, and their partials.

    Attributes
    ----------
    rows
        Shape (..., 3, 5, n): of shift, angle and spread the value, then its partials,
        each with the times side by side; without the partials with respect to the
        depth difference the shape is (..., 3, 4, n).
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
        """Partials of the shift, shape (..., n, 3 or 4)."""
        return np.swapaxes(self.rows[..., 0, 1:, :], -1, -2)

    @property
    def angle_d(self) -> FloatArray:
        """Partials of the angle, shape (..., n, 3 or 4)."""
        return np.swapaxes(self.rows[..., 1, 1:, :], -1, -2)


SLOWEST_MPS = 0.25
"""Speeds below twice this are bent up to it in z/v, which stays finite at rest."""


def slant_over_speed_s(
    horizontal_s: FloatArray, speed_mps: FloatArray, height_m: FloatArray | float
) -> FloatArray:
    """Return the slant range over speed.

    Parameters
    ----------
    horizontal_s
        Horizontal range over speed, s.
    speed_mps
        Speed in m/s.
    height_m
        Depth difference of sensor and source, m.

    Examples
    --------
    >>> float(slant_over_speed_s(np.array(4.0), np.array(2.0), 6.0))
    5.0
    """
    slant: FloatArray = np.hypot(horizontal_s, height_m / bounded_speed(speed_mps)[0])
    return slant


def passage_law(
    time_s: FloatArray,
    parameters: FloatArray,
    sound_speed_mps: float,
    height_m: FloatArray | float = 0.0,
    *,
    with_height: bool = False,
) -> Passage:
    """Evaluate frequency shift, angle and spreading of a straight passage.

    Parameters
    ----------
    time_s
        Reception times in seconds, shape (n,).
    parameters
        Rows of (t0 in s, ln of d_h/v in s, v in m/s), shape (..., 3); a speed of
        zero leaves out the delays.
    sound_speed_mps
        Sound speed in m/s.
    height_m
        Difference of the depths of sensor and source in metres, shape () or (...).
    with_height
        Whether the partials with respect to the depth difference are wanted.

    Notes
    -----
    Retarded-time solution of a source in uniform motion; see the module's head.
    """
    # plain numbers for one passage: much cheaper than arrays of one element
    one = parameters.ndim == 1
    t0, log_q, v = (parameters[k] if one else parameters[..., k, None] for k in range(3))
    z = height_m if one or np.ndim(height_m) == 0 else np.asarray(height_m)[..., None]
    q = np.exp(log_q)
    speed, speed_v = bounded_speed(v)
    rise = z / speed
    r = np.hypot(q, rise)
    mach = v / sound_speed_mps
    lag = time_s - t0
    h = np.sqrt(lag**2 + (1 - mach**2) * r**2)
    over = 1 / h
    parts = _Parts(lag, h, over, lag * over, (mach * r**2) * over)
    rows = np.empty((*h.shape[:-1], 3, 5 if with_height else 4, h.shape[-1]))
    _shift(rows[..., 0, :4, :], parts, mach, sound_speed_mps)
    by_log_q = _angle(rows[..., 1, :4, :], parts, q, mach, sound_speed_mps)
    _spread(rows[..., 2, :4, :], parts, r, mach, sound_speed_mps)
    if np.any(rise):
        # the chain rule from ln r to ln q, v and z
        by_log_r, share = rows[..., 2, :], (rise / r) ** 2
        if with_height:
            by_z = rise / (speed * r**2)
            np.multiply(by_log_r, _rows(by_z), out=rows[..., 4, :])
        rows[..., 3, :] -= by_log_r * _rows(share / speed * speed_v)
        by_log_r *= _rows((q / r) ** 2)
    elif with_height:
        rows[..., 4, :] = 0.0
    rows[..., 1, 2, :] -= by_log_q
    return Passage(rows)


def bounded_speed(speed_mps: Any) -> tuple[Any, Any]:
    """Return a speed that is bounded away from zero, and its derivative.

    Parameters
    ----------
    speed_mps
        Speed in m/s; from twice `SLOWEST_MPS` it is returned as it is.
    """
    size = abs(speed_mps)
    near = size < 2 * SLOWEST_MPS
    if not np.any(near):  # the usual case, and several times cheaper
        return size, np.sign(speed_mps)
    bent = SLOWEST_MPS + speed_mps**2 / (4 * SLOWEST_MPS)
    return (
        np.where(near, bent, size),
        np.where(near, speed_mps / (2 * SLOWEST_MPS), np.sign(speed_mps)),
    )


def _rows(value: Any) -> Any:
    """Give values of a batch an axis for the three laws; plain numbers have none."""
    return value[..., None] if np.ndim(value) else value


class _Parts(NamedTuple):
    """T, h, 1/h, T/h and M r^2/h: what the three laws share."""

    lag: FloatArray
    """T = t - t0, s, shape (..., n)."""
    h: FloatArray
    """sqrt(T^2 + (1 - M^2) r^2), s, same shape."""
    over: FloatArray
    """1 / h, 1/s."""
    ratio: FloatArray
    """T / h."""
    pull: FloatArray
    """M r^2 / h, s."""


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
    rows: FloatArray, parts: _Parts, q: FloatArray, mach: FloatArray, c: float
) -> FloatArray:
    """Fill the rows of the angle at a known q; return minus its partial by ln q."""
    gamma = 1 - mach**2
    unit = 1 / (c * gamma)
    u = (parts.lag - mach * parts.h) / gamma
    by_u = q / (u**2 + q**2)
    np.arctan(u * (1 / q), out=rows[..., 0, :])
    np.multiply(by_u, (mach / gamma) * parts.ratio - 1 / gamma, out=rows[..., 1, :])
    np.multiply(by_u, -parts.pull, out=rows[..., 2, :])
    by_log_q: FloatArray = u * by_u
    u *= 2 * mach * unit
    u -= unit * parts.h
    u += (mach * unit) * parts.pull
    np.multiply(u, by_u, out=rows[..., 3, :])
    return by_log_q


def _spread(rows: FloatArray, parts: _Parts, r: FloatArray, mach: FloatArray, c: float) -> None:
    gamma = 1 - mach**2
    over = 2 / (parts.h - mach * parts.lag)
    np.log((0.5 * r * gamma) * over, out=rows[..., 0, :])
    rows[..., 0, :] *= 2
    np.multiply(over, parts.ratio - mach, out=rows[..., 1, :])
    rows[..., 2, :] = 2 - (gamma * r**2) * (parts.over * over)
    rows[..., 3, :] = over * ((parts.pull + parts.lag) / c) - 4 * mach / (gamma * c)


class Emitted(NamedTuple):
    """Where a source was when it emitted what is received, and how it moved there.

    Arrays of shape (batch, n) or (batch, 1). The partials are taken at a fixed time of
    emission.
    """

    place: tuple[FloatArray, FloatArray, FloatArray]
    """Along and across the course at closest approach, and the depth difference, m."""
    velocity: tuple[FloatArray, FloatArray]
    """Along and across, m/s."""
    acceleration: tuple[FloatArray, FloatArray] | None
    """The same, m/s^2; None where it goes straight."""
    partials: Sequence[tuple[FloatArray, ...]]
    """Of the place (three) and of the velocity (two) by each unknown."""
    slant2: tuple[FloatArray, tuple[FloatArray, ...]]
    """Square of the slant range at closest approach, m^2, and half its partials."""


def received_rows(emitted: Emitted, sound_speed_mps: float) -> FloatArray:
    """Return shift, angle and spread of a source, with partials at times of reception.

    Parameters
    ----------
    emitted
        The source at the times of emission.
    sound_speed_mps
        Sound speed in m/s.

    Returns
    -------
    FloatArray
        Rows as in `Passage`, shape (batch, 3, 1 + unknowns, n).
    """
    c = sound_speed_mps
    (x, y, z), (east, north) = emitted.place, emitted.velocity
    slant2, slants = emitted.slant2
    flat = x**2 + y**2
    distance = np.sqrt(flat + z**2)
    over = 1 / distance
    closing = (x * east + y * north) * over
    ratio = 1 / (1 + closing / c)
    rows = np.empty((x.shape[0], 3, 1 + len(emitted.partials), x.shape[-1]))
    rows[:, 0, 0] = ratio - 1
    rows[:, 1, 0] = np.arctan2(x, y)
    rows[:, 2, 0] = np.log(slant2 * over**2)
    pulled = None
    if emitted.acceleration is not None:
        pulled = x * emitted.acceleration[0] + y * emitted.acceleration[1]
    for k, (px, py, pz, vx, vy) in enumerate(emitted.partials, 1):
        moved = (x * px + y * py + z * pz) * over
        du = moved * (-ratio / c)
        dx, dy, moved = px + east * du, py + north * du, moved + closing * du
        turned = x * vx + y * vy + dx * east + dy * north - closing * moved
        if pulled is not None:
            turned += pulled * du
        rows[:, 0, k] = turned * over * (-(ratio**2) / c)
        rows[:, 1, k] = (y * dx - x * dy) / flat
        rows[:, 2, k] = 2 * slants[k - 1] / slant2 - 2 * moved * over
    return rows


def with_other_leg(
    law: Passage,
    time_s: FloatArray,
    parameters: FloatArray,
    change: tuple[FloatArray, FloatArray, FloatArray],
    sound_speed_mps: float,
    height_m: FloatArray | float,
) -> Passage:
    """Return a passage whose velocity was, or became, another one at some instant.

    On the other side of that instant the source moves with the velocity of the passage
    plus a difference, from the place where the passage has it then. The retarded time
    of each leg has a closed form: its source is in uniform motion.

    Parameters
    ----------
    law
        The straight passage with the partials by the depth difference, rows of shape
        (batch, 3, 5, n).
    time_s
        Reception times in seconds, shape (n,).
    parameters
        Rows of (t0 in s, ln of d_h/v in s, v in m/s), shape (batch, 3).
    change
        Instant in s, +1 where the other leg follows it and -1 where it goes before,
        shapes (batch,), and the difference of velocity along the course and away from
        the sensor at closest approach, m/s, shape (batch, 2).
    sound_speed_mps
        Sound speed in m/s.
    height_m
        Difference of the depths of sensor and source in metres, shape () or (batch,).

    Returns
    -------
    Passage
        Rows of shape (batch, 3, 7, n): the partials by both differences at the end.
    """
    c = sound_speed_mps
    t0, log_q, v = (parameters[:, k, None] for k in range(3))
    at, sign, (more, away) = change[0][:, None], change[1], change[2].T[:, :, None]
    z = np.broadcast_to(height_m, t0.shape[:1])[:, None]
    q = np.exp(log_q)
    along, across = v * (at - t0), q * v
    fast = v + more
    lag = time_s - at
    square = along**2 + across**2 + z**2
    rate = along * fast + across * away
    short = c**2 - fast**2 - away**2
    middle = c**2 * lag + rate
    root = middle**2 - short * (c**2 * lag**2 - square)
    u = (middle - np.sqrt(np.maximum(root, 0.0))) / short
    # by each unknown: place at the instant (x, y), depth difference, velocity (x, y)
    zero, one = np.zeros_like(t0), np.ones_like(t0)
    partials = (
        (-v, zero, zero, zero, zero), (zero, across, zero, zero, zero),
        (at - t0, q, zero, one, zero), (zero, zero, one, zero, zero),
        (zero, zero, zero, one, zero), (zero, zero, zero, zero, one),
    )  # fmt: skip
    emitted = Emitted(
        (along + fast * u, across + away * u, z), (fast, away), None,
        [(px + vx * u, py + vy * u, pz, vx, vy) for px, py, pz, vx, vy in partials],
        (across**2 + z**2, (zero, across**2, across * q, z, zero, zero)),
    )  # fmt: skip
    other = received_rows(emitted, c)
    heard = np.sqrt(square) / c
    is_other = (lag - heard) * sign[:, None] > 0
    rows = np.zeros_like(other)
    rows[:, :, :5] = law.rows
    return Passage(np.where(is_other[:, None, None], other, rows))
