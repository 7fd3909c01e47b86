"""Misfit of trial motions, its gradient, and normal equations in one pass.

**Method.** Sum over all measurements of the loss of the whitened residuals
(Chang et al. 2003, eq. 4, corrected: a sum over lines, wrapped angles). The rest
frequencies enter linearly and are projected out (Golub & Pereyra 1973): given a
motion they have a closed form, and the normal equations of the motion are the
Schur complement of theirs.

**Conventions.** ``member`` says which record of the problem a trial belongs to.
Gradients are half those of the misfit. Every loss is z^2 near zero, so that the sums
compare. Tuning constants give 95 % efficiency on Gaussian noise (Huber 1981; Beaton &
Tukey 1974); Student's t has four degrees of freedom (Lange et al. 1989).
"""

from dataclasses import dataclass

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.motion.target.model import (
    Prediction,
    predict,
    predict_values,
    state_jacobian,
    to_state,
)
from uwtrack_cli.motion.target.problem import Loss, Problem

HUBER, TUKEY, STUDENT = 1.345, 4.685, 4.0


def loss_value(z: FloatArray, loss: Loss) -> FloatArray:
    """Return the loss of standardised residuals, element by element.

    Parameters
    ----------
    z
        Residuals divided by their standard deviations.
    loss
        Which loss.
    """
    if loss == "huber":
        size = np.abs(z)
        return np.where(size <= HUBER, z * z, HUBER * (2.0 * size - HUBER))
    if loss == "student":
        return np.asarray(STUDENT * np.log1p(z * z / STUDENT))
    if loss == "tukey":
        rest = np.clip(1.0 - (z / TUKEY) ** 2, 0.0, None)
        return np.asarray(TUKEY**2 / 3.0 * (1.0 - rest**3))
    return z * z


def loss_weight(z: FloatArray, loss: Loss) -> FloatArray:
    """Return the weight of a residual, half the slope of its loss over itself."""
    if loss == "huber":
        return np.asarray(HUBER / np.maximum(np.abs(z), HUBER))
    if loss == "student":
        return STUDENT / (STUDENT + z * z)
    if loss == "tukey":
        return np.asarray(np.clip(1.0 - (z / TUKEY) ** 2, 0.0, None) ** 2)
    return np.ones_like(z)


def loss_curvature(z: FloatArray, loss: Loss) -> FloatArray:
    """Return half the second derivative of the loss."""
    if loss == "huber":
        return np.where(np.abs(z) <= HUBER, 1.0, 0.0)
    if loss == "student":
        return STUDENT * (STUDENT - z * z) / (STUDENT + z * z) ** 2
    if loss == "tukey":
        ratio = (z / TUKEY) ** 2
        return np.where(ratio < 1.0, (1.0 - ratio) * (1.0 - 5.0 * ratio), 0.0)
    return np.ones_like(z)


REWEIGHTINGS = 3
"""Passes that bring rest frequencies to the minimum of a robust loss."""


@dataclass(frozen=True, eq=False)
class ProfiledMisfit:
    """Misfit of each trial with the rest frequencies at their best."""

    value: FloatArray
    """Misfit, shape (trials,)."""
    gradient: FloatArray
    """Half its gradient, shape (trials, 4)."""
    matrix: FloatArray
    """Gauss-Newton matrix, shape (trials, 4, 4)."""
    rest_hz: FloatArray
    """Best rest frequencies, Hz, shape (trials, lines)."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """Model against data: whitened residuals."""

    bearing: FloatArray
    """Whitened residuals of the bearings, shape (trials, streams, rows)."""
    frequency: FloatArray
    """Whitened residuals of the frequencies, shape (trials, lines, rows)."""
    factor: FloatArray
    """Doppler factor 1 - rate / c, shape (trials, rows)."""
    side: FloatArray
    """Sign by which an array's folded bearing answers the true one."""
    rest_hz: FloatArray
    """Rest frequencies, Hz, shape (trials, lines)."""
    prediction: Prediction
    """The model's bearings and range rates."""


