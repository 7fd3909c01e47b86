"""Sound of the ship that tows the array, which is no target.

**Method.** The place of the own ship is known at every time, so its sound is a hypothesis
without unknowns but the rest frequencies. It is weighed against the best motion of a
target, whose four unknowns pay a price (Schwarz 1978, Ann. Stat. 6, 461). The deviations
are those that were measured: what a wrong motion leaves must not widen them.
"""

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.motion.target_motion.model import STRAIGHT
from uwtrack_cli.motion.target_motion.objective import bearing_errors, loss_value
from uwtrack_cli.motion.target_motion.own_ship import OwnPath
from uwtrack_cli.motion.target_motion.problem import Problem

RATE_SPAN_S = 1.0
"""Time over which the range of the own ship changes, s."""


def is_own_noise(
    problem: Problem, array: OwnPath, ship: OwnPath, time_s: FloatArray, best: float
) -> bool:
    """Return whether a contact is likelier the ship that tows its array than a target.

    ``array`` and ``ship`` are the ways of both, in the clock of the times, s, of the rows;
    ``best`` is the misfit of the best motion of a target.
    """
    price = STRAIGHT * np.log(max(problem.n_values, 1))
    return bool(own_misfit(problem, array, ship, time_s) < best + price)


def own_misfit(problem: Problem, array: OwnPath, ship: OwnPath, time_s: FloatArray) -> float:
    """Return the misfit of the own ship's place; inf where the array has no heading."""
    heading = problem.array_heading_rad
    if heading is None:
        return np.inf
    east, north, range_m = _sight(array, ship, time_s, problem.height_m)
    earlier = _sight(array, ship, time_s - RATE_SPAN_S, problem.height_m)
    rate_mps = (range_m - earlier[2]) / RATE_SPAN_S
    # the ship is near: the cone is that to a source above the array
    cosine = np.cos(np.arctan2(east, north) - heading) * np.hypot(east, north) / range_m
    bearing = heading + np.arccos(np.clip(cosine, -1.0, 1.0))
    off, _ = bearing_errors(problem, bearing[np.newaxis], problem.bearing_rad[:1])
    shape, data = 1.0 - rate_mps / problem.sound_speed_mps, problem.frequency_hz[0]
    weight = problem.frequency_weight
    below = np.maximum((weight**2 * shape**2).sum(1), 1e-300)
    rest_hz = (weight**2 * shape * data).sum(1) / below
    miss = (rest_hz[:, np.newaxis] * shape - data) * weight
    total = loss_value(off[0] * problem.bearing_weight, problem.loss).sum()
    return float(total + loss_value(miss, problem.loss).sum())


def _sight(
    array: OwnPath, ship: OwnPath, time_s: FloatArray, height_m: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the way to the ship east and north, and its slant range, m."""
    east, north = (
        there - here for there, here in zip(ship.at(time_s), array.at(time_s), strict=True)
    )
    return east, north, np.maximum(np.sqrt(east**2 + north**2 + height_m**2), 1e-6)
