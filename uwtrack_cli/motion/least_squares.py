"""Levenberg-Marquardt steps for many small problems at once.

**Method.** Every row of the batch has its own damping; a step is kept where it lowers
that row's cost (Marquardt 1963, with the diagonal scaling of the normal matrix).

**Conventions.** The first axis is the batch. The problem is given as a function that
returns cost, gradient and Gauss-Newton matrix, so residuals need never be formed.
"""

from collections.abc import Callable

import numpy as np

from uwtrack_cli.data.base import FloatArray

Evaluation = tuple[FloatArray, FloatArray, FloatArray]


def damped_least_squares(
    evaluate: Callable[[FloatArray], Evaluation],
    start: FloatArray,
    limit: Callable[[FloatArray, FloatArray], FloatArray],
    *,
    max_steps: int = 30,
    tolerance: float = 1e-3,
) -> FloatArray:
    """Minimise every row's cost from its start.

    Parameters
    ----------
    evaluate
        Function of the unknowns (batch, p): cost (batch,), gradient (batch, p) and
        Gauss-Newton matrix (batch, p, p).
    start
        Unknowns to start from, shape (batch, p).
    limit
        Function of (unknowns, step) that returns the step made acceptable.
    max_steps
        Largest number of steps.
    tolerance
        The last step is taken when every row's expected gain in cost is below
        this; a cost is half a chi-square, so 1e-3 is a thirtieth of a deviation.
        Below a thousandth of it no step is taken: the unknowns that come back are
        then the array that was evaluated last.
    """
    theta = start
    cost, gradient, matrix = evaluate(theta)
    damping = np.full(cost.shape, 1e-4)
    for _ in range(max_steps):
        step = limit(theta, solve_step(matrix, gradient, damping))
        promised = -(gradient * step).sum(axis=-1)
        if np.all((promised < tolerance) | (damping >= 1e9)):
            if np.all((promised < 1e-3 * tolerance) | (damping >= 1e9)):
                return theta
            return np.where((damping < 1e9)[:, None], theta + step, theta)
        trial = theta + step
        new_cost, new_gradient, new_matrix = evaluate(trial)
        better = new_cost <= cost
        damping = damping * np.where(better, 0.1, 10.0)
        damping = np.minimum(np.maximum(damping, 1e-9), 1e9)
        if better.all():
            theta, cost, gradient, matrix = trial, new_cost, new_gradient, new_matrix
            continue
        theta = np.where(better[:, None], trial, theta)
        cost = np.where(better, new_cost, cost)
        gradient = np.where(better[:, None], new_gradient, gradient)
        matrix = np.where(better[:, None, None], new_matrix, matrix)
    return theta


def solve_step(
    matrix: FloatArray, gradient: FloatArray, damping: FloatArray
) -> FloatArray:
    """Solve the damped normal equations of every row, (batch, p, p)."""
    number = np.arange(matrix.shape[-1])
    diagonal = matrix[..., number, number]
    damped = matrix.copy()
    damped[..., number, number] += damping[:, None] * np.where(
        diagonal > 0, diagonal, 1.0
    )
    step: FloatArray = np.linalg.solve(damped, -gradient[..., None])[..., 0]
    return step


def unit_scale(matrix: FloatArray) -> FloatArray:
    """Return the root of the diagonal of symmetric matrices, one where it is zero."""
    number = np.arange(matrix.shape[-1])
    diagonal = matrix[..., number, number]
    return np.sqrt(np.where(diagonal > 0, diagonal, 1.0))


def orthonormal(columns: FloatArray) -> FloatArray:
    """Return orthonormal columns that span what is given, up to rounding."""
    size = np.sqrt((columns**2).sum(axis=0))
    unit = columns / np.where(size > 0, size, 1.0)
    basis, singular, _ = np.linalg.svd(unit, full_matrices=False)
    return np.asarray(basis[:, singular > 1e-8 * singular[0]])


def inverse_or_nan(matrix: FloatArray) -> FloatArray:
    """Invert symmetric positive matrices; nan where they are singular or not finite."""
    finite = np.isfinite(matrix).all(axis=(-2, -1), keepdims=True)
    if not finite.all():  # a fit that has left the numbers: the others have theirs
        usable = np.where(finite, matrix, np.eye(matrix.shape[-1]))
        found: FloatArray = np.where(finite, inverse_or_nan(usable), np.nan)
        return found
    scale = unit_scale(matrix)
    outer = scale[..., :, None] * scale[..., None, :]
    unit = matrix / outer
    try:
        factor = np.linalg.cholesky(unit)
        if np.all(np.einsum("...ii->...i", factor) > 1e-6):
            return np.asarray(np.linalg.inv(unit) / outer)
    except np.linalg.LinAlgError:
        pass
    values, vectors = np.linalg.eigh(unit)
    good = values > 1e-13
    with np.errstate(divide="ignore"):
        inverse = np.where(good, 1 / np.where(good, values, 1.0), np.nan)
    full: FloatArray = (vectors * inverse[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return full / outer
