"""Wander of a frequency: a smooth random walk about its rest value.

**Method.** The fractional deviation is a stationary first-order Gauss-Markov process
at knots a sixteenth of the correlation time apart, and linear between them; its
integral, which the phase needs, is then exact. The knots come from one circular
filtering of white noise, ten correlation times longer than needed.

**References.** A. Papoulis, Probability, Random Variables and Stochastic Processes,
section 10-3 (Gauss-Markov process).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Drift:
    """A wandering frequency; ``fraction`` is its relative standard deviation."""

    start_s: float
    step_s: float
    deviation: Array
    integral_s: Array

    def excess_s(self, time_s: Array) -> Array:
        """Return the integral of the fractional deviation up to each time, s."""
        place = (time_s - self.start_s) / self.step_s
        knot = np.clip(place.astype(np.int64), 0, self.deviation.size - 2)
        past = (place - knot) * self.step_s
        here = self.deviation[knot]
        slope = (self.deviation[knot + 1] - here) / (2.0 * self.step_s)
        return np.asarray(self.integral_s[knot] + past * (here + past * slope))


def drift(
    seed: tuple[int, ...],
    fraction: float,
    correlation_s: float,
    first_s: float,
    last_s: float,
) -> Drift:
    """Draw a wander that covers the times from first to last."""
    step = correlation_s / 16.0
    count = int(np.ceil((last_s - first_s) / step)) + 2
    size = count + 160
    memory = np.exp(-step / correlation_s)
    white = np.random.default_rng(seed).standard_normal(size)
    angle = 2j * np.pi * np.arange(size // 2 + 1) / size
    spectrum = np.fft.rfft(white) / (1.0 - memory * np.exp(-angle))
    walk = np.fft.irfft(spectrum, size)[:count]
    deviation = fraction * np.sqrt(1.0 - memory**2) * walk
    areas = 0.5 * step * (deviation[:-1] + deviation[1:])
    return Drift(first_s, step, deviation, np.concatenate([[0.0], np.cumsum(areas)]))
