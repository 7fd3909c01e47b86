"""Nelder-Mead simplex for many independent problems at once.

**Method.** Chang et al. 2003, eq. 5, corrected after Nelder & Mead 1965: the centroid
leaves out the worst vertex, the expansion is tried only when the reflection beats
the best vertex, and a reflection that beats only the worst is kept and contracted.

**Conventions.** An objective takes points (point, parameter) and the problem that
each belongs to, and returns a value for each.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray

Objective = Callable[[FloatArray, IntArray], FloatArray]

EXPANSION, CONTRACTION, SHRINKAGE = 2.0, 0.5, 0.5
COLLAPSED = 1e-10
MOST_STEPS = 10_000
"""Share of its first size below which a simplex rests."""


@dataclass(frozen=True, eq=False)
class Minima:
    """Best point, value and number of evaluations of every problem."""

    point: FloatArray
    """Best points, shape (problems, p)."""
    value: FloatArray
    """Their values, shape (problems,)."""
    evaluations: IntArray
    """Evaluations spent, shape (problems,)."""


def simplex_about(point: FloatArray, spans: FloatArray, share: float = 0.05) -> FloatArray:
    """Build simplices from points (problem, parameter) and a share of the spans."""
    steps = np.vstack([np.zeros_like(spans), share * np.diag(spans)])
    return point[:, np.newaxis] + steps


def nelder_mead(objective: Objective, simplex: FloatArray, *, tolerance: float = 1e-10) -> Minima:
    """Descend with one simplex (problem, vertex, parameter) per problem.

    A simplex rests at a relative spread of the values at its vertices; also when it has
    shrunk to 1e-10 of its first size, for then values differ by rounding alone.
    """
    count, vertices, size = simplex.shape
    member = np.repeat(np.arange(count), vertices)
    value = objective(simplex.reshape(-1, size), member).reshape(count, vertices)
    walk = _Walk(objective, simplex.copy(), value, np.full(count, vertices))
    active = np.arange(count)
    first_size = np.abs(simplex[:, 1:] - simplex[:, :1]).max(1)
    for _ in range(MOST_STEPS):
        walk.order(active)
        best, worst = walk.value[active, 0], walk.value[active, -1]
        spread = 2.0 * np.abs(worst - best)
        moving = spread > tolerance * (np.abs(worst) + np.abs(best) + 1e-10)
        place = walk.simplex[active]
        size = np.abs(place[:, 1:] - place[:, :1]).max(1)
        moving &= np.any(size > COLLAPSED * first_size[active], axis=1)
        active = active[moving]
        if active.size == 0:
            break
        walk.step(active)
    walk.order(np.arange(count))
    return Minima(walk.simplex[:, 0], walk.value[:, 0], walk.evaluations)


class _Walk:
    """The simplices, ordered by value, and one step of those that still move."""

    def __init__(
        self, objective: Objective, simplex: FloatArray, value: FloatArray, evaluations: IntArray
    ) -> None:
        self.objective = objective
        self.simplex, self.value, self.evaluations = simplex, value, evaluations

    def order(self, rows: IntArray) -> None:
        """Sort the vertices of some simplices by value."""
        order = np.argsort(self.value[rows], axis=1, kind="stable")
        self.value[rows] = np.take_along_axis(self.value[rows], order, 1)
        moved = np.take_along_axis(self.simplex[rows], order[:, :, np.newaxis], 1)
        self.simplex[rows] = moved

    def evaluate(self, points: FloatArray, rows: IntArray) -> FloatArray:
        """Evaluate one point for each of some problems."""
        self.evaluations[rows] += 1
        return self.objective(points, rows)

    def replace_worst(
        self, rows: IntArray, points: FloatArray, value: FloatArray, chosen: BoolArray
    ) -> None:
        """Put points in the place of the worst vertices."""
        self.simplex[rows[chosen], -1] = points[chosen]
        self.value[rows[chosen], -1] = value[chosen]

    def step(self, rows: IntArray) -> None:
        """Reflect; expand, keep or contract."""
        centroid = self.simplex[rows, :-1].mean(1)
        reflected = 2.0 * centroid - self.simplex[rows, -1]
        value = self.evaluate(reflected, rows)
        best, second = self.value[rows, 0], self.value[rows, -2]
        worst = self.value[rows, -1]
        self.replace_worst(rows, reflected, value, value < worst)
        winning = value < best
        if winning.any():
            self._expand(rows[winning], centroid[winning], reflected[winning], best[winning])
        failing = value >= second
        if failing.any():
            self._contract(rows[failing], centroid[failing])

    def _expand(
        self, rows: IntArray, centroid: FloatArray, reflected: FloatArray, best: FloatArray
    ) -> None:
        expanded = (1.0 - EXPANSION) * centroid + EXPANSION * reflected
        value = self.evaluate(expanded, rows)
        self.replace_worst(rows, expanded, value, value < best)

    def _contract(self, rows: IntArray, centroid: FloatArray) -> None:
        worst = self.simplex[rows, -1]
        contracted = (1.0 - CONTRACTION) * centroid + CONTRACTION * worst
        value = self.evaluate(contracted, rows)
        better = value < self.value[rows, -1]
        self.replace_worst(rows, contracted, value, better)
        stuck = rows[~better]
        if stuck.size:
            self._shrink(stuck)

    def _shrink(self, rows: IntArray) -> None:
        best = self.simplex[rows, :1]
        moved = (1.0 - SHRINKAGE) * best + SHRINKAGE * self.simplex[rows, 1:]
        self.simplex[rows, 1:] = moved
        many, size = moved.shape[1], moved.shape[2]
        member = np.repeat(rows, many)
        value = self.objective(moved.reshape(-1, size), member)
        self.value[rows, 1:] = value.reshape(-1, many)
        self.evaluations[rows] += many
