"""Wander of a frequency: a smooth random walk about its rest value.

**Method.** The fractional deviation is a stationary first-order Gauss-Markov process
at knots a sixteenth of the correlation time apart, and linear between them; its
integral, which the phase needs, is then exact. A longer wander begins like a shorter
one of the same seed.

**References.** A. Papoulis, Probability, Random Variables and Stochastic Processes,
section 10-3 (Gauss-Markov process).
"""

from dataclasses import dataclass
from itertools import accumulate

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
    memory = float(np.exp(-step / correlation_s))
    white = np.random.default_rng(seed).standard_normal(count)
    white[1:] *= np.sqrt(1.0 - memory**2)
    walk = accumulate(white.tolist(), lambda last, new: memory * last + new)
    deviation = fraction * np.fromiter(walk, np.float64, count)
    areas = 0.5 * step * (deviation[:-1] + deviation[1:])
    return Drift(first_s, step, deviation, np.concatenate([[0.0], np.cumsum(areas)]))
