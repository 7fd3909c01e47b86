"""From when to when: the exact travel time between two moving things.

**Method.** The sound heard at t left the source at u, where c (t - u) is the distance
between the receiver at t and the source at u. Newton's iteration solves this at the
nodes of a grid; between nodes the delay follows the cubic with the exact slopes
du/dt = (1 - n.v_r/c) / (1 - n.v_s/c). The grid is halved until the cubic meets the
exact solution halfway between nodes to 1e-10 s.

**Conventions.** Seconds from the first sample; n points from source to receiver.
Depth is constant; a surface image is a source at negative depth.

**References.** L. D. Landau, E. M. Lifshitz, The Classical Theory of Fields, section
62 (retarded times); the same geometry for sound, M << 1 not required.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.errors import DataError
from uwtrack_cli.simulate.motion import Motion

Array = NDArray[np.float64]

TOLERANCE_S = 1e-10
"""Largest error of the interpolated delay halfway between nodes, s."""

NEAREST_M = 0.5
"""A source nearer than this to a sensor is refused: its level would diverge, m."""

FIRST_STEP = 256
"""Samples between the nodes of the first grid; a power of two."""


@dataclass(frozen=True)
class Path:
    """A way of the sound from a source to a receiver."""

    source: Motion
    source_depth_m: float
    receiver: Motion
    receiver_depth_m: float
    sound_speed_mps: float

    def solve(self, time_s: Array) -> tuple[Array, Array, Array, Array]:
        """Return delay (s), its rate, and the cosines east and north to the source."""
        east, north, east_rate, north_rate = self.receiver.at(time_s)
        down = self.receiver_depth_m - self.source_depth_m
        c = self.sound_speed_mps
        delay = np.zeros_like(time_s)
        for _ in range(40):
            s_east, s_north, s_east_rate, s_north_rate = self.source.at(time_s - delay)
            d_east, d_north = s_east - east, s_north - north
            distance = np.sqrt(d_east**2 + d_north**2 + down**2)
            if np.any(distance < NEAREST_M):
                msg = f"a source comes nearer than {NEAREST_M} m to a sensor."
                raise DataError(msg)
            east_cosine, north_cosine = d_east / distance, d_north / distance
            closing = -(east_cosine * s_east_rate + north_cosine * s_north_rate) / c
            step = (distance / c - delay) / (1.0 - closing)
            delay = delay + step
            if np.all(np.abs(step) <= 4e-16 * (1.0 + np.abs(delay))):
                break
        heard = (east_cosine * east_rate + north_cosine * north_rate) / c
        rate = 1.0 - (1.0 + heard) / (1.0 - closing)
        return delay, rate, east_cosine, north_cosine

    def along(
        self, first_sample: int, count: int, sample_rate_hz: float
    ) -> tuple[Array, Array, Array]:
        """Return delay (s) and the two cosines for consecutive samples.

        ``count`` is a multiple of `FIRST_STEP`, so that nodes fall on samples.
        """
        step, done = FIRST_STEP, False
        values = self.solve(
            (first_sample + np.arange(0, count + step, step)) / sample_rate_hz
        )
        while step > 1 and not done:
            middle = np.arange(step // 2, count, step)
            exact = self.solve((first_sample + middle) / sample_rate_hz)
            guess = _hermite(values[0], values[1] * step / sample_rate_hz, 2)[1::2]
            done = bool(np.max(np.abs(guess - exact[0])) <= TOLERANCE_S)
            values = (
                _interleave(values[0], exact[0]),
                _interleave(values[1], exact[1]),
                _interleave(values[2], exact[2]),
                _interleave(values[3], exact[3]),
            )
            step //= 2
        delay = _hermite(values[0], values[1] * step / sample_rate_hz, step)
        return delay, _linear(values[2], step), _linear(values[3], step)


def _interleave(nodes: Array, middles: Array) -> Array:
    both = np.empty(nodes.size + middles.size)
    both[::2], both[1::2] = nodes, middles
    return both


def _hermite(values: Array, slopes: Array, parts: int) -> Array:
    """Divide every interval (slopes per interval) into parts along the cubic."""
    x = np.arange(parts) / parts
    rise = np.diff(values)[:, None]
    first, last = slopes[:-1, None], slopes[1:, None]
    bend = 3.0 * rise - 2.0 * first - last
    twist = first + last - 2.0 * rise
    cubic = values[:-1, None] + x * (first + x * (bend + x * twist))
    return np.asarray(cubic.reshape(-1))


def _linear(values: Array, parts: int) -> Array:
    x = np.arange(parts) / parts
    return np.asarray((values[:-1, None] + x * np.diff(values)[:, None]).reshape(-1))
