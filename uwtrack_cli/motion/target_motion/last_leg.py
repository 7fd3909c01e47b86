"""The state now of a target that changed its velocity once: its last leg.

**Method.** A target that has the velocity v after the instant s and v - dv before it is
seen from own ship as one that always has v is from a platform which before s lags behind
by dv (s - t). So the model of a straight target serves both legs: own ship's track is
bent, and the unknowns of the straight motion are those of the last leg. They are fitted
together with dv and s (Levenberg-Marquardt from several instants), and their covariance
holds that of both.

**Conventions.** The motion is that of the last leg, run back to the first measurement:
its range and bearing there mean nothing, those at the last measurement do. Times count
from the first measurement.
"""

from dataclasses import dataclass, replace

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.motion.target_motion.manoeuvre import Manoeuvre
from uwtrack_cli.motion.target_motion.model import state_jacobian, to_motion
from uwtrack_cli.motion.target_motion.modes import (
    ModeAnswer,
    Modes,
    TmaOptions,
    describe_mode,
    last_position,
)
from uwtrack_cli.motion.target_motion.objective import loss_weight, misfit, residuals
from uwtrack_cli.motion.target_motion.observability import design_rows, information
from uwtrack_cli.motion.target_motion.problem import Problem
from uwtrack_cli.motion.target_motion.solvers.marquardt import SearchBounds

CHANGE_STD_MPS = 4.0
"""Deviation of each component of the change before the fit."""

STARTS = (-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3)
"""Where the instant starts from, beside that of the score test, in lengths of the
record."""

EDGE = 0.02
"""Share of the record at either end in which no start lies."""

STEPS, TOLERANCE = 40, 1e-3
SHARE_OF_GAIN = 0.5
"""Share of the gain of the score test that the fit of both legs must have."""

LARGEST_SHARE = 0.5
"""Deviation of the range now, as a share, above which it is not given."""

VELOCITY_STEP_MPS, TIME_STEP = 1e-4, 1e-5
"""Steps of the differences; that of the instant in lengths of the record."""


@dataclass(frozen=True)
class _Trial:
    """Both legs: the last one, and how the one before differs."""

    q: FloatArray
    """Last leg in solver coordinates, shape (4,)."""
    change: FloatArray
    """Change of velocity, east and north, m/s, and its instant, s, shape (3,)."""

    def moved(self, step: FloatArray) -> "_Trial":
        return _Trial(self.q + step[:4], self.change + step[4:])


def bent(problem: Problem, change: FloatArray) -> Problem:
    """Return the problem in which the last leg is a straight motion.

    The change of velocity is east and north, m/s, and its instant, s, shape (3,).
    """
    track = problem.track
    early = np.maximum(change[2] - track.time_s, 0.0)
    before = track.time_s[track.now] < change[2]
    moved = replace(
        track,
        east_m=track.east_m - change[0] * early,
        north_m=track.north_m - change[1] * early,
        velocity_mps=track.velocity_mps + change[:2, np.newaxis] * before,
    )
    return replace(problem, track=moved)


def find_last_leg(
    problem: Problem,
    q: FloatArray,
    limits: SearchBounds,
    found: Manoeuvre,
    options: TmaOptions,
) -> ModeAnswer | None:
    """Fit both legs; None where they do not tell the state now.

    The best straight motion asks for a change of velocity, ``found``.
    """
    span = float(problem.row_time_s[-1])
    straight = _value(problem, _Trial(q, np.array([0.0, 0.0, found.time_s])))
    trials = []
    for share in STARTS:
        at = found.time_s + share * span
        if EDGE * span < at < (1.0 - EDGE) * span:
            start = _Trial(q, np.array([0.0, 0.0, at]))
            trials.append(_descend(problem, start, limits, span))
    trials.sort(key=lambda pair: pair[1])
    if not trials or straight - trials[0][1] < SHARE_OF_GAIN * found.gain:
        return None
    return _described(problem, trials, limits, options)


def _value(problem: Problem, trial: _Trial) -> float:
    """Return the misfit of both legs with the prior of the change."""
    own = misfit(bent(problem, trial.change), trial.q[np.newaxis]).value[0]
    return float(own + (trial.change[:2] ** 2).sum() / CHANGE_STD_MPS**2)


