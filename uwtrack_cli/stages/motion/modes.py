"""What one mode says: numbers, deviations, intervals, observability."""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.estimation.target_motion.coordinates import (
    state_jacobian,
    to_motion,
    to_state,
)
from uwtrack_cli.estimation.target_motion.information import (
    Information,
    information,
)
from uwtrack_cli.estimation.target_motion.marquardt import Limits, minimise
from uwtrack_cli.estimation.target_motion.modes import Modes
from uwtrack_cli.estimation.target_motion.objective import normal_blocks, residuals
from uwtrack_cli.estimation.target_motion.observability import Observability, assess
from uwtrack_cli.estimation.target_motion.problem import Problem
from uwtrack_cli.estimation.target_motion.regions import Interval, profile_interval
from uwtrack_cli.estimation.target_motion.solvers import SolverName
from uwtrack_cli.stages.motion.policies import Misfit, MotionModel, Search


@dataclass(frozen=True, eq=False)
class Analysis:
    """Everything that an analysis needs besides the measurements."""

    navigation: Navigation | None
    solver: SolverName
    array_heading: str
    fixed_heading_deg: float | None
    compass_std_deg: float
    height_m: float
    sound_speed_mps: float
    delayed: bool
    updates: int
    seed: int
    misfit: Misfit
    model: MotionModel
    search: Search


@dataclass(frozen=True, eq=False)
class ModeAnswer:
    """What is known of one mode; the covariance is that of people's parameters.

    ``at_limit_m`` is the limit of the search that stopped the range, if one did.
    """

    q: FloatArray
    rest_hz: FloatArray
    value: float
    weight: float
    covariance: FloatArray
    solver_covariance: FloatArray
    now: FloatArray
    now_std: FloatArray
    observability: Observability
    intervals: dict[str, Interval]
    range_per_sound_speed: float
    at_limit_m: float | None


def describe_mode(
    problem: Problem,
    limits: Limits,
    modes: Modes,
    index: int,
    analysis: Analysis,
    *,
    scale: float,
) -> ModeAnswer:
    """Work out what one mode says of the target.

    Parameters
    ----------
    problem
        The measurements.
    limits
        Bounds of the search.
    modes
        All modes.
    index
        Which of them.
    analysis
        Options.
    scale
        Scale of likelihood ratios under the loss, 1 for least squares.
    """
    from scipy.special import chdtri

    q = modes.q[index]
    found = information(problem, q)
    inner = found.covariance(people=False)
    inner = inner + _compass_share(problem, q, found, analysis.compass_std_deg)
    covariance = found.turn @ inner @ found.turn.T
    now, now_std = _last_position(problem, q, inner)
    rise = scale * float(chdtri(1, 1.0 - analysis.search.confidence))
    return ModeAnswer(
        q=q,
        rest_hz=modes.rest_hz[index],
        value=float(modes.value[index]),
        weight=float(modes.weight[index]),
        covariance=covariance,
        solver_covariance=inner,
        now=now,
        now_std=now_std,
        observability=assess(found, to_motion(q)),
        intervals=_intervals(problem, q, covariance, limits, rise),
        range_per_sound_speed=_sound_speed_effect(problem, q, limits),
        at_limit_m=_limit_met(q, limits),
    )


def _limit_met(q: FloatArray, limits: Limits) -> float | None:
    """Return the limit of the range that stopped the fit, m; None if none did."""
    for limit in (limits.lower[0], limits.upper[0]):
        if abs(q[0] - limit) < 1e-6:
            return float(np.exp(limit))
    return None


def _compass_share(
    problem: Problem, q: FloatArray, found: Information, compass_std_deg: float
) -> FloatArray:
    """Covariance from one error shared by all bearings, in solver coordinates."""
    size = len(found.bread)
    if compass_std_deg == 0.0 or not (problem.bearing_weight > 0).any():
        return np.zeros((size, size))
    r = residuals(problem, q[np.newaxis])
    shifted = replace(
        r, bearing=np.broadcast_to(problem.bearing_weight, r.bearing.shape)
    )
    pull = normal_blocks(replace(problem, loss="squares"), shifted)
    still = normal_blocks(
        replace(problem, loss="squares"), replace(shifted, bearing=0.0 * r.bearing)
    )
    gradient = np.zeros(size)
    gradient[:4] = (
        state_jacobian(q[np.newaxis])[0].T @ (pull.gradient - still.gradient)[0]
    )
    shift = np.linalg.pinv(found.bread) @ gradient * np.radians(compass_std_deg)
    return np.outer(shift, shift)


def _last_position(
    problem: Problem, q: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Range and bearing at the last measurement, with deviations."""
    track = problem.track
    node = track.now[-1]
    time = track.time_s[node]
    state = to_state(q)
    east = state[0] + state[2] * time - track.east_m[node]
    north = state[1] + state[3] * time - track.north_m[node]
    distance = np.hypot(east, north)
    sight = np.array([
        [east, north, time * east, time * north],
        [north / distance, -east / distance, time * north / distance,
         -time * east / distance],
    ]) / distance  # fmt: skip
    jacobian = sight @ state_jacobian(q[np.newaxis])[0]
    variance = np.diagonal(jacobian @ covariance[:4, :4] @ jacobian.T)
    bearing = np.mod(np.arctan2(east, north), 2.0 * np.pi)
    return np.array([distance, bearing]), np.sqrt(np.maximum(variance, 0.0))


def _intervals(
    problem: Problem,
    q: FloatArray,
    covariance: FloatArray,
    limits: Limits,
    rise: float,
) -> dict[str, Interval]:
    motion = to_motion(q)
    std = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    first_steps = {
        "range": (0, min(float(std[0] / motion[0]), 1.0)),
        "speed": (2, min(float(std[2]), float(limits.upper[2]) / 2.0)),
        "course": (3, min(float(std[3]), 0.8)),
    }
    return {
        name: profile_interval(problem, q, axis, max(step, 1e-6), limits, rise=rise)
        for name, (axis, step) in first_steps.items()
    }


def _sound_speed_effect(problem: Problem, q: FloatArray, limits: Limits) -> float:
    """Relative change of range when the assumed sound speed is 1 % higher."""
    other = replace(problem, sound_speed_mps=1.01 * problem.sound_speed_mps)
    moved = minimise(other, q[np.newaxis], limits, iterations=20)
    return float((moved.q[0, 0] - q[0]) / np.log(1.01))
