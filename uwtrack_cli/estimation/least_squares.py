"""Levenberg-Marquardt steps for many small problems at once.

**Method.** Every row of the batch has its own damping; a step is kept where it lowers
that row's cost (Marquardt 1963). The normal equations are solved with unit diagonal
(Fletcher 1971). A coordinate on its bound is frozen while the descent points outwards,
and a step that would cross a bound is taken exactly to it, with the other coordinates
solved again: plain clipping stalls instead.

**Conventions.** The first axis is the batch. The problem is given as a function that
returns cost, gradient and Gauss-Newton matrix, so residuals need never be formed.
"""

from collections.abc import Callable

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray

Evaluation = tuple[FloatArray, FloatArray, FloatArray]
"""Cost (batch,), gradient (batch, p) and Gauss-Newton matrix (batch, p, p)."""

LEAST_DAMPING, MOST_DAMPING = 1e-9, 1e9
"""Smallest damping of a row, and that at which no step can be found any more."""

RIDGE = 1e-14
"""Added to the unit diagonal: an unobservable direction must not be singular."""


def damped_least_squares(  # noqa: PLR0913 (bounds, and when to stop)
    evaluate: Callable[[FloatArray, IntArray], Evaluation],
    start: FloatArray,
    limit: Callable[[FloatArray, FloatArray], FloatArray],
    *,
    bounds: tuple[FloatArray, FloatArray] | None = None,
    held: tuple[int, ...] = (),
    max_steps: int = 30,
    tolerance: float = 1e-3,
    relative_tolerance: float = 0.0,
    first_damping: float = 1e-4,
    drops_rows: bool = False,
) -> FloatArray:
    """Minimise every row's cost from its start; return the unknowns, (batch, p).

    Parameters
    ----------
    evaluate
        Function of the unknowns (rows, p) and of their rows in the batch: cost (rows,),
        infinite where the unknowns are not allowed, gradient and Gauss-Newton matrix.
    start
        Unknowns to start from, shape (batch, p).
    limit
        Function of (unknowns, step) that returns the step made acceptable.
    bounds
        Least and greatest unknowns, shape (p,) each; only with bounds may some be held.
    held
        Unknowns that stay at their start, by index.
    max_steps
        Largest number of steps.
    tolerance
        A row is done when its expected gain in cost is below this; a cost is half a
        chi-square, so 1e-3 is a thirtieth of a deviation. It takes the last step
        unseen if that gains a thousandth of it. Where no row does, the unknowns that
        come back are the array that was evaluated last.
    relative_tolerance
        Added to it, times the cost.
    first_damping
        Damping of the first step.
    drops_rows
        Whether rows that are done drop out; else all go on until the last is done, as
        where the data of some rows are dear to take out of those of the batch.
    """
    rows, found = np.arange(len(start)), np.empty_like(start)
    theta = start if bounds is None else np.clip(start, *bounds)
    cost, gradient, matrix = evaluate(theta, rows)
    damping = np.full(cost.shape, first_damping)
    for _ in range(max_steps):
        if bounds is None:
            step = solve_step(matrix, gradient, damping)
        else:
            step = _bounded_step(theta, (gradient, matrix, damping), bounds, held)
        step = limit(theta, step)
        promised = np.abs((gradient * step).sum(axis=-1))
        small = tolerance + relative_tolerance * cost
        stuck = damping >= MOST_DAMPING
        done = (promised < small) | stuck
        if done.all() or (drops_rows and done.any()):
            moves = ~stuck & (promised >= 1e-3 * small)
            last = np.where(moves[:, None], theta + step, theta)
            if done.all():
                theta = last if moves.any() else theta
                break
            found[rows[done]] = last[done]
            rows, theta, step, damping, cost, gradient, matrix = (
                each[~done] for each in (rows, theta, step, damping, cost, gradient, matrix)
            )
        trial = theta + step if bounds is None else np.clip(theta + step, *bounds)
        new = evaluate(trial, rows)
        better = new[0] <= cost
        damping = damping * np.where(better, 0.1, 10.0)
        damping = np.minimum(np.maximum(damping, LEAST_DAMPING), MOST_DAMPING)
        if better.all():
            theta, (cost, gradient, matrix) = trial, new
            continue
        theta = np.where(better[:, None], trial, theta)
        cost = np.where(better, new[0], cost)
        gradient = np.where(better[:, None], new[1], gradient)
        matrix = np.where(better[:, None, None], new[2], matrix)
    if rows.size == len(start):
        return theta
    found[rows] = theta
    return found


def _bounded_step(
    theta: FloatArray,
    equations: tuple[FloatArray, FloatArray, FloatArray],
    bounds: tuple[FloatArray, FloatArray],
    held: tuple[int, ...],
) -> FloatArray:
    gradient, matrix, damping = equations
    lower, upper = bounds
    fixed = ((theta <= lower) & (gradient > 0)) | ((theta >= upper) & (gradient < 0))
    fixed[:, list(held)] = True
    step = solve_step(matrix, gradient, damping, fixed, np.zeros_like(theta))
    goal = np.clip(theta + step, lower, upper)
    crossing = ~fixed & (goal != theta + step)
    if crossing.any():
        wanted = np.where(crossing, goal - theta, 0.0)
        step = solve_step(matrix, gradient, damping, fixed | crossing, wanted)
    return step


def solve_step(
    matrix: FloatArray,
    gradient: FloatArray,
    damping: FloatArray,
    fixed: BoolArray | None = None,
    wanted: FloatArray | None = None,
) -> FloatArray:
    """Solve the damped normal equations of every row, (batch, p, p).

    Components of the step that are ``fixed``, shape (batch, p), are as ``wanted``.
    """
    number = np.arange(matrix.shape[-1])
    diagonal = matrix[:, number, number]
    # a coordinate that the data do not touch stays where it is
    touched = diagonal > 1e-30
    root = np.sqrt(np.where(touched, diagonal, 1.0))
    scale = np.where(touched, 1.0 / root, 0.0)
    unit = matrix * (scale[:, :, None] * scale[:, None])
    unit[:, number, number] += damping[:, None] + RIDGE
    right = -gradient * scale
    if fixed is not None and wanted is not None:
        unit = np.where(fixed[:, :, None], np.eye(number.size), unit)
        right = np.where(fixed, wanted * root, right)
    step: FloatArray = np.linalg.solve(unit, right[..., None])[..., 0] * scale
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
