"""What a sensor receives from a source that turns evenly for a while.

**Method.** The course changes by an angle a within a duration T about an instant m, at
one rate and one speed; before and after it the source goes straight. With the rate
w = a / T, the time in the turn C(s), which is s held between m - T/2 and m + T/2, and
the instant t0 of closest approach, the place at a time of emission u is, along the
course at t0 as the real part and away from the sensor as the imaginary one::

    p(u) = i q v + v * integral of exp(i w (C(s) - C(t0))) ds from t0 to u

which has closed forms on every piece. The time of emission follows from that of
reception by Newton's method.

**Conventions.** As in `law`: q is the horizontal range over speed, s, and v the speed,
m/s. Partials are with respect to (t0, ln q, v, depth difference, a, T, m).

**References.** Li and Jilkov (2003), IEEE Trans. Aerosp. Electron. Syst. 39, 1333,
section V-A (nearly coordinated turns).
"""

from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.passage.model.law import SLOWEST_MPS, Emitted, Passage, received_rows

NEWTON_STEPS = 3
"""Steps to the time of emission: each squares an error of a share of the Mach number."""

SMALL_ANGLE = 0.05
"""Angle (rad) below which a difference of exponentials is taken from its series."""

SERIES = (1j / 2, -1 / 3, -1j / 8, 1 / 30, 1j / 144)
"""Partial of the mean of exp(i x) from 0 to x, by powers of x."""


class SteadyTurn(NamedTuple):
    """Turns of a batch."""

    angle_rad: FloatArray
    """Change of course, away from the sensor at closest approach, rad, shape (batch,)."""
    duration_s: FloatArray
    """How long each lasts, s, same shape."""
    middle_s: FloatArray
    """Its middle, s, same shape."""


class _Path(NamedTuple):
    """A path with a turn; arrays of shape (batch, 1)."""

    t0: FloatArray
    """Closest approach, s."""
    q: FloatArray
    """Horizontal range over speed, s."""
    v: FloatArray
    """Speed, m/s."""
    rate: FloatArray
    """Rate of turn, away from the sensor, rad/s."""
    begin: FloatArray
    """Beginning of the turn, s."""
    end: FloatArray
    """Its end, s."""
    held: FloatArray
    """Instant of closest approach, held within the turn."""
    origin: FloatArray
    """Integral of the direction at the closest approach, s."""


def with_steady_turn(
    time_s: FloatArray,
    parameters: FloatArray,
    turn: SteadyTurn,
    sound_speed_mps: float,
    height_m: FloatArray | float,
) -> Passage:
    """Return the passage of a source that turns evenly for a while.

    Parameters
    ----------
    time_s
        Reception times in seconds, shape (n,).
    parameters
        Rows of (t0 in s, ln of d_h/v in s, v in m/s), shape (batch, 3).
    turn
        The turns.
    sound_speed_mps
        Sound speed in m/s.
    height_m
        Difference of the depths of sensor and source in metres, shape () or (batch,).

    Returns
    -------
    Passage
        Rows of shape (batch, 3, 8, n): the partials by angle, duration and middle at the
        end.
    """
    path = _path(parameters, turn)
    z = np.broadcast_to(height_m, path.t0.shape[:1])[:, None]
    # turns by nothing beside one passage have the same times of emission
    is_one = not turn.angle_rad.any() and bool((parameters == parameters[0]).all())
    is_one = is_one and bool((z == z[0]).all())
    own, height = path, z
    if is_one:
        own, height = _Path(*(part[:1] for part in path)), z[:1]
    u = np.repeat(time_s[None], height.shape[0], axis=0)
    for _ in range(NEWTON_STEPS):
        place = _place(own, u)
        toward = _direction(own, u) * own.v
        distance = np.sqrt(abs(place) ** 2 + height**2)
        closing = (place.real * toward.real + place.imag * toward.imag) / distance
        u = u - (u + distance / sound_speed_mps - time_s) / (1 + closing / sound_speed_mps)
    u = np.broadcast_to(u, (z.shape[0], time_s.size))
    place, way = _place(path, u), _direction(path, u)
    is_within = (u > path.begin) & (u < path.end)
    velocity = path.v * way
    bent = 1j * path.rate * velocity
    across = path.q * path.v
    zero = np.zeros_like(path.t0)
    partials = [
        (part.real, part.imag, depth, speed.real, speed.imag)
        for part, speed, depth in _partials(path, u, place, way)
    ]
    acceleration = np.where(is_within, bent, 0.0)
    emitted = Emitted(
        (place.real, place.imag, z), (velocity.real, velocity.imag),
        (acceleration.real, acceleration.imag), partials,
        (across**2 + z**2, (zero, across**2, across * path.q, z, zero, zero, zero)),
    )  # fmt: skip
    return Passage(received_rows(emitted, sound_speed_mps))


def turned_way(
    time_s: FloatArray, closest_s: float, turn: SteadyTurn
) -> tuple[FloatArray, FloatArray]:
    """Return how far a source has come since its closest approach, and where it heads.

    Parameters
    ----------
    time_s
        Times of emission, s, shape (n,).
    closest_s
        Time of the closest approach, s.
    turn
        The turn, one or a batch.

    Returns
    -------
    tuple[FloatArray, FloatArray]
        Way over speed (s) and direction, shape (batch, n): the real part is along the
        course at closest approach, the imaginary one away from the sensor.
    """
    start = np.array([[closest_s, 0.0, 1.0]])
    path = _path(np.repeat(start, turn.angle_rad.size, axis=0), turn)
    times = time_s[None]
    return _integral(path, times) - path.origin, _direction(path, times)


