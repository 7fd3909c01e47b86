"""The solvers behind one interface: growing records in, estimates out.

**Method.** `mle` and `recursive` descend. `genetic` and `annealing` search the box of
the limits as Chang et al. (2003) do, by scipy's differential evolution (Storn & Price
1997) and dual annealing (Xiang et al. 1997), and descend from what they find; the
estimate of a record is fed back into the search of a longer one (their section IV).
The paper's own searches stand in `studies`.

**Conventions.** A solver takes the problem, the limits, the numbers of rows after
which an estimate is wanted (ascending; the last is the whole record) and a seed. It
returns one motion per such number, in solver coordinates.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, Literal

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.motion.target_motion.objective import misfit
from uwtrack_cli.motion.target_motion.problem import Problem
from uwtrack_cli.motion.target_motion.solvers.marquardt import SearchBounds, minimise
from uwtrack_cli.motion.target_motion.solvers.recursive import solve_recursive
from uwtrack_cli.motion.target_motion.starts import StartCounts, minima_of, multistart

SolverName = Literal["mle", "recursive", "genetic", "annealing"]
Solver = Callable[[Problem, SearchBounds, IntArray, int], FloatArray]

WHILE_GROWING = StartCounts(on_blocks=12, on_all=2)
"""Starts for the estimates before the last: the previous one helps."""

TIE = 1e-3
"""Difference of the misfit that is ignored: the two sides of an array are equal."""


def solve_mle(problem: Problem, limits: SearchBounds, ends: IntArray, seed: int) -> FloatArray:
    """Maximise the likelihood at every length, by multi-start descent."""
    del seed  # nothing is random here
    found: list[FloatArray] = []
    for end in ends:
        if not found and end == problem.n_rows:
            fit = minima_of(problem, limits)
        else:
            fit = multistart(
                problem.rows(slice(0, int(end))),
                limits,
                counts=StartCounts() if end == ends[-1] else WHILE_GROWING,
                extra=found[-1][np.newaxis] if found else None,
            )
        equal = fit.q[fit.value < fit.value[0] + TIE]
        found.append(_nearest(equal, found[-1]) if found else equal[0])
    return np.stack(found)


def _nearest(q: FloatArray, last: FloatArray) -> FloatArray:
    """Choose among equal minima the one that continues the last estimate."""
    apart = q - last
    apart[:, 1] = wrap_rad(apart[:, 1])
    return np.asarray(q[np.abs(apart[:, 1]).argmin()])


def solve_globally(
    problem: Problem,
    limits: SearchBounds,
    ends: IntArray,
    seed: int,
    *,
    search: Literal["genetic", "annealing"],
) -> FloatArray:
    """Search the whole box at every length, and descend from the best point."""
    from scipy.optimize import Bounds, differential_evolution, dual_annealing

    lower, upper = limits.lower.copy(), limits.upper.copy()
    lower[1], upper[1] = 0.0, 2.0 * np.pi
    box, rng = Bounds(lower, upper), np.random.default_rng(seed)
    place: FloatArray | None = None
    found: list[FloatArray] = []
    for end in ends:
        part = problem.rows(slice(0, int(end)))

        def value(points: FloatArray, part: Problem = part) -> Any:
            # scipy's types know of one point (4,) alone, its search asks (4, n), too
            found = misfit(part, np.atleast_2d(points.T)).value
            return found if points.ndim == 2 else float(found[0])

        if search == "genetic":
            best = differential_evolution(
                value, box, x0=place, rng=rng, vectorized=True, polish=False, updating="deferred"
            ).x
        else:
            best = dual_annealing(
                value, box, x0=place, rng=rng, no_local_search=True, maxiter=ANNEALING_STEPS
            ).x
        fit = minimise(part, np.asarray(best)[np.newaxis], limits)
        found.append(fit.q[0])
        place = np.clip(fit.q[0], lower, upper)
        place[1] = np.mod(fit.q[0, 1], 2.0 * np.pi)
    return np.stack(found)


ANNEALING_STEPS = 300
"""Temperatures of the annealing; the descent does the rest."""

SOLVERS: dict[SolverName, Solver] = {
    "mle": solve_mle,
    "recursive": solve_recursive,
    "genetic": partial(solve_globally, search="genetic"),
    "annealing": partial(solve_globally, search="annealing"),
}
