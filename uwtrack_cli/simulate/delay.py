"""The exact travel time of sound between a moving source and a moving receiver.

**Method.** The sound received at t left the source at u, where c (t - u) is the distance
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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.errors import DataError
from uwtrack_cli.simulate.trajectories import Trajectory

Array = NDArray[np.float64]

TOLERANCE_S = 1e-10
"""Largest error of the interpolated delay halfway between nodes, s."""

NEAREST_M = 0.5
"""A source nearer than this to a sensor is refused: its level would diverge, m."""

FIRST_STEP = 256
"""Samples between the nodes of the first grid; a power of two."""


class Delay(NamedTuple):
    """Travel time of the sound, at times of arrival, and where it comes from."""

    delay_s: Array
    """Travel time, s."""
    rate: Array
    """Its derivative in time."""
    east_cosine: Array
    """Cosine of the direction to the source with east."""
    north_cosine: Array
    """Cosine of the direction to the source with north."""


class SampleDelay(NamedTuple):
    """Travel time of the sound for consecutive samples."""

    delay_s: Array
    """Travel time, s."""
    east_cosine: Array
    """Cosine of the direction to the source with east."""
    north_cosine: Array
    """Cosine of the direction to the source with north."""


@dataclass(frozen=True)
class Path:
    """A straight path of the sound from a source to a receiver."""

    source: Trajectory
    """Trajectory of the source."""
    source_depth_m: float
    """Depth of the source, m; negative for its image in the surface."""
    receiver: Trajectory
    """Trajectory of the receiver."""
    receiver_depth_m: float
    """Depth of the receiver, m."""
    sound_speed_mps: float
    """Speed of sound, m/s."""

    def solve(self, time_s: Array) -> "Delay":
        """Return the travel time of what arrives at the given times."""
        east, north, east_rate, north_rate = self.receiver.at(time_s)
        down = self.receiver_depth_m - self.source_depth_m
        c = self.sound_speed_mps
        delay = np.zeros_like(time_s)
        for _ in range(40):
            s_east, s_north, s_east_rate, s_north_rate = self.source.at(time_s - delay)
            d_east, d_north = s_east - east, s_north - north
            distance = np.sqrt(d_east**2 + d_north**2 + down**2)
            if np.any(distance < NEAREST_M):
                raise DataError(f"a source comes nearer than {NEAREST_M} m to a sensor.")
            east_cosine, north_cosine = d_east / distance, d_north / distance
            closing = -(east_cosine * s_east_rate + north_cosine * s_north_rate) / c
            step = (distance / c - delay) / (1.0 - closing)
            delay = delay + step
            if np.all(np.abs(step) <= 4e-16 * (1.0 + np.abs(delay))):
                break
        receding = (east_cosine * east_rate + north_cosine * north_rate) / c
        rate = 1.0 - (1.0 + receding) / (1.0 - closing)
        return Delay(delay, rate, east_cosine, north_cosine)

    def along(self, first_sample: int, count: int, sample_rate_hz: float) -> "SampleDelay":
        """Return the travel time of consecutive samples.

        ``count`` is a multiple of `FIRST_STEP`, so that nodes fall on samples.
        """
        step, done = FIRST_STEP, False
        values = self.solve((first_sample + np.arange(0, count + step, step)) / sample_rate_hz)
        while step > 1 and not done:
            middle = np.arange(step // 2, count, step)
            exact = self.solve((first_sample + middle) / sample_rate_hz)
            slope = values.rate * step / sample_rate_hz
            guess = _hermite(values.delay_s, slope, 2)[1::2]
            done = bool(np.max(np.abs(guess - exact.delay_s)) <= TOLERANCE_S)
            values = Delay(*map(_interleave, values, exact))
            step //= 2
        return SampleDelay(
            _hermite(values.delay_s, values.rate * step / sample_rate_hz, step),
            _linear(values.east_cosine, step),
            _linear(values.north_cosine, step),
        )


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
