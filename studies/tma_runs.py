"""Monte-Carlo runs of the target-motion scenarios, whole batches at a time.

**Conventions.** Errors are over (range m, bearing rad, speed m/s, course rad), the
order of the solver's answer for people. A run succeeds when the initial range is
within 10 %, the speed within 3 kn and the course within 7 degrees, at once.
"""

from collections.abc import Callable
from dataclasses import dataclass
from time import process_time
from typing import NamedTuple

import numpy as np

from studies.hybrid import Box, Global, PenalisedMisfit, hybrid_search, to_solver
from studies.tma_scenarios import REST_HZ, TmaScenario, make_problem, make_scenario
from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.motion.target_motion.model import to_motion, to_state
from uwtrack_cli.motion.target_motion.objective import misfit_value
from uwtrack_cli.motion.target_motion.observability import information
from uwtrack_cli.motion.target_motion.problem import Problem
from uwtrack_cli.motion.target_motion.solvers.marquardt import (
    DescentResult,
    minimise,
    search_bounds,
)
from uwtrack_cli.motion.target_motion.starts import StartCounts, multistart

WIDE = search_bounds((50.0, 200_000.0), 30.0 * KNOT_MPS)
PAPER = search_bounds((1.0, 25_000.0), 15.0 * KNOT_MPS)
PAPER_BOX = Box(
    np.array([0.0, 0.0, 0.0, 0.0, REST_HZ - 5.0]),
    np.array([25_000.0, 2 * np.pi, 15.0 * KNOT_MPS, 2 * np.pi, REST_HZ + 5.0]),
)
CHUNK = 100
"""Records that are fitted at once, so that memory stays small."""


@dataclass(frozen=True, eq=False)
class Accuracy:
    """Errors of many runs beside the bound."""

    errors: FloatArray
    """Errors of range (m), bearing (rad), speed (m/s), course (rad), ``(run, 4)``."""
    rest_errors: FloatArray
    """Errors of the rest frequency, Hz, ``(run, 1)``."""
    bound: FloatArray
    """Cramer-Rao bound of the five, ``(5,)``."""
    success: BoolArray
    """Whether the run meets the criterion, ``(run,)``."""
    chi_square: FloatArray
    """Misfit of the estimate, ``(run,)``."""
    rise: FloatArray
    """Misfit of the truth less that of the estimate, ``(run,)``."""
    nees: FloatArray
    """Squared error in sigmas by the information at the estimate, ``(run,)``."""

    @property
    def ratio(self) -> FloatArray:
        """Root-mean-square error over the bound: R, bearing, speed, course, f0."""
        rms = np.sqrt(np.mean(self.errors**2, axis=0))
        rest = np.sqrt(np.mean(self.rest_errors**2, axis=0))
        return np.asarray(np.concatenate([rms, rest]) / self.bound)


def motion_errors(q: FloatArray, scenario: TmaScenario) -> FloatArray:
    """Return errors of range, bearing, speed and course."""
    truth = to_motion(scenario.solution())
    errors = to_motion(q) - truth
    errors[..., [1, 3]] = wrap_rad(errors[..., [1, 3]])
    return errors


def succeeded(errors: FloatArray) -> BoolArray:
    """Tell which runs meet the criterion."""
    return np.asarray(
        (np.abs(errors[..., 0]) < 0.1 * 20_000.0)
        & (np.abs(errors[..., 2]) < 3.0 * KNOT_MPS)
        & (np.abs(errors[..., 3]) < np.radians(7.0))
    )


def fit_from_truth(problem: Problem, truth: FloatArray) -> DescentResult:
    """Fit every record of a problem, starting at the truth."""
    count = problem.bearing_rad.shape[0]
    parts = []
    for first in range(0, count, CHUNK):
        member = np.arange(first, min(first + CHUNK, count))
        start = np.repeat(truth[np.newaxis], member.size, axis=0)
        parts.append(minimise(problem, start, WIDE, member=member))
    return DescentResult.join(parts)


def accuracy(name: str, noise: float, rows: int, runs: int, seed: int) -> Accuracy:
    """Run the maximum-likelihood estimator many times.

    ``noise``: multiple of the deviations.
    """
    scenario = make_scenario(name)
    truth = scenario.solution()
    problem = make_problem(scenario, noise=noise, runs=runs, seed=seed)
    problem = problem.rows(slice(0, rows))
    fit = fit_from_truth(problem, truth)
    errors = motion_errors(fit.q, scenario)
    here = misfit_value(
        problem,
        np.repeat(to_state(truth)[np.newaxis], runs, axis=0),
        np.full((runs, 1), REST_HZ),
        np.arange(runs),
    )
    covariance = information(problem.record(0), truth).covariance()
    rest_errors = fit.rest_hz - REST_HZ
    return Accuracy(
        errors=errors,
        rest_errors=rest_errors,
        bound=np.sqrt(np.diagonal(covariance)),
        success=succeeded(errors),
        chi_square=fit.value,
        rise=here - fit.value,
        nees=_squared_sigmas(problem, fit.q, np.hstack([errors, rest_errors])),
    )


