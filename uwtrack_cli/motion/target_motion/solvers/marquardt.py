"""Descent on the misfit of trial motions, within bounds, from many starts at once."""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.data.rows import Rows
from uwtrack_cli.estimation.least_squares import Evaluation, damped_least_squares
from uwtrack_cli.motion.target_motion.objective import misfit
from uwtrack_cli.motion.target_motion.problem import Problem

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
    relative decrease that its misfit promises is below the tolerance. As for `residuals`,
    ``member`` is the record of each start, and ``polar`` the kind of velocity.
    """
    member = np.zeros(len(start), dtype=np.int64) if member is None else member

    def evaluate(q: FloatArray, rows: IntArray) -> Evaluation:
        found = misfit(problem, q, member[rows], polar=polar)
        return 0.5 * found.value, found.gradient, found.matrix

    def limit(_: FloatArray, step: FloatArray) -> FloatArray:
        step[:, 0] = np.clip(step[:, 0], -LARGEST_LOG_STEP, LARGEST_LOG_STEP)
        return step

    q = damped_least_squares(
        evaluate, start, limit, bounds=(limits.lower, limits.upper), held=held,
        max_steps=iterations, tolerance=0.5 * tolerance, relative_tolerance=tolerance,
        first_damping=1e-3, drops_rows=True,
    )  # fmt: skip
    found = misfit(problem, q, member, polar=polar)
    return DescentResult(q, found.rest_hz, found.value, found.matrix)
