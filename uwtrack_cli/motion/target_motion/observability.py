"""Fisher information and observability: what the data can and cannot determine.

**Method.** J^T W J of bearings and frequencies, kept apart, in the state and the
rest frequencies; its inverse is the Cramer-Rao bound (Van Trees 1968, eq. 2.4.2).
Under a robust loss, or the paper's mean over lines, bread and meat differ and the
covariance is the sandwich B^-1 M B^-1 (Huber 1967). The eigenvalues of the
information, scaled to unit diagonal, give rank and condition; the eigenvector of the
smallest gives the combination of parameters that changes the fit least (Jauffret &
Pillon 1996). The condition number does not rank cases: deviations and the probability
of a stated accuracy do.

**Conventions.** Parameters p are (range, bearing, speed, course, rest frequencies)
in SI; solver coordinates q likewise, rest frequencies after the motion.
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.data.base import BoolArray, FloatArray
from uwtrack_cli.motion.target_motion.model import (
    PER_ALTERATION,
    STRAIGHT,
    motion_jacobian,
    state_jacobian,
    to_state,
)
from uwtrack_cli.motion.target_motion.objective import (
    Residuals,
    loss_curvature,
    loss_weight,
    motion_prior,
    residuals,
)
from uwtrack_cli.motion.target_motion.own_ship import ObserverTrack
from uwtrack_cli.motion.target_motion.problem import Problem

RANK_THRESHOLD = 1e-13
"""Relative size of an eigenvalue of the unit-diagonal information that counts as 0."""


@dataclass(frozen=True, eq=False)
class Information:
    """Information of one motion: bread and meat in solver coordinates."""

    bread: FloatArray
    """Curvature of the misfit in solver coordinates, shape (p, p)."""
    meat: FloatArray
    """Covariance of its gradient, shape (p, p)."""
    turn: FloatArray
    """Partials of range, bearing, speed and course by the solver coordinates, shape
    (p, p)."""
    has_delays: bool = False
    """Whether the last parameter is the factor of the depths of a reflected path."""

    def covariance(self, *, people: bool = True) -> FloatArray:
        """Return the covariance of (R, bearing, speed, course, rest) or of q."""
        inverse = self.inverse()
        covariance = inverse @ self.meat @ inverse
        return self.turn @ covariance @ self.turn.T if people else covariance

    def inverse(self) -> FloatArray:
        """Return the inverse of the bread, singular directions left out."""
        return scaled_inverse(self.bread)

    def unit_diagonal(self) -> tuple[FloatArray, FloatArray]:
        """Return the information in p, scaled to unit diagonal, and the scales."""
        back = np.linalg.inv(self.turn)
        matrix = back.T @ self.bread @ back
        scale = np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
        return matrix / np.outer(scale, scale), scale

    def eigenvalues(self) -> FloatArray:
        """Return the eigenvalues of the unit-diagonal information, ascending."""
        return np.asarray(np.linalg.eigvalsh(self.unit_diagonal()[0]))

    @property
    def rank(self) -> int:
        """Number of parameter combinations that the data determine."""
        values = self.eigenvalues()
        return int(np.count_nonzero(values > RANK_THRESHOLD * values[-1]))

    @property
    def condition(self) -> float:
        """Condition number of the unit-diagonal information; inf when singular."""
        values = self.eigenvalues()
        lost = values[0] <= RANK_THRESHOLD * values[-1]
        return float("inf") if lost else float(values[-1] / values[0])


def information(problem: Problem, q: FloatArray) -> Information:
    """Return the information of the data about a motion."""
    trial = q[np.newaxis]
    r = residuals(problem, trial)
    bread, meat = _bread_and_meat(problem, r)
    own, size = q.size, q.size + problem.n_lines
    expected = motion_prior(problem, to_state(trial))[1][0]
    bread[:own, :own] += expected.T @ expected
    meat[:own, :own] += expected.T @ expected
    place = np.arange(own, size)
    bread[place, place] += problem.rest_precision
    meat[place, place] += problem.rest_precision
    chain, turn = np.eye(size), np.eye(size)
    chain[:own, :own] = state_jacobian(trial)[0]
    turn[:own, :own] = motion_jacobian(trial)[0]
    return Information(
        chain.T @ bread @ chain, chain.T @ meat @ chain, turn, problem.bounce is not None
    )


def design_rows(problem: Problem, r: Residuals) -> FloatArray:
    """Whitened Jacobian in state and rest frequencies (stream or line, row, p).

    What an offset of a stream would take up is projected out.
    """
    rows = _plain_rows(problem, r)
    if problem.offset_std_rad is None:
        return rows
    streams = len(problem.bearing_weight)
    pull = offset_pull(problem, r)
    rows[:streams] -= problem.bearing_weight[:, :, np.newaxis] * pull[:, np.newaxis, :]
    return rows


def offset_pull(problem: Problem, r: Residuals) -> FloatArray:
    """Return how the offsets follow the state, rad per unit, shape (streams, p)."""
    rows = _plain_rows(problem, r)[: len(problem.bearing_weight)]
    weight = problem.bearing_weight
    slope = series_slopes(problem, r)[: len(weight)]
    total = slope * (weight**2).sum(1) + problem.offset_precision
    gathered = slope[:, np.newaxis] * np.einsum("sn,snp->sp", weight, rows)
    return np.asarray(gathered / total[:, np.newaxis])


def _plain_rows(problem: Problem, r: Residuals) -> FloatArray:
    bearing = r.prediction.bearing_jacobian[0]
    own = len(bearing)
    streams = problem.bearing_weight.shape[0]
    rows = np.zeros((streams + problem.n_lines, problem.n_rows, own + problem.n_lines))
    sided = problem.bearing_weight * r.side[0]
    rows[:streams, :, :own] = sided[:, :, np.newaxis] * bearing.T[np.newaxis]
    for one in r.scaled:
        partials = (one.slope[0] * one.jacobian[0]).T
        for line in range(problem.n_lines)[one.lines]:
            weight = problem.frequency_weight[line]
            slope = weight[:, np.newaxis] * r.rest_hz[0, line] * partials
            rows[streams + line, :, :own] = slope
            rows[streams + line, :, own + line] = weight * one.shape[0]
    return rows


def misfit_scale(problem: Problem, q: FloatArray) -> float:
    """Return the scale of likelihood ratios under the loss: 1 for least squares."""
    found = information(problem, q)
    return float(np.trace(np.linalg.pinv(found.bread) @ found.meat) / len(found.bread))


def series_slopes(problem: Problem, r: Residuals) -> FloatArray:
    """Return the mean curvature of the loss of every series, shape (series,)."""
    z = np.concatenate([r.bearing[0], r.frequency[0]])
    measured = np.concatenate([problem.bearing_weight, problem.frequency_weight]) > 0
    # means per series: the curvature of a single residual can be negative
    count = np.maximum(np.count_nonzero(measured, axis=1), 1)
    curvature = loss_curvature(z, problem.loss)
    return np.asarray(np.sum(curvature * measured, axis=1) / count)


def _bread_and_meat(problem: Problem, r: Residuals) -> tuple[FloatArray, FloatArray]:
    rows = design_rows(problem, r)
    z = np.concatenate([r.bearing[0], r.frequency[0]])
    streams = problem.bearing_weight.shape[0]
    share = np.concatenate([np.ones(streams), problem.line_share])
    measured = np.concatenate([problem.bearing_weight, problem.frequency_weight]) > 0
    influence = (loss_weight(z, problem.loss) * z) ** 2
    if problem.loss == "squares":
        influence = np.ones_like(z)
    count = np.maximum(np.count_nonzero(measured, axis=1), 1)
    slope = series_slopes(problem, r)
    power = np.sum(influence * measured, axis=1) / count
    parts = np.swapaxes(rows, 1, 2) @ rows
    bread = np.tensordot(slope, parts, axes=1)
    meat = np.tensordot(power * share, parts, axes=1)
    if problem.offset_std_rad is not None:
        pull = offset_pull(problem, r)
        precision = np.where(np.isfinite(problem.offset_precision), problem.offset_precision, 0.0)
        prior = np.einsum("s,sp,sq->pq", precision, pull, pull)
        bread, meat = bread + prior, meat + prior
    return bread, meat


def scaled_inverse(matrix: FloatArray) -> FloatArray:
    """Return the inverse of an information matrix, singular directions left out."""
    scale = np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    unit = matrix / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(unit)
    # a singular direction is left out: the rest keeps its true deviation
    kept = np.where(values > RANK_THRESHOLD * values[-1], values, np.inf)
    return np.asarray((vectors / kept) @ vectors.T / np.outer(scale, scale))


def criterion_probability(
    covariance: FloatArray, half_widths: FloatArray, order: int = 48
) -> float:
    """Return the probability that three Gaussian errors stay within bounds at once.

    Notes
    -----
    Genz 1992 (J. Comput. Graph. Stat. 1, 141), transformed to the unit square and
    integrated with Gauss-Legendre nodes instead of random ones.
    """
    from scipy.special import ndtr, ndtri

    std = np.sqrt(np.maximum(np.diagonal(covariance), 1e-300))
    # fully correlated errors would make the root fail
    values, vectors = np.linalg.eigh(covariance / np.outer(std, std))
    correlation = (vectors * np.maximum(values, 1e-9)) @ vectors.T
    root = np.linalg.cholesky(correlation) * (std / half_widths)[:, np.newaxis]
    nodes, weights = np.polynomial.legendre.leggauss(order)
    u, w = (nodes + 1.0) / 2.0, weights / 2.0
    high = ndtr(1.0 / root[0, 0])
    first = high - ndtr(-1.0 / root[0, 0])
    z1 = ndtri(1.0 - high + u * first)[:, np.newaxis]
    low2 = ndtr((-1.0 - root[1, 0] * z1) / root[1, 1])
    second = ndtr((1.0 - root[1, 0] * z1) / root[1, 1]) - low2
    z2 = ndtri(np.clip(low2 + u * second, 1e-300, 1.0 - 1e-16))
    shift = root[2, 0] * z1 + root[2, 1] * z2
    third = ndtr((1.0 - shift) / root[2, 2]) - ndtr((-1.0 - shift) / root[2, 2])
    return float(first * np.sum(w[:, np.newaxis] * w * second * third))


RANGE_CRITERION = 0.10
SPEED_CRITERION_MPS = 3.0 * KNOT_MPS
COURSE_CRITERION_RAD = np.radians(7.0)
TOUCHED = 1e-6
"""Share of a parameter in a singular direction above which it is not observable."""

STRAIGHT_M = 5.0
"""Departure from a straight and steady track that counts as a manoeuvre, m."""


@dataclass(frozen=True, eq=False)
class Observability:
    """Rank, condition, weakest direction, chance of the criterion."""

    rank: int
    """Number of parameter combinations that the data determine."""
    n_parameters: int
    """Number of parameters sought."""
    condition: float
    """Condition number of the unit-diagonal information; inf when singular."""
    weakest: str
    """The combination that the data determine least, in words."""
    probability: float
    """Chance of range in 10 %, speed in 3 kn and course in 7 degrees."""
    observable: BoolArray
    """Which of range, bearing, speed, course and rest frequencies no singular
    direction touches, shape (p,)."""


def assess(found: Information, motion: FloatArray) -> Observability:
    """Assess the observability of a motion (R, bearing, speed, course), SI."""
    unit, scale = found.unit_diagonal()
    values, vectors = np.linalg.eigh(unit)
    lost = values <= RANK_THRESHOLD * values[-1]
    observable = ~np.any(np.abs(vectors[:, lost]) > TOUCHED, axis=1)
    spread = 1.0 / np.sqrt(max(float(values[0]), 1e-300))
    direction = vectors[:, 0] / scale * spread
    lines = [f"line {i + 1}" for i in range(values.size - motion.size)]
    if found.has_delays:
        lines[-1] = "factor of depths"
    probability = 0.0
    if not lost.any():
        probability = accuracy_probability(found.covariance(), float(motion[0]))
    return Observability(
        rank=int(np.count_nonzero(~lost)),
        n_parameters=values.size,
        condition=found.condition,
        weakest=_in_words(direction, float(motion[0]), lines, singular=bool(lost.any())),
        probability=probability,
        observable=observable,
    )


def accuracy_probability(covariance: FloatArray, range_m: float) -> float:
    """Return the chance of range in 10 %, speed in 3 kn and course in 7 degrees."""
    chosen = np.ix_([0, 2, 3], [0, 2, 3])
    bounds = [RANGE_CRITERION * range_m, SPEED_CRITERION_MPS, COURSE_CRITERION_RAD]
    return criterion_probability(covariance[chosen], np.array(bounds))


def _in_words(direction: FloatArray, range_m: float, lines: list[str], *, singular: bool) -> str:
    """Write a direction; a singular one scaled to the largest readable change."""
    n_alterations = (direction.size - len(lines)) // PER_ALTERATION - 1
    readable = np.concatenate([
        [100.0 * direction[0] / range_m],
        [direction[2] / KNOT_MPS],
        np.degrees(direction[[3, 1]]),
        direction[STRAIGHT:],
    ])  # fmt: skip
    if singular:
        readable = readable * (10.0 / max(np.abs(readable).max(), 1e-300))
    readable = readable * (1.0 if readable[np.abs(readable).argmax()] >= 0 else -1.0)
    units = ["%", "kn", "deg", "deg", *(("m/s", "m/s", "s", "log s") * n_alterations)]
    names = ["range", "speed", "course", "bearing"]
    for number in range(1, n_alterations + 1):
        changes = ("east", "north", "time", "duration")
        names += [f"alteration {number} {change}" for change in changes]
    units += ["Hz" if line.startswith("line") else "" for line in lines]
    names += lines
    least = 1e-6 if singular else 0.0
    return ", ".join(
        f"{name} {value:+.3g} {unit}".rstrip()
        for name, value, unit in zip(names, readable, units, strict=True)
        if abs(value) > least
    )


def is_manoeuvring(track: ObserverTrack) -> bool:
    """Return whether own ship leaves a straight track at constant speed."""
    if track.time_s.size < 3:
        return False
    off = 0.0
    for place in (track.east_m, track.north_m):
        line = np.polyfit(track.time_s, place, 1)
        off = max(off, float(np.abs(place - np.polyval(line, track.time_s)).max()))
    return off > STRAIGHT_M
