"""Misfit of trial motions, its gradient, and normal equations in one pass.

**Method.** Sum over all measurements of the loss of the whitened residuals
(Chang et al. 2003, eq. 4, corrected: a sum over lines, wrapped angles). The rest
frequencies enter linearly and are projected out (Golub & Pereyra 1973): given a
motion they have a closed form, and the normal equations of the motion are the
Schur complement of theirs. The constant bearing error of each sensor, an unknown with a
prior, is projected out in the same way; its prior counts in the misfit. So is the factor
of the depths that delays of a reflected path are in proportion to.

**Conventions.** ``member`` says which record of the problem a trial belongs to.
Gradients are half those of the misfit. Every loss is z^2 near zero, so that the sums
compare. Tuning constants give 95 % efficiency on Gaussian noise (Huber 1981; Beaton &
Tukey 1974); Student's t has four degrees of freedom (Lange et al. 1989).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.motion.target_motion.model import (
    PER_ALTERATION,
    STRAIGHT,
    Prediction,
    predict,
    predict_values,
    state_jacobian,
    to_state,
)
from uwtrack_cli.motion.target_motion.problem import Loss, MotionPrior, Problem

HUBER, TUKEY, STUDENT = 1.345, 4.685, 4.0


def loss_value(z: FloatArray, loss: Loss) -> FloatArray:
    """Return the loss of standardised residuals, element by element."""
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
    """Half its gradient, shape (trials, p)."""
    matrix: FloatArray
    """Gauss-Newton matrix, shape (trials, p, p)."""
    rest_hz: FloatArray
    """Best rest frequencies, Hz, shape (trials, lines)."""


@dataclass(frozen=True, eq=False)
class ScaledLines:
    """Lines in proportion to one function of the motion: all tones, or the delays."""

    lines: slice
    """Which lines these are."""
    shape: FloatArray
    """The function: Doppler factor 1 - rate / c, or delay, s; shape (trials, rows)."""
    slope: FloatArray
    """Partial of it by what the motion tells, range rate or range, shape (trials or 1,
    rows or 1)."""
    jacobian: FloatArray
    """Partials of that by the state, shape (trials, p, rows)."""


def scaled_lines(problem: Problem, prediction: Prediction) -> tuple[ScaledLines, ...]:
    """Return what the lines of trial motions are in proportion to."""
    sound, tones = problem.sound_speed_mps, problem.n_tones
    found = [
        ScaledLines(
            slice(0, tones), 1.0 - prediction.rate_mps / sound,
            np.full((1, 1), -1.0 / sound), prediction.rate_jacobian,
        )
    ]  # fmt: skip
    if problem.bounce is not None:
        delay, slope = problem.bounce.delay_s(prediction.range_m, sound)
        found.append(ScaledLines(slice(tones, None), delay, slope, prediction.range_jacobian))
    return tuple(one for one in found if problem.n_lines > one.lines.start)


@dataclass(frozen=True, eq=False)
class Residuals:
    """Model against data: whitened residuals."""

    bearing: FloatArray
    """Whitened residuals of the bearings, shape (trials, streams, rows)."""
    frequency: FloatArray
    """Whitened residuals of the frequencies, shape (trials, lines, rows)."""
    scaled: tuple[ScaledLines, ...]
    """What the lines are in proportion to."""
    side: FloatArray
    """Slope of the bearing's residual over the true one, 1 but for the cones of an array,
    shape (trials or 1, streams or 1, rows or 1)."""
    rest_hz: FloatArray
    """Rest frequencies, Hz, and the factor of delays, shape (trials, lines)."""
    prediction: Prediction
    """The model's bearings, range rates and ranges."""
    offset_rad: FloatArray
    """Constant error of each stream of bearings, rad, shape (trials, streams)."""

    def prior_value(self, problem: Problem) -> FloatArray:
        """Return what priors of offsets and of the depths add, shape (trials,)."""
        value: FloatArray = (self.rest_hz - 1.0) ** 2 @ problem.rest_precision
        if problem.offset_std_rad is None:
            return value
        weighted = np.where(self.offset_rad == 0.0, 0.0, problem.offset_precision)
        return np.asarray(value + (weighted * self.offset_rad**2).sum(-1))