def _squared_sigmas(problem: Problem, q: FloatArray, errors: FloatArray) -> FloatArray:
    found = [information(problem.record(i), row) for i, row in enumerate(q)]
    back = [np.linalg.solve(one.turn, e) for one, e in zip(found, errors, strict=True)]
    return np.array([e @ one.bread @ e for one, e in zip(found, back, strict=True)])


def follow(name: str, noise: float, runs: int, seed: int) -> tuple[IntArray, BoolArray]:
    """Estimate sequentially; tell after which rows which run meets the criterion.

    Warm descents of three steps follow the record; at 20, 80 and 320 rows every run
    starts again from many points.
    """
    scenario = make_scenario(name)
    problem = make_problem(scenario, noise=noise, runs=runs, seed=seed)
    ends = np.arange(20, 1001, 10)
    member = np.arange(runs)
    again = 20
    q: FloatArray = np.zeros((runs, 4))
    met = np.zeros((ends.size, runs), dtype=bool)
    for k, end in enumerate(ends):
        part = problem.rows(slice(0, int(end)))
        if end >= again:
            again *= 4
            q = np.stack([
                multistart(part.record(i), PAPER, counts=StartCounts(12, 2)).q[0]
                for i in range(runs)
            ])  # fmt: skip
        else:
            q = minimise(part, q, PAPER, member=member, iterations=3).q
        met[k] = succeeded(motion_errors(q, scenario))
    return ends, met


def rows_until(ends: IntArray, met: BoolArray, share: float = 0.9) -> float:
    """Return the first length from which a share of runs always meets the criterion."""
    enough = met.mean(1) >= share
    lasting = np.flip(np.logical_and.accumulate(np.flip(enough)))
    return float(ends[lasting.argmax()]) if lasting.any() else float("nan")


def convergence_index(ends: IntArray, met: BoolArray) -> FloatArray:
    """Return the length from which each run meets the criterion to its end.

    A run that ends outside has the index infinity.
    """
    lasting = np.flip(np.logical_and.accumulate(np.flip(met, 0), axis=0), 0)
    first = ends[lasting.argmax(0)].astype(np.float64)
    return np.asarray(np.where(lasting.any(0), first, np.inf))


class SingleShots(NamedTuple):
    """What a hybrid reaches from whole records at once."""

    is_met: BoolArray
    """Whether a run met the criterion, shape (run,)."""
    is_reached: BoolArray
    """Whether it found the global minimum, shape (run,)."""
    evaluations: float
    """Mean number of evaluations."""


def single_shots(name: str, noise: float, runs: int, seed: int, search: Global) -> SingleShots:
    """Invert whole records once by a hybrid."""
    scenario = make_scenario(name)
    problem = make_problem(scenario, noise=noise, runs=runs, seed=seed)
    best = fit_from_truth(problem, scenario.solution()).value
    rng = np.random.default_rng(seed)
    found = hybrid_search(problem, PAPER_BOX, runs, rng, search=search)
    errors = motion_errors(to_solver(found.point), scenario)
    return SingleShots(
        succeeded(errors), np.asarray(found.value - best < 1e-3), float(found.evaluations.mean())
    )


def with_feedback(name: str, noise: float, runs: int, seed: int, search: Global) -> BoolArray:
    """Invert ten growing records by a hybrid, each fed with the solution before."""
    scenario = make_scenario(name)
    problem = make_problem(scenario, noise=noise, runs=runs, seed=seed)
    rng = np.random.default_rng(seed)
    feedback: FloatArray | None = None
    for end in range(100, 1001, 100):
        part = problem.rows(slice(0, end))
        feedback = hybrid_search(part, PAPER_BOX, runs, rng, search=search, feedback=feedback).point
    points = np.empty((runs, 5)) if feedback is None else feedback
    return succeeded(motion_errors(to_solver(points), scenario))


def one_record(name: str, noise: float, seed: int) -> Problem:
    """Return one record of a scenario."""
    return make_problem(make_scenario(name), noise=noise, runs=1, seed=seed)


def solve_by_descent(problem: Problem) -> FloatArray:
    """Solve one record by the multi-start descent."""
    return np.asarray(multistart(problem, PAPER).q[0])


def solve_by_peer(problem: Problem, peer: str, seed: int) -> FloatArray:
    """Solve one record by a global optimiser of scipy, on the same misfit."""
    from scipy.optimize import Bounds, differential_evolution, dual_annealing

    objective = PenalisedMisfit(problem, PAPER_BOX)
    single = np.zeros(1, dtype=np.int64)
    bounds = Bounds(PAPER_BOX.lower, PAPER_BOX.upper)

    def value(point: FloatArray) -> float:
        return float(objective(point[np.newaxis], single)[0])

    place: FloatArray
    if peer == "differential_evolution":
        place = differential_evolution(value, bounds, seed=seed).x
    else:
        place = np.asarray(dual_annealing(value, bounds, seed=seed).x)
    return np.asarray(to_solver(place[np.newaxis])[0])


def cpu_of(task: Callable[[], object], repeats: int = 1) -> float:
    """Return the CPU time of a task, s: the least of some repeats."""
    spent = []
    for _ in range(repeats):
        start = process_time()
        task()
        spent.append(process_time() - start)
    return min(spent)