def residuals(
    problem: Problem,
    q: FloatArray,
    member: IntArray | None = None,
    *,
    polar: bool = False,
    rest_hz: FloatArray | None = None,
) -> Residuals:
    """Compare trial motions with the data.

    Parameters
    ----------
    problem
        The data.
    q
        Trial motions in solver coordinates, one per row.
    member
        Record of each trial; None if there is only one record.
    polar
        Whether the velocity is given as speed and course.
    rest_hz
        Rest frequencies (trial, line), Hz; None for the best ones.
    """
    state = to_state(q, polar=polar)
    prediction = predict(problem.track, state, medium_of(problem))
    bearing_data, frequency_data = problem.bearing_rad, problem.frequency_hz
    if member is not None and bearing_data.shape[0] > 1:
        bearing_data, frequency_data = bearing_data[member], frequency_data[member]
    heading = problem.array_heading_rad
    side = np.ones((1, 1))
    if heading is None:
        off = wrap_rad(prediction.bearing_rad[:, np.newaxis] - bearing_data)
    else:
        relative = wrap_rad(prediction.bearing_rad - heading)
        side = np.sign(relative)
        folded = np.abs(wrap_rad(bearing_data - heading))
        off = np.abs(relative)[:, np.newaxis] - folded
    factor = 1.0 - prediction.rate_mps / problem.sound_speed_mps
    if rest_hz is None:
        rest_hz = _rest_frequencies(problem, factor, frequency_data)
    frequency = rest_hz[:, :, np.newaxis] * factor[:, np.newaxis] - frequency_data
    return Residuals(
        off * problem.bearing_weight,
        frequency * problem.frequency_weight,
        factor,
        side,
        rest_hz,
        prediction,
    )


def medium_of(problem: Problem) -> Medium:
    """Return sound speed, depths and delay of a problem."""
    return Medium(problem.sound_speed_mps, problem.height_m, problem.delayed)


def _rest_frequencies(
    problem: Problem, factor: FloatArray, data_hz: FloatArray
) -> FloatArray:
    """Solve for the rest frequencies: f0 = sum w g f / sum w g^2."""
    weight = problem.frequency_weight**2
    if problem.loss == "squares":
        weighted = weight * data_hz
        if data_hz.shape[0] == 1:
            top = factor @ weighted[0].T
        else:
            top = (weighted @ factor[:, :, np.newaxis])[:, :, 0]
        return np.asarray(top / np.maximum((factor**2) @ weight.T, 1e-300))
    rest = _median_rest(problem, factor, data_hz)
    for _ in range(REWEIGHTINGS):
        z = rest[:, :, np.newaxis] * factor[:, np.newaxis] - data_hz
        robust = weight * loss_weight(z * problem.frequency_weight, problem.loss)
        lower = (robust * factor[:, np.newaxis] ** 2).sum(-1)
        upper = (robust * factor[:, np.newaxis] * data_hz).sum(-1)
        rest = np.where(lower > 0, upper / np.maximum(lower, 1e-300), rest)
    return rest


def _median_rest(
    problem: Problem, factor: FloatArray, data_hz: FloatArray
) -> FloatArray:
    single = data_hz / factor[:, np.newaxis]
    columns = []
    for line, weight in enumerate(problem.frequency_weight):
        heard = weight > 0
        some = single[:, line, heard]
        empty = np.zeros(single.shape[0])
        columns.append(np.median(some, axis=-1) if heard.any() else empty)
    return np.stack(columns, -1) if columns else np.empty((single.shape[0], 0))


def misfit(
    problem: Problem,
    q: FloatArray,
    member: IntArray | None = None,
    *,
    polar: bool = False,
) -> ProfiledMisfit:
    """Return misfit, half gradient and Gauss-Newton matrix of trial motions.

    Parameters
    ----------
    problem
        The data.
    q
        Trial motions in solver coordinates, one per row.
    member
        Record of each trial; None if there is only one record.
    polar
        Whether the velocity is given as speed and course.

    Notes
    -----
    With A, b, d the blocks of the normal equations of motion and rest
    frequencies: the matrix is A - b d^-1 b^T (Golub & Pereyra 1973).
    """
    r = residuals(problem, q, member, polar=polar)
    value = loss_value(r.bearing, problem.loss).sum((1, 2))
    value += loss_value(r.frequency, problem.loss).sum((1, 2))
    blocks = normal_blocks(problem, r)
    chain = state_jacobian(q, polar=polar)
    safe = np.where(blocks.rest_matrix > 0, blocks.rest_matrix, np.inf)
    cross = blocks.cross / safe[:, np.newaxis]
    matrix = blocks.matrix - cross @ np.swapaxes(blocks.cross, 1, 2)
    gradient = (
        blocks.gradient - (cross @ blocks.rest_gradient[:, :, np.newaxis])[..., 0]
    )
    turned = np.swapaxes(chain, 1, 2)
    return ProfiledMisfit(
        value,
        (turned @ gradient[:, :, np.newaxis])[:, :, 0],
        turned @ matrix @ chain,
        r.rest_hz,
    )


