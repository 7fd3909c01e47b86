"""Recursive solution: one estimate after every measurement, in information form.

**Method.** Around a point of linearisation the information matrix and vector grow by
one row after the other, so that all estimates up to the next linearisation follow
from cumulative sums. The history is linearised again, by a warm descent, when it has
grown by a tenth, when the estimate has drifted half a deviation in the Fisher metric,
when the misfit is not what the linearisation expects, or at a bound. Whenever the
record has grown by half, the descent starts from many points instead, for early in a
record the likelihood is flat.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.motion.target_motion.model import state_jacobian
from uwtrack_cli.motion.target_motion.objective import loss_value, loss_weight, misfit, residuals
from uwtrack_cli.motion.target_motion.observability import design_rows
from uwtrack_cli.motion.target_motion.problem import Problem
from uwtrack_cli.motion.target_motion.solvers.marquardt import DescentResult, SearchBounds, minimise
from uwtrack_cli.motion.target_motion.starts import StartCounts, multistart

FIRST_ROWS = 10
GROWTH = 1.1
LARGEST_DRIFT = 0.5
LARGEST_SURPRISE = 0.5
"""Largest difference of the misfit from what the linearisation expects of it."""

DESCENTS = 10
RESTARTED = 1.5
"""Growth of the record after which the descent starts from many points again."""
RESTART = StartCounts(on_blocks=12, on_all=2)


@dataclass(frozen=True, eq=False)
class RecursiveEstimates:
    """Estimates after ``rows`` measurements each."""

    rows: IntArray
    """Number of measurements of every estimate, shape (estimates,)."""
    q: FloatArray
    """Motions in solver coordinates, shape (estimates, 4)."""


def estimate_recursively(problem: Problem, limits: SearchBounds) -> RecursiveEstimates:
    """Estimate the motion after every row of one record."""
    count = min(FIRST_ROWS, problem.n_rows)
    doubling = count
    found: list[FloatArray] = []
    start: FloatArray | None = None
    while True:
        history = problem.rows(slice(0, count))
        if start is None or count >= doubling:
            fit = multistart(history, limits, counts=RESTART, extra=start)
            doubling = int(RESTARTED * count)
        else:
            fit = minimise(history, start, limits, iterations=DESCENTS)
        found.append(fit.q[:1])
        if count == problem.n_rows:
            break
        last = min(max(int(GROWTH * count), count + 1), problem.n_rows, doubling)
        ahead = _update_rows(problem.rows(slice(0, last)), fit, count, limits)
        found.append(ahead[:-1])
        count += len(ahead)
        start = ahead[-1:]
    rows = np.arange(problem.n_rows - sum(map(len, found)), problem.n_rows) + 1
    return RecursiveEstimates(rows, np.concatenate(found))


def _update_rows(
    problem: Problem, fit: DescentResult, count: int, limits: SearchBounds
) -> FloatArray:
    """Update row by row until the linearisation no longer holds.

    The last estimate is only a start for the descent on the whole history.
    """
    q = fit.q[0]
    sums = _sums_by_row(problem, fit, count)
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(sums.matrix, axis1=1, axis2=2), 1e-30))
    unit = sums.matrix * scale[:, :, np.newaxis] * scale[:, np.newaxis]
    unit = unit + 1e-12 * np.eye(unit.shape[1])
    step = np.linalg.solve(unit, -(sums.vector * scale)[:, :, np.newaxis])[:, :, 0]
    drift = np.einsum("kp,kpq,kq->k", step, unit, step)
    estimates = q + (step * scale)[:, :4]
    inside = np.all((estimates > limits.lower) & (estimates < limits.upper), axis=1)
    broken = np.flatnonzero(~inside | (drift >= LARGEST_DRIFT**2))
    reach = int(broken[0]) if broken.size else len(estimates) - 1
    while reach:
        part = problem.rows(slice(0, count + reach))
        expected = sums.value[reach - 1] - drift[reach - 1]
        actual = misfit(part, estimates[reach - 1][np.newaxis]).value[0]
        if abs(actual - expected) < LARGEST_SURPRISE:
            break
        reach //= 2
    start = estimates[reach] if not broken.size and reach else q
    return np.concatenate([estimates[:reach], start[np.newaxis]])


@dataclass(frozen=True, eq=False)
class _CumulativeSums:
    """Information matrix, vector and misfit after each row that is new."""

    matrix: FloatArray
    """Information up to every row, shape (rows, p, p)."""
    vector: FloatArray
    """Information vector up to every row, shape (rows, p)."""
    value: FloatArray
    """Misfit up to every row, shape (rows,)."""


def _sums_by_row(problem: Problem, fit: DescentResult, count: int) -> _CumulativeSums:
    # rest frequencies of the history, not of the rows to come
    q = fit.q[:1]
    r = residuals(problem, q, rest_hz=fit.rest_hz[:1])
    z = np.concatenate([r.bearing[0], r.frequency[0]])
    rows = design_rows(problem, r)
    chain = np.eye(rows.shape[2])
    chain[:4, :4] = state_jacobian(q)[0]
    rows = np.swapaxes(rows @ chain, 0, 1)
    weighted = rows * loss_weight(z, problem.loss).T[:, :, np.newaxis]
    vector = np.cumsum((weighted * z.T[:, :, np.newaxis]).sum(1), axis=0)
    value = np.cumsum(loss_value(z, problem.loss).sum(0))
    size = rows.shape[2]
    past = weighted[:count].reshape(-1, size).T @ rows[:count].reshape(-1, size)
    fresh = np.swapaxes(weighted[count:], 1, 2) @ rows[count:]
    # what is told of the depths stands before all rows
    past[4:, 4:] += np.diag(problem.rest_precision)
    vector[:, 4:] += problem.rest_precision * (r.rest_hz[0] - 1.0)
    value += r.prior_value(problem)[0]
    return _CumulativeSums(past + np.cumsum(fresh, axis=0), vector[count:], value[count:])


def solve_recursive(
    problem: Problem, limits: SearchBounds, ends: IntArray, seed: int
) -> FloatArray:
    """Update with every measurement; keep the estimates that are wanted."""
    del seed  # nothing is random here
    found = estimate_recursively(problem, limits)
    return found.q[np.maximum(np.searchsorted(found.rows, ends), 0)]