def residuals(
    problem: Problem,
    q: FloatArray,
    member: IntArray | None = None,
    *,
    polar: bool = False,
    rest_hz: FloatArray | None = None,
) -> Residuals:
    """Compare trial motions, one per row, with the data.

    The rest frequencies (trial, line), Hz, are the best ones unless given; ``polar``:
    the velocity is given as speed and course.
    """
    state = to_state(q, polar=polar)
    prediction = predict(problem.track, state, medium_of(problem))
    bearing_data, frequency_data = problem.bearing_rad, problem.frequency_hz
    if member is not None and bearing_data.shape[0] > 1:
        bearing_data, frequency_data = bearing_data[member], frequency_data[member]
    off, side = bearing_errors(problem, prediction.bearing_rad, bearing_data)
    off, offset = _without_offsets(problem, off)
    scaled = scaled_lines(problem, prediction)
    if rest_hz is None:
        rest_hz = _rest_frequencies(problem, scaled, frequency_data, len(state))
    frequency = _line_errors(scaled, rest_hz, frequency_data)
    return Residuals(
        off * problem.bearing_weight,
        frequency * problem.frequency_weight,
        scaled,
        side,
        rest_hz,
        prediction,
        offset,
    )


def bearing_errors(
    problem: Problem, model_rad: FloatArray, data_rad: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return model less data, and its slope over the bearing, (trials, streams, rows).

    Where the array's heading is nan, the row's bearing resolves the side. Bearings of
    the model have the shape (trials, rows), measured ones (trials or 1, streams, rows),
    rad.

    Notes
    -----
    A line array measures the cosine u of the angle from its axis, with a deviation that
    does not depend on the angle, and u + k c / (f d) as well. Its error is that of the
    nearest such u, over the sine of the measured angle, which the deviation was divided by.
    """
    off = wrap_rad(model_rad[:, np.newaxis] - data_rad)
    heading = problem.array_heading_rad
    if heading is None:
        return off, np.ones((1, 1, 1))
    is_open = ~np.isnan(heading)
    heading = np.where(is_open, heading, 0.0)
    relative, measured = (model_rad - heading)[:, np.newaxis], data_rad - heading
    cosine = np.cos(measured) - np.cos(relative)
    if problem.lobe_cosine is not None:
        cosine -= problem.lobe_cosine * np.round(cosine / problem.lobe_cosine)
    least = 0.0 if problem.cone_std_rad is None else problem.cone_std_rad
    angle = 1.0 / np.maximum(np.abs(np.sin(measured)), least)
    slope = np.where(is_open, np.sin(relative) * angle, 1.0)
    return np.where(is_open, cosine * angle, off), slope


def _without_offsets(problem: Problem, off: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Take the best offset of each stream out of bearing errors; return both.

    Ridge regression on one constant: b = -sum w off / (sum w + 1 / s^2), reweighted
    under a robust loss from the median.
    """
    offset = np.zeros(off.shape[:2])
    if problem.offset_std_rad is None:
        return off, offset
    weight = problem.bearing_weight**2
    precision = problem.offset_precision
    measured = weight > 0
    passes = 1
    robust: FloatArray = np.broadcast_to(weight, off.shape)
    if problem.loss != "squares":
        passes = REWEIGHTINGS
        for stream in np.flatnonzero(measured.any(1)):
            middle = np.median(off[:, stream, measured[stream]], axis=-1)
            reach = 3.0 * problem.offset_std_rad[stream]
            offset[:, stream] = -np.clip(middle, -reach, reach)
    for turn in range(passes):
        if problem.loss != "squares":
            z = wrap_rad(off + offset[:, :, np.newaxis]) * problem.bearing_weight
            robust = weight * loss_weight(z, problem.loss)
        # errors about the last offset, lest they jump at half a turn
        near = wrap_rad(off + offset[:, :, np.newaxis])
        if turn == 0 and problem.loss == "squares":
            near = off
        pull = (robust * (near - offset[:, :, np.newaxis])).sum(-1)
        total = robust.sum(-1) + precision
        offset = np.where(total > 0, -pull / np.maximum(total, 1e-300), 0.0)
    return wrap_rad(off + offset[:, :, np.newaxis]), offset


def medium_of(problem: Problem) -> Medium:
    """Return sound speed, depths and delay of a problem."""
    return Medium(problem.sound_speed_mps, problem.height_m, problem.delayed)


def _line_errors(
    scaled: tuple[ScaledLines, ...], rest_hz: FloatArray, data_hz: FloatArray
) -> FloatArray:
    """Return model less data of all lines, shape (trials, lines, rows)."""
    if not scaled:
        return np.empty((len(rest_hz), 0, data_hz.shape[-1]))
    parts = [
        rest_hz[:, one.lines, np.newaxis] * one.shape[:, np.newaxis] - data_hz[:, one.lines]
        for one in scaled
    ]
    return parts[0] if len(parts) == 1 else np.concatenate(parts, 1)


def _rest_frequencies(
    problem: Problem, scaled: tuple[ScaledLines, ...], data_hz: FloatArray, n_trials: int
) -> FloatArray:
    """Return the best rest frequencies, and the best factor of delays."""
    if not scaled:
        return np.empty((n_trials, 0))
    found = [
        _best_scales(
            problem, one.shape, data_hz[:, one.lines],
            problem.frequency_weight[one.lines], problem.rest_precision[one.lines],
        )
        for one in scaled
    ]  # fmt: skip
    return np.concatenate(found, 1)


def _best_scales(
    problem: Problem,
    factor: FloatArray,
    data_hz: FloatArray,
    inverse_std: FloatArray,
    precision: FloatArray,
) -> FloatArray:
    """Solve for what scales lines, with a prior mean of one.

    f0 = (sum w g f + p) / (sum w g^2 + p), with the prior precision p.
    """
    weight = inverse_std**2
    if problem.loss == "squares":
        weighted = weight * data_hz
        if data_hz.shape[0] == 1:
            top = factor @ weighted[0].T
        else:
            top = (weighted @ factor[:, :, np.newaxis])[:, :, 0]
        below = (factor**2) @ weight.T + precision
        return np.asarray((top + precision) / np.maximum(below, 1e-300))
    rest = _median_rest(inverse_std, factor, data_hz)
    for _ in range(REWEIGHTINGS):
        z = rest[:, :, np.newaxis] * factor[:, np.newaxis] - data_hz
        robust = weight * loss_weight(z * inverse_std, problem.loss)
        lower = (robust * factor[:, np.newaxis] ** 2).sum(-1) + precision
        upper = (robust * factor[:, np.newaxis] * data_hz).sum(-1) + precision
        rest = np.where(lower > 0, upper / np.maximum(lower, 1e-300), rest)
    return rest


def _median_rest(inverse_std: FloatArray, factor: FloatArray, data_hz: FloatArray) -> FloatArray:
    single = data_hz / factor[:, np.newaxis]
    columns = []
    for line, weight in enumerate(inverse_std):
        heard = weight > 0
        some = single[:, line, heard]
        empty = np.zeros(single.shape[0])
        columns.append(np.median(some, axis=-1) if heard.any() else empty)
    return np.stack(columns, -1) if columns else np.empty((single.shape[0], 0))


def misfit(
    problem: Problem, q: FloatArray, member: IntArray | None = None, *, polar: bool = False
) -> ProfiledMisfit:
    """Return misfit, half gradient and Gauss-Newton matrix of trial motions.

    Notes
    -----
    With A, b, d the blocks of the normal equations of motion and rest
    frequencies: the matrix is A - b d^-1 b^T (Golub & Pereyra 1973).
    """
    r = residuals(problem, q, member, polar=polar)
    prior_z, prior_rows = motion_prior(problem, to_state(q, polar=polar))
    value = (prior_z**2).sum(-1)
    value += loss_value(r.bearing, problem.loss).sum((1, 2)) + r.prior_value(problem)
    value += loss_value(r.frequency, problem.loss).sum((1, 2))
    blocks = normal_blocks(problem, r)
    chain = state_jacobian(q, polar=polar)
    safe = np.where(blocks.rest_matrix > 0, blocks.rest_matrix, np.inf)
    cross = blocks.cross / safe[:, np.newaxis]
    matrix = blocks.matrix - cross @ np.swapaxes(blocks.cross, 1, 2)
    gradient = blocks.gradient - (cross @ blocks.rest_gradient[:, :, np.newaxis])[..., 0]
    if prior_z.size:
        rows = np.swapaxes(prior_rows, 1, 2)
        matrix = matrix + rows @ prior_rows
        gradient = gradient + (rows @ prior_z[:, :, np.newaxis])[:, :, 0]
    turned = np.swapaxes(chain, 1, 2)
    return ProfiledMisfit(
        value, (turned @ gradient[:, :, np.newaxis])[:, :, 0], turned @ matrix @ chain, r.rest_hz
    )


def motion_prior(problem: Problem, state: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far motions are from what was expected, and the partials of that.

    In deviations, shapes (trials, k) and (trials, k, p), of states (x, y, vx, vy) with
    their alterations.
    """
    prior = problem.prior
    parts = [*_expected_start(prior, state), *_expected_speeds(prior, state)]
    for first in range(STRAIGHT, state.shape[1], PER_ALTERATION):
        for place, mean, std in (
            (first, 0.0, prior.change_std_mps),
            (first + 1, 0.0, prior.change_std_mps),
            (first + 3, prior.log_duration.mean, prior.log_duration.std),
        ):
            parts.append(((state[:, place] - mean) / std, {place: 1.0 / std}))
    off = np.zeros((len(state), len(parts)))
    rows = np.zeros((*off.shape, state.shape[1]))
    for number, (z, columns) in enumerate(parts):
        off[:, number] = z
        for place, value in columns.items():
            rows[:, number, place] = value
    return off, rows


Columns = dict[int, Any]
"""Partials by the places of the unknowns that have any."""


def _expected_start(prior: MotionPrior, state: FloatArray) -> list[tuple[FloatArray, Columns]]:
    """Return off and partials of the range and the course at the first measurement."""
    found: list[tuple[FloatArray, Columns]] = []
    for expected, place in ((prior.log_range, 0), (prior.course_rad, 2)):
        if expected is None:
            continue
        east, north = state[:, place], state[:, place + 1]
        scale = np.maximum(east**2 + north**2, 1e-12) * expected.std
        if place:
            off = wrap_rad(np.arctan2(east, north) - expected.mean)
            columns = {place: north / scale, place + 1: -east / scale}
        else:
            off = np.log(np.maximum(np.hypot(east, north), 1e-6)) - expected.mean
            columns = {place: east / scale, place + 1: north / scale}
        found.append((off / expected.std, columns))
    return found


def _expected_speeds(prior: MotionPrior, state: FloatArray) -> list[tuple[FloatArray, Columns]]:
    """Return off and partials of the speed on every leg."""
    expected, found = prior.speed_mps, list[tuple[FloatArray, Columns]]()
    if expected is None:
        return found
    velocity, places = np.zeros((len(state), 2)), list[int]()
    for first in (2, *range(STRAIGHT, state.shape[1], PER_ALTERATION)):
        velocity = velocity + state[:, first : first + 2]
        places.append(first)
        speed = np.maximum(np.hypot(*velocity.T), 1e-6)
        east, north = (velocity / (speed * expected.std)[:, np.newaxis]).T
        columns = dict.fromkeys(places, east)
        columns |= dict.fromkeys([place + 1 for place in places], north)
        found.append(((speed - expected.mean) / expected.std, columns))
    return found


@dataclass(frozen=True, eq=False)
class NormalBlocks:
    """Normal equations of state and rest frequencies, block by block."""

    matrix: FloatArray
    """Of the state, shape (trials, p, p)."""
    cross: FloatArray
    """Of state and what is projected out, rest frequencies and then the offsets of
    the streams, if they are sought, shape (trials, p, n)."""
    rest_matrix: FloatArray
    """Diagonal of what is projected out, shape (trials, n)."""
    gradient: FloatArray
    """Half gradient in the state, shape (trials, p)."""
    rest_gradient: FloatArray
    """Half gradient in what is projected out, shape (trials, n)."""


def normal_blocks(problem: Problem, r: Residuals) -> NormalBlocks:
    """Accumulate the normal equations in the state and what is projected out."""
    bearing_jacobian = r.prediction.bearing_jacobian
    weight = problem.bearing_weight * loss_weight(r.bearing, problem.loss)
    pull = (weight * r.bearing * r.side).sum(1)
    each = weight * problem.bearing_weight
    strength = (each * r.side**2).sum(1)
    matrix = (bearing_jacobian * strength[:, np.newaxis]) @ np.swapaxes(bearing_jacobian, 1, 2)
    gradient = (bearing_jacobian @ pull[:, :, np.newaxis])[:, :, 0]
    empty = np.zeros((gradient.shape[0], 0))
    cross, diagonal, slope = np.zeros((*gradient.shape, 0)), empty, empty
    if problem.offset_std_rad is not None:
        precision = problem.offset_precision
        cross = bearing_jacobian @ np.swapaxes(each * r.side, 1, 2)
        diagonal = each.sum(-1) + precision
        prior = np.where(r.offset_rad == 0.0, 0.0, precision) * r.offset_rad
        slope = (weight * r.bearing).sum(-1) + prior
        # an offset that is known exactly takes no part
        slope = np.where(np.isfinite(diagonal), slope, 0.0)
    # the lines stand before the offsets
    for one in reversed(r.scaled):
        rest, misses = r.rest_hz[:, one.lines], r.frequency[:, one.lines]
        precision = problem.rest_precision[one.lines]
        inverse_std = problem.frequency_weight[one.lines]
        scale = rest[:, :, np.newaxis] * one.slope[:, np.newaxis]
        weight = inverse_std * loss_weight(misses, problem.loss)
        strength = weight * inverse_std
        pull = (weight * misses * scale).sum(1)
        joint = (strength * scale**2).sum(1)
        shape = one.shape[:, np.newaxis]
        tied = strength * scale * shape
        line_slope = (weight * misses * shape).sum(-1) + precision * (rest - 1.0)
        line_diagonal = (strength * shape**2).sum(-1) + precision
        line_cross = one.jacobian @ np.swapaxes(tied, 1, 2)
        transposed = np.swapaxes(one.jacobian, 1, 2)
        matrix = matrix + (one.jacobian * joint[:, np.newaxis]) @ transposed
        cross = np.concatenate([line_cross, cross], -1)
        diagonal = np.concatenate([line_diagonal, diagonal], -1)
        gradient = gradient + (one.jacobian @ pull[:, :, np.newaxis])[:, :, 0]
        slope = np.concatenate([line_slope, slope], -1)
    return NormalBlocks(matrix, cross, diagonal, gradient, slope)


def misfit_value(
    problem: Problem, state: FloatArray, rest_hz: FloatArray, member: IntArray
) -> FloatArray:
    """Return the misfit of given states (x, y, vx, vy) and rest frequencies.

    There are no delays: those are of one platform.
    """
    bearing, rate = predict_values(problem.track, state, medium_of(problem))
    chosen = member if problem.bearing_rad.shape[0] > 1 else np.zeros(1, dtype=np.int64)
    off, _ = bearing_errors(problem, bearing, problem.bearing_rad[chosen])
    off, offset = _without_offsets(problem, off)
    prior = np.where(offset == 0.0, 0.0, problem.offset_precision) * offset**2
    factor = 1.0 - rate / problem.sound_speed_mps
    shift = rest_hz[:, :, np.newaxis] * factor[:, np.newaxis]
    shift = (shift - problem.frequency_hz[chosen]) * problem.frequency_weight
    value = loss_value(off * problem.bearing_weight, problem.loss).sum((1, 2))
    value += prior.sum(-1)
    return np.asarray(value + loss_value(shift, problem.loss).sum((1, 2)))
