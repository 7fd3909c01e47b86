"""Whether one sensor's bearings were written by another convention than the others'.

**Method.** Bearings of three or more sensors cross. Where most of one sensor's miss the
motion that was found, the motion is sought from the others alone, and that sensor's bearings
are compared with it as they stand and by each convention that tables have by mistake. A
sensor is named if the others agree, its own bearings do not, and by a convention they do;
of several such sensors the one whose bearings then fit best, if it is clearly the best.

**Conventions.** A bearing counts as missed beyond a number of deviations, after the sensor's
offset, an unknown with its prior, is taken out.
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.motion.target_motion.objective import loss_value, residuals
from uwtrack_cli.motion.target_motion.problem import Problem
from uwtrack_cli.motion.target_motion.solvers.marquardt import SearchBounds
from uwtrack_cli.motion.target_motion.starts import multistart

RADIANS = float(np.degrees(1.0))

CONVENTIONS = {
    "from the target to the sensor": (1.0, np.pi),
    "counter-clockwise from east": (-1.0, 0.5 * np.pi),
    "counter-clockwise from north": (-1.0, 0.0),
    "in radians": (RADIANS, 0.0),
}
"""Factor and shift, rad, that make a compass bearing of what was written."""

LARGEST_AS_DEGREES = 2.0 * np.pi * np.radians(1.0) + 1e-6
"""Largest bearing, rad, that may have been radians read as degrees."""

COARSEST = 3.0
"""Deviation of a sensor in radians, in those of the other sensors, up to which its scatter is
that of the same kind of bearings."""

FEWEST_SENSORS, FEWEST_BEARINGS = 3, 5
"""Sensors, and bearings of one, from which a convention can be told."""

MISSED = 4.0
"""Deviations beyond which a bearing misses."""

FEW, MANY = 0.3, 0.7
"""Shares of missed bearings of a sensor that agrees, and of one that does not."""

SUSPICIOUS = 0.4
"""Share of missed bearings of a sensor at the motion found, from which others are sought."""

LEAST_GAIN, LEAST_LEAD = 40.0, 20.0
"""What a convention must gain in the robust misfit, and be ahead of any other sensor's."""


@dataclass(frozen=True)
class Convention:
    """A sensor whose bearings fit by another convention."""

    sensor: int
    """Number of the sensor, from 0."""
    name: str
    """How its bearings seem to count."""


def other_convention(problem: Problem, limits: SearchBounds, q: FloatArray) -> Convention | None:
    """Return the sensor whose bearings seem to count otherwise; None if there is none.

    Every row of the problem, of several sensors, has its full weight.
    """
    count = np.count_nonzero(problem.bearing_weight, axis=1)
    if (
        count.size < FEWEST_SENSORS
        or count.min() < FEWEST_BEARINGS
        or problem.array_heading_rad is not None
    ):
        return None
    robust = replace(problem, loss="student")
    if _missed(robust, q).max() < SUSPICIOUS:
        return None
    plain = float(multistart(robust, limits).value[0])
    found: list[tuple[float, Convention]] = []
    for sensor in range(count.size):
        kept = np.arange(count.size) != sensor
        weight = problem.bearing_weight * kept[:, np.newaxis]
        motion = multistart(replace(robust, bearing_weight=weight), limits).q[0]
        missed = _missed(robust, motion)
        if missed[sensor] < MANY or missed[kept].max() > FEW:
            continue
        for name in CONVENTIONS:
            other = _as_counted(robust, sensor, name)
            if other is not None and _missed(other, motion)[sensor] <= FEW:
                found.append((_value(other, motion), Convention(sensor, name)))
    if not found:
        return None
    found.sort(key=lambda one: one[0])
    value, best = found[0]
    rivals = [other for other, one in found if one.sensor != best.sensor]
    is_clear = not rivals or rivals[0] - value > LEAST_LEAD
    return best if is_clear and plain - value > LEAST_GAIN else None


def _as_counted(problem: Problem, sensor: int, name: str) -> Problem | None:
    """Return the problem as a sensor's convention has it; None where that cannot be.

    Deviations that came from the scatter of radians are those of radians, too, and then
    such as the others have. What the likelihood gains by a larger deviation, it loses by
    the change of units: the misfits of both problems compare as they stand.
    """
    factor, shift = CONVENTIONS[name]
    bearing, weight = problem.bearing_rad.copy(), problem.bearing_weight.copy()
    own = wrap_rad(bearing[:, sensor])
    weight[sensor] /= abs(factor)
    if factor == RADIANS:
        usual = [np.median(each[each > 0]) for each in np.delete(weight, sensor, axis=0)]
        is_coarse = COARSEST * np.median(weight[sensor][weight[sensor] > 0]) < min(usual)
        if is_coarse or np.any(np.abs(own) > LARGEST_AS_DEGREES):
            return None
    bearing[:, sensor] = factor * own + shift
    return replace(problem, bearing_rad=bearing, bearing_weight=weight)


def _missed(problem: Problem, q: FloatArray) -> FloatArray:
    """Return the share of the bearings of each sensor that miss a motion."""
    z = np.abs(residuals(problem, q[np.newaxis]).bearing[0])
    heard = problem.bearing_weight > 0
    count = np.maximum(heard.sum(axis=1), 1)
    return np.asarray(((z > MISSED) & heard).sum(axis=1) / count)


def _value(problem: Problem, q: FloatArray) -> float:
    """Return the robust misfit of a motion."""
    r = residuals(problem, q[np.newaxis])
    return float(loss_value(r.bearing, problem.loss).sum() + r.prior_value(problem)[0])
