"""The hybrids of the paper: a global search, then a simplex, with adaptive feedback.

**Method.** Chang et al. 2003, sections III-IV, corrected. The unknowns are range,
bearing, speed, course and every rest frequency, in a box. Values outside are charged
10^6 times the squared violation (eq. 8); angles are periodic and never charged. A
growing record is inverted again and again; the solution of one length is fed back
into the search at the next. Both hybrids find what the maximum-likelihood descent
finds, in a hundred times as many evaluations.

**Conventions.** Points are (range m, bearing rad, speed m/s, course rad, rest
frequencies Hz).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from studies.annealing import AnnealingPolicy, annealing_search
from studies.genetic import GeneticPolicy, genetic_search
from studies.simplex import Minima, nelder_mead, simplex_about
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.motion.target_motion.model import from_motion
from uwtrack_cli.motion.target_motion.objective import misfit_value
from uwtrack_cli.motion.target_motion.problem import Problem
from uwtrack_cli.motion.target_motion.solvers.marquardt import SearchBounds

PENALTY = 1e6
"""Charge for a violation by the whole width of the box (Chang et al., eq. 8)."""

Global = Literal["genetic", "annealing", "none"]


@dataclass(frozen=True, eq=False)
class Box:
    """Bounds of the search; bearing and course are periodic."""

    lower: FloatArray
    """Lower bounds of the parameters, shape (p,)."""
    upper: FloatArray
    """Upper bounds of the parameters, shape (p,)."""

    @property
    def spans(self) -> FloatArray:
        """Width of the box along each parameter."""
        return np.asarray(self.upper - self.lower)

    def draw(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Draw points evenly from the box."""
        return np.asarray(self.lower + self.spans * rng.random((count, len(self.lower))))


def box_of(problem: Problem, limits: SearchBounds) -> Box:
    """Make the box of the limits; rest frequencies within the largest Doppler."""
    top = np.exp(limits.upper[0])
    speed = float(limits.upper[2])
    own = np.hypot(*problem.track.velocity_mps).max()
    reach = (speed + float(own)) / problem.sound_speed_mps
    middle = np.array(
        [
            np.median(line[weight > 0]) if (weight > 0).any() else 1.0
            for line, weight in zip(problem.frequency_hz[0], problem.frequency_weight, strict=True)
        ]
    )
    turn = 2.0 * np.pi
    return Box(
        np.concatenate([[0.0, 0.0, 0.0, 0.0], middle * (1.0 - reach)]),
        np.concatenate([[top, turn, speed, turn], middle * (1.0 + reach)]),
    )


class PenalisedMisfit:
    """The misfit of points in a box, with a charge outside it."""

    def __init__(self, problem: Problem, box: Box) -> None:
        self.problem, self.box = problem, box
        self.bounded = np.ones(box.lower.size, dtype=bool)
        self.bounded[[1, 3]] = False

    def __call__(self, points: FloatArray, member: IntArray) -> FloatArray:
        """Return the misfit of every point in the record that it belongs to."""
        distance, bearing, speed, course = points[:, :4].T
        state = np.stack([
            distance * np.sin(bearing), distance * np.cos(bearing),
            speed * np.sin(course), speed * np.cos(course),
        ], 1)  # fmt: skip
        value = misfit_value(self.problem, state, points[:, 4:], member)
        over = np.maximum(points - self.box.upper, 0.0)
        over = over + np.maximum(self.box.lower - points, 0.0)
        excess = (over / self.box.spans)[:, self.bounded]
        return np.asarray(value + PENALTY * (excess**2).sum(1))


def hybrid_search(
    problem: Problem,
    box: Box,
    count: int,
    rng: np.random.Generator,
    *,
    search: Global,
    feedback: FloatArray | None = None,
) -> Minima:
    """Invert ``count`` records: global search, then the simplex from the best point.

    Without a global search the simplex starts at a random point, or at the solutions of
    a shorter record (record, parameter) that are fed back.
    """
    objective = PenalisedMisfit(problem, box)
    bounds = (box.lower, box.upper)
    if feedback is not None:
        feedback = _normalised(feedback)
    spent: IntArray = np.zeros(count, dtype=np.int64)
    if search == "none":
        start = box.draw(count, rng) if feedback is None else feedback
    else:
        if search == "genetic":
            found = genetic_search(
                objective, bounds, count, rng, policy=GeneticPolicy(), feedback=feedback
            )
        else:
            found = annealing_search(
                objective, bounds, count, rng, policy=AnnealingPolicy(),
                periodic=~objective.bounded, feedback=feedback,
            )  # fmt: skip
        start, spent = found.point, found.evaluations
        if feedback is not None:  # not quantised, it may be the better start
            old = objective(feedback, np.arange(count))
            start = np.where((old < found.value)[:, np.newaxis], feedback, start)
    end = nelder_mead(objective, simplex_about(start, box.spans))
    return Minima(_normalised(end.point), end.value, spent + end.evaluations)


def _normalised(points: FloatArray) -> FloatArray:
    """Bring negative ranges and speeds to the same vessel in positive form."""
    flip_range, flip_speed = points[:, 0] < 0, points[:, 2] < 0
    result = points.copy()
    result[:, [0, 2]] = np.abs(points[:, [0, 2]])
    result[:, 1] = np.mod(points[:, 1] + np.pi * flip_range, 2.0 * np.pi)
    result[:, 3] = np.mod(points[:, 3] + np.pi * flip_speed, 2.0 * np.pi)
    return result


def to_solver(points: FloatArray) -> FloatArray:
    """Turn points into solver coordinates (ln R, bearing, vx, vy)."""
    return from_motion(*points[:, :4].T)


def solve_hybrid(
    problem: Problem, limits: SearchBounds, ends: IntArray, seed: int, *, search: Global
) -> FloatArray:
    """Invert by a global search and simplex, with feedback from length to length."""
    rng = np.random.default_rng(seed)
    box = box_of(problem, limits)
    feedback: FloatArray | None = None
    found = []
    for end in ends:
        part = problem.rows(slice(0, int(end)))
        feedback = hybrid_search(part, box, 1, rng, search=search, feedback=feedback).point
        found.append(to_solver(feedback)[0])
    return np.stack(found)