def _descend(
    problem: Problem, start: _Trial, limits: SearchBounds, span_s: float
) -> tuple[_Trial, float]:
    """Minimise from one start; steps that leave the record or the limits are cut.

    At every row the misfit has a kink in the instant, where a step often fails: so the
    partials are formed only after a step that was kept. With them in every evaluation,
    as `damped_least_squares` asks for, a fit costs 1.4 times as much, and of fifteen
    drawn manoeuvres it ends higher by 12 to 161 in four.
    """
    trial, value = start, _value(problem, start)
    damping = 1e-3
    precision = np.zeros(7)
    precision[4:6] = CHANGE_STD_MPS**-2.0
    for _ in range(STEPS):
        rows, z = _linear(problem, trial, span_s)
        matrix = rows.T @ rows
        size = matrix.shape[0]
        prior = np.zeros(size)
        prior[[*range(4), *range(size - 3, size)]] = precision
        own = np.zeros(size)
        own[size - 3 : size - 1] = trial.change[:2] * CHANGE_STD_MPS**-2.0
        matrix[range(size), range(size)] += prior
        gradient = rows.T @ z + own
        improved = False
        while damping < 1e8:
            damped = matrix + damping * np.diag(np.maximum(np.diag(matrix), 1e-12))
            step = -np.linalg.solve(damped, gradient)
            step = step[[*range(4), *range(size - 3, size)]]
            step[6] = np.clip(step[6], -0.1 * span_s, 0.1 * span_s)
            next_one = trial.moved(step)
            inside = 0.0 < next_one.change[2] < span_s
            lower, upper = limits.lower, limits.upper
            inside &= bool(np.all((next_one.q >= lower) & (next_one.q <= upper)))
            now = _value(problem, next_one) if inside else np.inf
            if now < value:
                improved = value - now > TOLERANCE
                trial, value, damping = next_one, now, 0.2 * damping
                break
            damping *= 5.0
        if not improved:
            break
    return trial, value


def _linear(
    problem: Problem, trial: _Trial, span_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return partials and residuals, whitened and weighted by the loss.

    Columns: the last leg, rest frequencies, change of velocity, instant.
    """
    now = bent(problem, trial.change)
    q = trial.q[np.newaxis]
    r = residuals(now, q)
    count = 4 + problem.n_lines
    chain = np.eye(count)
    chain[:4, :4] = state_jacobian(q)[0]
    own = (design_rows(now, r) @ chain).reshape(-1, count)
    steps = np.diag([VELOCITY_STEP_MPS, VELOCITY_STEP_MPS, TIME_STEP * span_s])
    columns = []
    for place, step in enumerate(steps):
        ends = [
            residuals(bent(problem, trial.change + sign * step), q, rest_hz=r.rest_hz)
            for sign in (1.0, -1.0)
        ]
        ahead, behind = (_flat(end.bearing[0], end.frequency[0]) for end in ends)
        columns.append((ahead - behind) / (2.0 * step[place]))
    z = _flat(r.bearing[0], r.frequency[0])
    root = np.sqrt(np.maximum(loss_weight(z, problem.loss), 0.0))
    rows = np.column_stack([own, *columns]) * root[:, np.newaxis]
    return rows, z * root


def _flat(bearing: FloatArray, frequency: FloatArray) -> FloatArray:
    return np.concatenate([bearing.ravel(), frequency.ravel()])


def _described(
    problem: Problem,
    trials: list[tuple[_Trial, float]],
    limits: SearchBounds,
    options: TmaOptions,
) -> ModeAnswer | None:
    """Say what the last leg is, with the deviations of the change in its own.

    What other minima say enters with their likelihoods.
    """
    trial, least = trials[0]
    now = bent(problem, trial.change)
    r = residuals(now, trial.q[np.newaxis])
    one = Modes(
        trial.q[np.newaxis],
        r.rest_hz,
        misfit(now, trial.q[np.newaxis]).value,
        np.ones(1),
    )
    answer = describe_mode(now, limits, one, 0, options, scale=1.0)
    rows, _ = _linear(problem, trial, float(problem.row_time_s[-1]))
    matrix = rows.T @ rows
    size = matrix.shape[0] - 3
    alone = _inverse(matrix[:size, :size])
    matrix[range(size, size + 2), range(size, size + 2)] += CHANGE_STD_MPS**-2.0
    joint = _inverse(matrix)
    if alone is None or joint is None:
        return None
    added = joint[:size, :size] - alone
    # noise with a memory widens what both legs tell as it widens one
    known = np.diag(alone)[:4]
    coloured = np.diag(answer.solver_covariance)[:4] / np.maximum(known, 1e-300)
    inner = answer.solver_covariance + max(float(np.median(coloured)), 1.0) * added
    away = np.zeros((len(trials), size))
    away[:, :4] = [other.q - trial.q for other, _ in trials]
    away[:, 1] = wrap_rad(away[:, 1])
    chance = np.exp(-0.5 * np.array([value - least for _, value in trials]))
    inner = inner + (away.T * (chance / chance.sum())) @ away
    turn = information(now, trial.q).turn
    place, std = last_position(now, trial.q, inner)
    if not std[0] < LARGEST_SHARE * place[0]:
        return None
    return replace(
        answer,
        covariance=turn @ inner @ turn.T,
        solver_covariance=inner,
        now=place,
        now_std=std,
    )


def _inverse(matrix: FloatArray) -> FloatArray | None:
    """Invert a symmetric matrix; None where it is singular."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    unit = matrix / np.outer(scale, scale)
    if np.linalg.eigvalsh(unit)[0] < 1e-12:
        return None
    return np.asarray(np.linalg.inv(unit) / np.outer(scale, scale))


def state_now(mode: ModeAnswer) -> tuple[FloatArray, FloatArray]:
    """Return range, bearing, speed and course now, SI, and their deviations."""
    std = np.sqrt(np.maximum(np.diagonal(mode.covariance)[2:4], 0.0))
    state = np.concatenate([mode.now, to_motion(mode.q)[2:4]])
    return state, np.concatenate([mode.now_std, std])
