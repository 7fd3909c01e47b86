"""Likelihood-ratio intervals, for when an ellipse does not tell the truth.

**Method.** The 95 % interval of a quantity holds the values for which the best fit
of everything else is worse by no more than the chi-square quantile of one degree of
freedom (Cox & Hinkley 1974, ch. 9). The profile is followed outwards in steps of the
Laplace deviation with one batched descent, and interpolated at the crossing. An
interval that meets the limits of the search is open on that side.

**Conventions.** Under a robust loss, or with estimated deviations, the rise of the
misfit is divided by ``scale`` (Wilks' statistic of an M-estimate).
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.target_motion.coordinates import to_polar
from uwtrack_cli.estimation.target_motion.marquardt import Limits, minimise
from uwtrack_cli.estimation.target_motion.problem import Problem

STEPS = 12
"""Points of the profile on each side."""


@dataclass(frozen=True)
class Interval:
    """A likelihood-ratio interval and whether the search limits cut it."""

    low: float
    high: float
    open_low: bool
    open_high: bool

    @property
    def is_open(self) -> bool:
        """Whether either side is cut by the limits."""
        return self.open_low or self.open_high


def profile_interval(
    problem: Problem,
    q: FloatArray,
    coordinate: int,
    deviation: float,
    limits: Limits,
    *,
    rise: float,
) -> Interval:
    """Find where the profile likelihood of one coordinate has fallen by ``rise``.

    Parameters
    ----------
    problem
        One record.
    q
        The minimum in solver coordinates.
    coordinate
        0 for ln R, 1 bearing, 2 speed, 3 course.
    deviation
        Its Laplace deviation, the first guess of the width.
    limits
        Bounds of the search.
    rise
        Rise of the misfit at the ends of the interval.
    """
    polar = coordinate >= 2
    centre = to_polar(q) if polar else q.copy()
    bounds = _bounds(limits, polar=polar)
    low, open_low = _side(
        problem, centre, coordinate, -deviation, bounds, rise=rise, polar=polar
    )
    high, open_high = _side(
        problem, centre, coordinate, deviation, bounds, rise=rise, polar=polar
    )
    return Interval(low, high, open_low, open_high)


def _bounds(limits: Limits, *, polar: bool) -> Limits:
    if not polar:
        return limits
    lower, upper = limits.lower.copy(), limits.upper.copy()
    lower[2], lower[3], upper[3] = 0.0, -np.inf, np.inf
    upper[2] *= np.sqrt(2.0)
    return Limits(lower, upper)


def _side(
    problem: Problem,
    centre: FloatArray,
    coordinate: int,
    deviation: float,
    bounds: Limits,
    *,
    rise: float,
    polar: bool,
) -> tuple[float, bool]:
    """Follow the profile to one side: the crossing, and whether it was cut."""
    ends = (bounds.lower, bounds.upper)[int(deviation > 0)][coordinate]
    reach = 2.0 * np.sqrt(rise) * deviation
    room = ends - centre[coordinate] if np.isfinite(ends) else np.sign(reach) * np.pi
    start, base, done = centre, 0.0, 0.0
    for _ in range(6):
        reach = reach if abs(reach) < abs(room) else room
        share = np.linspace(0.0, 1.0, STEPS + 1)
        value = done + (reach - done) * share
        trials = np.repeat(start[np.newaxis], value.size, axis=0)
        trials[:, coordinate] = centre[coordinate] + value
        fit = minimise(
            problem, trials, bounds, held=(coordinate,), polar=polar, iterations=25,
            tolerance=1e-7,
        )  # fmt: skip
        if done == 0.0:
            base = float(fit.value[0])
        over = np.flatnonzero(fit.value - base > rise)
        if over.size:
            return _crossing(centre[coordinate] + value, fit.value - base, rise), False
        if reach == room:
            return float(centre[coordinate] + room), True
        start, done, reach = fit.q[-1], reach, 3.0 * reach
    return float(centre[coordinate] + done), True


def _crossing(place: FloatArray, excess: FloatArray, rise: float) -> float:
    """Interpolate the square root of the excess, linear for a parabola."""
    last = int(np.flatnonzero(excess > rise)[0])
    if last == 0:
        return float(place[0])
    root = np.sqrt(np.maximum(excess[last - 1 : last + 1], 0.0))
    share = (np.sqrt(rise) - root[0]) / max(root[1] - root[0], 1e-300)
    return float(place[last - 1] + share * (place[last] - place[last - 1]))
