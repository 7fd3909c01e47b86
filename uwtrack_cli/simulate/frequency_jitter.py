"""Variation of a frequency about its rest value: random, in steps, by gear changes.

**Method.** The random fractional deviation is a stationary first-order Gauss-Markov process
at knots a sixteenth of the correlation time apart, and linear between them; its
integral, which the phase needs, is then exact. A longer series begins like a shorter
one of the same seed.

**References.** A. Papoulis, Probability, Random Variables and Stochastic Processes,
section 10-3 (Gauss-Markov process).
"""

from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.simulate.vessels import GearChange

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class JitterSeries:
    """A drawn course of the relative deviation of a frequency."""

    start_s: float
    """Time of the first knot, s."""
    step_s: float
    """Time between knots, s."""
    deviation: Array
    """Relative deviation of the frequency at each knot."""
    integral_s: Array
    """Its integral from the first knot to each knot, s."""

    def excess_s(self, time_s: Array) -> Array:
        """Return the integral of the fractional deviation up to each time, s."""
        place = (time_s - self.start_s) / self.step_s
        knot = np.clip(place.astype(np.int64), 0, self.deviation.size - 2)
        past = (place - knot) * self.step_s
        here = self.deviation[knot]
        slope = (self.deviation[knot + 1] - here) / (2.0 * self.step_s)
        return np.asarray(self.integral_s[knot] + past * (here + past * slope))

    def at(self, time_s: Array) -> Array:
        """Return the relative deviation at each time."""
        knots_s = self.start_s + self.step_s * np.arange(self.deviation.size)
        return np.interp(time_s, knots_s, self.deviation)


@dataclass(frozen=True, eq=False)
class SpeedCourse:
    """Relative deviation of a frequency, linear between given times."""

    time_s: Array
    """Times of the knots, s, increasing; two or more."""
    deviation: Array
    """Relative deviation at each knot; constant before the first and after the last."""

    def excess_s(self, time_s: Array) -> Array:
        """Return the integral of the deviation from the first knot to each time, s."""
        step = np.diff(self.time_s)
        areas = 0.5 * step * (self.deviation[1:] + self.deviation[:-1])
        total = np.concatenate([[0.0], np.cumsum(areas)])
        knot = np.clip(np.searchsorted(self.time_s, time_s, side="right") - 1, 0, step.size - 1)
        past = np.clip(time_s - self.time_s[knot], 0.0, step[knot])
        slope = (self.deviation[knot + 1] - self.deviation[knot]) / step[knot]
        inside = total[knot] + past * (self.deviation[knot] + 0.5 * slope * past)
        before = np.minimum(time_s - self.time_s[0], 0.0) * self.deviation[0]
        after = np.maximum(time_s - self.time_s[-1], 0.0) * self.deviation[-1]
        return np.asarray(inside + before + after)


def gear_course(changes: tuple[GearChange, ...]) -> SpeedCourse | None:
    """Return the course of a shaft through its gear changes; None without one."""
    if not changes:
        return None
    times, deviations = [changes[0].at_s - 1.0], [0.0]
    for change in changes:
        end = change.factor - 1.0
        peak = change.factor * (1.0 + change.revving) - 1.0
        if not change.revving:
            peak = 0.5 * (deviations[-1] + end)
        times += [change.at_s + share * change.duration_s for share in (0.0, 0.5, 1.0)]
        deviations += [deviations[-1], peak, end]
    return SpeedCourse(np.array(times), np.array(deviations))


def draw_jitter(
    seed: tuple[int, ...], fraction: float, correlation_s: float, first_s: float, last_s: float
) -> JitterSeries:
    """Draw a series that covers the times from first to last.

    ``fraction``: standard deviation of the relative frequency. ``correlation_s``:
    correlation time, s. ``first_s``: first time, s. ``last_s``: last time, s.
    """
    step = correlation_s / 16.0
    count = int(np.ceil((last_s - first_s) / step)) + 2
    decay = float(np.exp(-step / correlation_s))
    white = np.random.default_rng(seed).standard_normal(count)
    white[1:] *= np.sqrt(1.0 - decay**2)
    walk = accumulate(white.tolist(), lambda last, new: decay * last + new)
    deviation = fraction * np.fromiter(walk, np.float64, count)
    areas = 0.5 * step * (deviation[:-1] + deviation[1:])
    return JitterSeries(first_s, step, deviation, np.concatenate([[0.0], np.cumsum(areas)]))
