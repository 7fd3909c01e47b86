"""Batched Levenberg-Marquardt with bounds kept by an active set.

**Method.** Every trial has its own damping; the normal equations are scaled to unit
diagonal (Marquardt 1963; Fletcher 1971). A coordinate on its bound is frozen while
the descent points outwards, and a step that would cross a bound is taken exactly to
it, with the other coordinates solved again. Plain clipping stalls instead.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.rows import Rows
from uwtrack_cli.motion.target.objective import ProfiledMisfit, misfit
from uwtrack_cli.motion.target.problem import Problem

LARGEST_LOG_STEP = 1.0
"""Largest change of ln R in one step."""


@dataclass(frozen=True, eq=False)
class SearchBounds:
    """Bounds of the solver coordinates (ln R, bearing, vx, vy)."""

    lower: FloatArray
    """Lower bounds of (ln R, bearing, vx, vy), shape (4,)."""
    upper: FloatArray
    """Upper bounds of the same, shape (4,)."""


@dataclass(frozen=True, eq=False)
class DescentResult(Rows):
    """Where trials ended: motion, rest frequencies, misfit and its curvature."""

    q: FloatArray
    """Motions in solver coordinates, shape (trials, 4)."""
    rest_hz: FloatArray
    """Rest frequencies, Hz, shape (trials, lines)."""
    value: FloatArray
    """Misfit, shape (trials,)."""
    matrix: FloatArray
    """Gauss-Newton matrix of the misfit, shape (trials, 4, 4)."""


def search_bounds(range_m: tuple[float, float], speed_mps: float) -> SearchBounds:
    """Return the bounds for a span of ranges and a largest speed per component."""
    low, high = np.log(range_m[0]), np.log(range_m[1])
    return SearchBounds(
        np.array([low, -np.inf, -speed_mps, -speed_mps]),
        np.array([high, np.inf, speed_mps, speed_mps]),
    )


def minimise(
    problem: Problem,
    start: FloatArray,
    limits: SearchBounds,
    *,
    member: IntArray | None = None,
    held: tuple[int, ...] = (),
    polar: bool = False,
    iterations: int = 60,
    tolerance: float = 1e-9,
) -> DescentResult:
    """Descend from every start to a minimum of the misfit.

    Coordinates ``held``, by index, stay at their start. A trial has arrived when the
    relative decrease of its misfit is below the tolerance. As for `residuals`,
    ``member`` is the record of each start, and ``polar`` the kind of velocity.
    """
    q = np.clip(start, limits.lower, limits.upper)
    member = np.zeros(len(q), dtype=np.int64) if member is None else member
    best = misfit(problem, q, member, polar=polar)
    state = _Descent(q, best, np.full(len(q), 1e-3))
    free = np.ones(4, dtype=bool)
    free[list(held)] = False
    active = np.arange(len(q))
    for _ in range(iterations):
        step = _bounded_step(state, active, limits, free)
        trial = np.clip(state.q[active] + step, limits.lower, limits.upper)
        found = misfit(problem, trial, member[active], polar=polar)
        gain = state.value[active] - found.value
        state.update(active, trial, found, better=gain >= 0)
        small = tolerance * (1.0 + found.value)
        done = (np.abs(gain) <= small) | (state.damping[active] > 1e8)
        active = active[~done]
        if active.size == 0:
            break
    return DescentResult(state.q, state.rest_hz, state.value, state.matrix)


class _Descent:
    """Where every trial stands; rows are replaced as steps succeed."""

    def __init__(
        self, q: FloatArray, start: ProfiledMisfit, damping: FloatArray
    ) -> None:
        self.q = q.copy()
        self.value = start.value.copy()
        self.gradient = start.gradient.copy()
        self.matrix = start.matrix.copy()
        self.rest_hz = start.rest_hz.copy()
        self.damping = damping

    def update(
        self,
        active: IntArray,
        q: FloatArray,
        found: ProfiledMisfit,
        *,
        better: BoolArray,
    ) -> None:
        """Accept the steps that lowered the misfit and adapt the damping."""
        rows = active[better]
        self.q[rows] = q[better]
        self.value[rows] = found.value[better]
        self.gradient[rows] = found.gradient[better]
        self.matrix[rows] = found.matrix[better]
        self.rest_hz[rows] = found.rest_hz[better]
        change = np.where(better, 0.1, 10.0)
        self.damping[active] = np.maximum(self.damping[active] * change, 1e-12)


def _bounded_step(
    state: _Descent, active: IntArray, limits: SearchBounds, free: BoolArray
) -> FloatArray:
    q, gradient = state.q[active], state.gradient[active]
    matrix = state.matrix[active]
    outward = ((q <= limits.lower) & (gradient > 0)) | (
        (q >= limits.upper) & (gradient < 0)
    )
    frozen = outward | ~free
    damping = state.damping[active]
    step = _solve(matrix, gradient, damping, frozen, np.zeros_like(q))
    goal = np.clip(q + step, limits.lower, limits.upper)
    crossing = ~frozen & (goal != q + step)
    if crossing.any():
        wanted = np.where(crossing, goal - q, 0.0)
        step = _solve(matrix, gradient, damping, frozen | crossing, wanted)
    step[:, 0] = np.clip(step[:, 0], -LARGEST_LOG_STEP, LARGEST_LOG_STEP)
    return step


def _solve(
    matrix: FloatArray,
    gradient: FloatArray,
    damping: FloatArray,
    fixed: BoolArray,
    wanted: FloatArray,
) -> FloatArray:
    """Solve the damped equations with some components of the step given."""
    diagonal = np.diagonal(matrix, axis1=1, axis2=2)
    # a coordinate that the data do not touch stays where it is
    touched = diagonal > 1e-30
    scale = np.where(touched, 1.0 / np.sqrt(np.where(touched, diagonal, 1.0)), 0.0)
    unit = matrix * scale[:, :, np.newaxis] * scale[:, np.newaxis]
    identity = np.eye(matrix.shape[1])
    unit = unit + damping[:, np.newaxis, np.newaxis] * identity
    # ridge: an unobservable direction must not make the equations singular
    unit = unit + 1e-14 * identity
    unit = np.where(fixed[:, :, np.newaxis], identity, unit)
    right = np.where(fixed, wanted / np.where(touched, scale, 1.0), -gradient * scale)
    return np.linalg.solve(unit, right[:, :, np.newaxis])[:, :, 0] * scale