@dataclass(frozen=True, eq=False)
class NormalBlocks:
    """Normal equations of state and rest frequencies, block by block."""

    matrix: FloatArray
    """Of the state, shape (trials, 4, 4)."""
    cross: FloatArray
    """Of state and rest frequencies, shape (trials, 4, lines)."""
    rest_matrix: FloatArray
    """Diagonal of the rest frequencies, shape (trials, lines)."""
    gradient: FloatArray
    """Half gradient in the state, shape (trials, 4)."""
    rest_gradient: FloatArray
    """Half gradient in the rest frequencies, shape (trials, lines)."""


def normal_blocks(problem: Problem, r: Residuals) -> NormalBlocks:
    """Accumulate the normal equations in the state and the rest frequencies."""
    bearing_jacobian = r.prediction.bearing_jacobian
    rate_jacobian = r.prediction.rate_jacobian
    weight = problem.bearing_weight * loss_weight(r.bearing, problem.loss)
    pull = (weight * r.bearing).sum(1) * r.side
    strength = (weight * problem.bearing_weight).sum(1)
    matrix = (bearing_jacobian * strength[:, np.newaxis]) @ np.swapaxes(
        bearing_jacobian, 1, 2
    )
    gradient = (bearing_jacobian @ pull[:, :, np.newaxis])[:, :, 0]
    if problem.n_lines == 0:
        empty = np.zeros((gradient.shape[0], 0))
        cross = np.zeros((*gradient.shape, 0))
        return NormalBlocks(matrix, cross, empty, gradient, empty)
    scale = -r.rest_hz[:, :, np.newaxis] / problem.sound_speed_mps
    weight = problem.frequency_weight * loss_weight(r.frequency, problem.loss)
    strength = weight * problem.frequency_weight
    pull = (weight * r.frequency * scale).sum(1)
    joint = (strength * scale**2).sum(1)
    tied = strength * scale * r.factor[:, np.newaxis]
    transposed = np.swapaxes(rate_jacobian, 1, 2)
    return NormalBlocks(
        matrix + (rate_jacobian * joint[:, np.newaxis]) @ transposed,
        rate_jacobian @ np.swapaxes(tied, 1, 2),
        (strength * r.factor[:, np.newaxis] ** 2).sum(-1),
        gradient + (rate_jacobian @ pull[:, :, np.newaxis])[:, :, 0],
        (weight * r.frequency * r.factor[:, np.newaxis]).sum(-1),
    )


def misfit_value(
    problem: Problem, state: FloatArray, rest_hz: FloatArray, member: IntArray
) -> FloatArray:
    """Return the misfit of states and rest frequencies that are given.

    Parameters
    ----------
    problem
        The data.
    state
        Trial states (x, y, vx, vy).
    rest_hz
        Rest frequencies (trial, line), Hz.
    member
        Record of each trial.
    """
    bearing, rate = predict_values(problem.track, state, medium_of(problem))
    chosen = member if problem.bearing_rad.shape[0] > 1 else np.zeros(1, dtype=np.int64)
    heading = problem.array_heading_rad
    data = problem.bearing_rad[chosen]
    if heading is None:
        off = wrap_rad(bearing[:, np.newaxis] - data)
    else:
        folded = np.abs(wrap_rad(data - heading))
        off = np.abs(wrap_rad(bearing - heading))[:, np.newaxis] - folded
    factor = 1.0 - rate / problem.sound_speed_mps
    shift = rest_hz[:, :, np.newaxis] * factor[:, np.newaxis]
    shift = (shift - problem.frequency_hz[chosen]) * problem.frequency_weight
    value = loss_value(off * problem.bearing_weight, problem.loss).sum((1, 2))
    return np.asarray(value + loss_value(shift, problem.loss).sum((1, 2)))
