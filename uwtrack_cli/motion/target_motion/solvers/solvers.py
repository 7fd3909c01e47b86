"""The solvers behind one interface: growing records in, estimates out.

**Conventions.** A solver takes the problem, the limits, the numbers of rows after
which an estimate is wanted (ascending; the last is the whole record) and a seed. It
returns one motion per such number, in solver coordinates.
"""

from collections.abc import Callable
from functools import partial
from typing import Literal

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.motion.target_motion.problem import Problem
from uwtrack_cli.motion.target_motion.solvers.hybrid import solve_hybrid
from uwtrack_cli.motion.target_motion.solvers.marquardt import SearchBounds
from uwtrack_cli.motion.target_motion.solvers.recursive import solve_recursive
from uwtrack_cli.motion.target_motion.starts import StartCounts, multistart

SolverName = Literal["mle", "recursive", "genetic", "annealing"]
Solver = Callable[[Problem, SearchBounds, IntArray, int], FloatArray]

WHILE_GROWING = StartCounts(on_blocks=12, on_all=2)
"""Starts for the estimates before the last: the previous one helps."""

TIE = 1e-3
"""Difference of the misfit that is ignored: the two sides of an array are equal."""


def solve_mle(
    problem: Problem, limits: SearchBounds, ends: IntArray, seed: int
) -> FloatArray:
    """Maximise the likelihood at every length, by multi-start descent."""
    del seed  # nothing is random here
    found: list[FloatArray] = []
    for end in ends:
        last = end == ends[-1]
        fit = multistart(
            problem.rows(slice(0, int(end))),
            limits,
            counts=StartCounts() if last else WHILE_GROWING,
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


SOLVERS: dict[SolverName, Solver] = {
    "mle": solve_mle,
    "recursive": solve_recursive,
    "genetic": partial(solve_hybrid, search="genetic"),
    "annealing": partial(solve_hybrid, search="annealing"),
}
