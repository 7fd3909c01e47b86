"""Bearings of a target that is at the very place of the sensor, as far as anybody knows.

**Method.** A fit follows straight lines: a place that is wrong by s moves a bearing at range r
by s / r. Where s, by all other rows, is larger than r, the bearing is anything, and the line is
none: a way through the very place of a sensor fits such a row, seems to be known to
centimetres, and leaves nothing for the rest. Such rows are found by the deviation that the
others give, and are left out; that the target passes there, its bearings before and after
say.
"""

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.motion.target_motion.model import state_jacobian, to_state
from uwtrack_cli.motion.target_motion.objective import misfit
from uwtrack_cli.motion.target_motion.problem import Problem, without_rows

NEAR = 0.1
"""Range, in the median of all, below which a row may be one of these."""


def near_rows(problem: Problem, q: FloatArray) -> BoolArray:
    """Return the rows whose range is not known to be more than its own deviation."""
    track = problem.track
    own = np.stack([track.east_m, track.north_m])[:, track.now]
    state, time = to_state(q), problem.row_time_s
    range_m = np.hypot(*(state[:2, np.newaxis] + state[2:, np.newaxis] * time - own))
    heard = (problem.bearing_weight > 0).any(axis=0)
    suspect: BoolArray = heard & (range_m < NEAR * np.median(range_m))
    if not suspect.any():
        return suspect
    # the others' deviation of the place at every row
    matrix = misfit(without_rows(problem, suspect), q[np.newaxis]).matrix[0]
    jacobian = state_jacobian(q[np.newaxis])[0]
    spread = jacobian @ np.linalg.pinv(matrix, hermitian=True) @ jacobian.T
    place, cross, rate = spread[:2, :2], spread[:2, 2:], spread[2:, 2:]
    variance = np.trace(place) + 2.0 * time * np.trace(cross) + time**2 * np.trace(rate)
    return np.asarray(suspect & (range_m**2 < 0.5 * variance))