def _path(parameters: FloatArray, turn: SteadyTurn) -> _Path:
    t0, log_q, v = (parameters[:, k, None] for k in range(3))
    v = np.where(v == 0, SLOWEST_MPS, v)
    angle, duration, middle = (value[:, None] for value in turn)
    begin, end = middle - 0.5 * duration, middle + 0.5 * duration
    held = np.clip(t0, begin, end)
    start = _Path(t0, np.exp(log_q), v, angle / duration, begin, end, held, 0.0 * t0)
    return start._replace(origin=_integral(start, t0))


def _mean(rate: FloatArray, lag: FloatArray) -> FloatArray:
    """Return the integral of exp(i rate s) from 0 to a lag."""
    half = 0.5 * rate * lag
    value: FloatArray = lag * np.exp(1j * half) * np.sinc(half / np.pi)
    return value


def _mean_by_rate(rate: FloatArray, lag: FloatArray) -> FloatArray:
    """Return its partial with respect to the rate."""
    x = rate * lag
    large = np.where(np.abs(x) > SMALL_ANGLE, x, 1.0)
    whole = np.exp(1j * large)
    exact = (large * whole + 1j * whole - 1j) / large**2
    near = np.polynomial.polynomial.polyval(x, SERIES)
    value: FloatArray = lag**2 * np.where(np.abs(x) > SMALL_ANGLE, exact, near)
    return value


def _integral(path: _Path, time_s: FloatArray) -> FloatArray:
    """Return the integral of the direction from the beginning of the turn, s."""
    first, last = path.begin - path.held, path.end - path.held
    within = np.clip(time_s, path.begin, path.end) - path.held
    value: FloatArray = (
        np.minimum(time_s - path.begin, 0.0) * np.exp(1j * path.rate * first)
        + _mean(path.rate, within) - _mean(path.rate, first)
        + np.maximum(time_s - path.end, 0.0) * np.exp(1j * path.rate * last)
    )  # fmt: skip
    return value


def _integral_by_rate(path: _Path, time_s: FloatArray) -> FloatArray:
    """Return its partial with respect to the rate, s^2."""
    first, last = path.begin - path.held, path.end - path.held
    within = np.clip(time_s, path.begin, path.end) - path.held
    before = np.minimum(time_s - path.begin, 0.0) * np.exp(1j * path.rate * first)
    after = np.maximum(time_s - path.end, 0.0) * np.exp(1j * path.rate * last)
    value: FloatArray = (
        1j * (first * before + last * after)
        + _mean_by_rate(path.rate, within) - _mean_by_rate(path.rate, first)
    )  # fmt: skip
    return value


def _place(path: _Path, time_s: FloatArray) -> FloatArray:
    """Return the place along the course and away from the sensor, m."""
    value: FloatArray = path.v * (1j * path.q + _integral(path, time_s) - path.origin)
    return value


def _direction(path: _Path, time_s: FloatArray) -> FloatArray:
    within = np.clip(time_s, path.begin, path.end) - path.held
    value: FloatArray = np.exp(1j * path.rate * within)
    return value


def _partials(
    path: _Path, time_s: FloatArray, place: FloatArray, way: FloatArray
) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Return those of place, velocity and depth at a fixed time of emission."""
    v, rate = path.v, path.rate
    velocity, none = v * way, 0.0 * way
    zero, one = np.zeros_like(path.t0), np.ones_like(path.t0)
    first = 1j * path.q * v
    is_near = (path.t0 > path.begin) & (path.t0 < path.end)
    spin = -1j * rate * is_near
    moved = v * (_integral_by_rate(path, time_s) - _integral_by_rate(path, path.t0))
    lag = np.clip(time_s, path.begin, path.end) - path.held
    by_rate = moved, 1j * lag * velocity
    edges = []
    for edge, inside in ((path.begin, 1.0), (path.end, -1.0)):
        # what lies beyond the edge, seen from the closest approach, is turned about it
        is_beyond = inside * (path.t0 - edge) >= 0
        turned = np.where(is_beyond, 1j, -1j) * rate
        later = np.where(is_beyond, inside, -inside) * (time_s - edge) < 0
        turned = np.where(later, turned, 0.0)
        edges.append((turned * (place - _place(path, edge)), turned * velocity))
    duration = path.end - path.begin
    by_duration, by_middle = (
        tuple(size * (end + sign * begin) for begin, end in zip(*edges, strict=True))
        for size, sign in ((0.5, -1.0), (1.0, 1.0))
    )
    by_duration = tuple(
        part - rate / duration * share for part, share in zip(by_duration, by_rate, strict=True)
    )
    return [
        (spin * (place - first) - v + none, spin * velocity, zero),
        (first + none, none, zero),
        (place / v, way, zero),
        (none, none, one),
        (by_rate[0] / duration, by_rate[1] / duration, zero),
        (by_duration[0], by_duration[1], zero),
        (by_middle[0], by_middle[1], zero),
    ]
