"""Recursive solution: one estimate after every measurement, in information form.

**Method.** Around a point of linearisation the information matrix and vector grow by
one row after the other, so that all estimates up to the next linearisation follow
from cumulative sums. The history is linearised again, by up to three descents, when
it has grown by a tenth, when the estimate has drifted half a deviation in the Fisher
metric, or when it meets a bound; at every doubling of the record the descent starts
from many points instead, for early in a record the likelihood is flat.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.target_motion.coordinates import state_jacobian
from uwtrack_cli.estimation.target_motion.information import design_rows
from uwtrack_cli.estimation.target_motion.losses import loss_weight
from uwtrack_cli.estimation.target_motion.marquardt import Limits, minimise
from uwtrack_cli.estimation.target_motion.objective import residuals
from uwtrack_cli.estimation.target_motion.problem import Problem
from uwtrack_cli.estimation.target_motion.starts import Effort, multistart

FIRST_ROWS = 10
GROWTH = 1.1
LARGEST_DRIFT = 0.5
RESTART = Effort(on_blocks=12, on_all=2)


@dataclass(frozen=True, eq=False)
class RecursiveEstimates:
    """Estimates after ``rows`` measurements each, and how often it linearised."""

    rows: IntArray
    q: FloatArray
    linearisations: int


def estimate_recursively(problem: Problem, limits: Limits) -> RecursiveEstimates:
    """Estimate the motion after every row of one record.

    Parameters
    ----------
    problem
        One record.
    limits
        Bounds of the search.
    """
    count = min(FIRST_ROWS, problem.n_rows)
    doubling = count
    q = np.zeros(4)
    found: list[FloatArray] = []
    linearisations = 0
    while True:
        history = problem.rows(slice(0, count))
        if count >= doubling:
            extra = q[np.newaxis] if found else None
            q = multistart(history, limits, effort=RESTART, extra=extra).q[0]
            doubling = 2 * count
        else:
            q = minimise(history, q[np.newaxis], limits, iterations=3).q[0]
        linearisations += 1
        found.append(q[np.newaxis])
        if count == problem.n_rows:
            break
        last = min(max(int(GROWTH * count), count + 1), problem.n_rows, doubling)
        ahead = _update_rows(problem, q, count, last, limits)
        found.append(ahead[:-1])
        count += len(ahead)
        q = ahead[-1]
    rows = np.arange(problem.n_rows - sum(map(len, found)), problem.n_rows) + 1
    return RecursiveEstimates(rows, np.concatenate(found), linearisations)


def _update_rows(
    problem: Problem, q: FloatArray, count: int, last: int, limits: Limits
) -> FloatArray:
    """Update row by row until the linearisation no longer holds.

    The last estimate is only a start for the descent on the whole history.
    """
    matrix, vector = _information_by_row(problem.rows(slice(0, last)), q, count)
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(matrix, axis1=1, axis2=2), 1e-30))
    unit = matrix * scale[:, :, np.newaxis] * scale[:, np.newaxis]
    unit = unit + 1e-12 * np.eye(unit.shape[1])
    step = np.linalg.solve(unit, -(vector * scale)[:, :, np.newaxis])[:, :, 0]
    drift = np.einsum("kp,kpq,kq->k", step, unit, step)
    estimates = q + (step * scale)[:, :4]
    inside = np.all((estimates > limits.lower) & (estimates < limits.upper), axis=1) & (
        drift < LARGEST_DRIFT**2
    )
    broken = np.flatnonzero(~inside)
    if broken.size == 0:
        return estimates
    first = int(broken[0])
    return np.concatenate([estimates[:first], q[np.newaxis]])


def _information_by_row(
    problem: Problem, q: FloatArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Information matrix and vector after each row from ``count`` on."""
    r = residuals(problem, q[np.newaxis])
    if count < problem.n_rows:  # rest frequencies of the history, not of the future
        past = residuals(problem.rows(slice(0, count)), q[np.newaxis])
        r = residuals(problem, q[np.newaxis], rest_hz=past.rest_hz)
    z = np.concatenate([r.bearing[0], r.frequency[0]])
    rows = design_rows(problem, r)
    chain = np.eye(rows.shape[2])
    chain[:4, :4] = state_jacobian(q[np.newaxis])[0]
    rows = rows @ chain
    weighted = rows * loss_weight(z, problem.loss)[:, :, np.newaxis]
    vector = np.einsum("skp,sk->kp", weighted, z)
    past_rows, new_rows = rows[:, :count], rows[:, count:]
    past = np.einsum("skp,skq->pq", weighted[:, :count], past_rows, optimize=True)
    fresh = np.swapaxes(weighted[:, count:].transpose(1, 0, 2), 1, 2) @ (
        new_rows.transpose(1, 0, 2)
    )
    matrix = past + np.cumsum(fresh, axis=0)
    return matrix, vector[:count].sum(0) + np.cumsum(vector[count:], axis=0)


def solve_recursive(
    problem: Problem, limits: Limits, ends: IntArray, seed: int
) -> FloatArray:
    """Update with every measurement; keep the estimates that are wanted."""
    del seed  # nothing is random here
    found = estimate_recursively(problem, limits)
    return found.q[np.maximum(np.searchsorted(found.rows, ends), 0)]
