"""Joint maximum likelihood of a passage from all measurements of a contact.

**Method.** Rounds of Levenberg-Marquardt steps with fixed weights, and of weights from
the residuals: a robust loss, scales from the data, and the long-run variance of
coloured noise. All rows of the batch go at once: starts of one data set, or data sets
of a study. A single data set with coloured noise is then fitted again with the
covariance of that noise (`fit_with_coloured_noise`): each kind is condensed to one
residual per instant (the lines of a shaft jitter together), and strength and
correlation time come from the restricted likelihood. Last, the levels of the lines join
(`fit_with_line_levels`): in every reading, once the readings have been weighed.

**Conventions.** Unknowns as in `unknowns`. The first axis is the batch; the rows of the
three kinds are under one another as in `Blocks`.

**References.** Choi et al. (2014), eqs. 4-6 with free rest frequency, level and floor.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation.least_squares import Evaluation, damped_least_squares
from uwtrack_cli.estimation.robust import median_where
from uwtrack_cli.motion.coloured_noise import (
    ColouredNoise,
    InformationLoss,
    fit_coloured_noise,
    information_loss,
)
from uwtrack_cli.motion.passage.fit.covariance import passage_covariance
from uwtrack_cli.motion.passage.fit.line_levels import line_levels, surface_image
from uwtrack_cli.motion.passage.fit.normal_equations import (
    NO_LOSS,
    FitConstants,
    JointNormalEquations,
    Losses,
    NormalEquations,
    PassageResiduals,
    WeightedData,
    block_normals,
    normal_equations,
    pair_rows,
    passage_state,
    weigh,
)
from uwtrack_cli.motion.passage.fit.residual_noise import (
    BlockNoise,
    Noises,
    block_noises,
    rough_weight,
)
from uwtrack_cli.motion.passage.fit.source_patterns import source_patterns, with_patterns
from uwtrack_cli.motion.passage.model.law import SLOWEST_MPS, Passage, slant_over_speed_s
from uwtrack_cli.motion.passage.model.measurements import NEPER_DB, Blocks
from uwtrack_cli.motion.passage.model.unknowns import (
    CHANGED,
    FLOOR,
    FREE_INSTANTS,
    HEIGHT,
    SHORTEST_TURN_S,
    TURN,
    Change,
    free_unknowns,
    heights_m,
    law_of,
)

LONGEST_CORRELATION = 1.5
"""Bartlett's window in units of d/v: 60 s where d/v is 40 s."""

ROUGH_ROUNDS = 2
"""Rounds with simple robust weights before those that judge the noise in full."""

ROUGH_TOLERANCE = 20.0
"""Gain in log-likelihood at which a rough round ends, with one more step."""

SLOWNESS_SPM, SLOWNESS_STD_SPM = 0.22, 0.14
"""Inverse speed of vessels without Doppler, s/m: mean and deviation of 2 to 12 m/s."""

LARGEST_TURN_STEP = 0.5
"""Change of the angle of a steady turn in one step, rad."""

BLUR_STEP = 0.1
"""R/v, as a share, over which the bend of the law is taken."""

TOLERANCE = 1e-2
"""Gain at which the last round ends, with one more step: a seventh of a deviation
before that step, and far less after it."""


@dataclass(frozen=True)
class PassageFit:
    """Result of a fit, one row per start or data set."""

    theta: FloatArray
    """t0 (s), ln of the horizontal range over speed (s), v (m/s), ln of the floor, the
    depth difference (m) where it is an unknown, and the unknowns of the change if there
    is one, shape (batch, 4 or more)."""
    turn: FloatArray
    """Sign of the bearing trend, shape (batch,)."""
    bearing_deg: FloatArray
    """Bearing at closest approach, degrees, shape (batch,)."""
    rest_hz: FloatArray
    """Rest frequencies, Hz, shape (batch, lines)."""
    rest_std_hz: FloatArray
    """Their standard deviations, Hz."""
    level_db: FloatArray
    """Level at closest approach, dB, shape (batch,)."""
    covariance: FloatArray
    """Of t0 (s), slant range over speed (s), v (m/s) and bearing (degrees), shape
    (batch, 4, 4)."""
    cost: FloatArray
    """Negative log-likelihood but for a constant, shape (batch,)."""
    noises: Noises
    """Noise of frequencies, bearings and levels."""
    medium: Medium
    """Sound speed, and the depth difference with its prior."""
    full_covariance: FloatArray
    """Of t0 (s), horizontal range over speed (s), v (m/s), bearing (degrees), depth
    difference (m) and what changed, shape (batch, 5 or more, same)."""
    losses: Losses = NO_LOSS
    """Information that coloured noise takes from each kind."""
    slow: tuple[ColouredNoise, ...] = ()
    """Coloured noise of each kind; empty if it is white."""
    change: Change | None = None
    """What changed beside the passage; None for a straight one of steady frequencies."""
    before_levels: "PassageFit | None" = None
    """The fit without the levels of the lines; None where they are not in it."""

    @property
    def height_m(self) -> FloatArray:
        """Depth difference of sensor and source, m, shape (batch,)."""
        height = heights_m(self.theta, self.medium)
        return np.broadcast_to(height, self.theta.shape[:1])

    @property
    def range_over_speed_s(self) -> FloatArray:
        """Slant range over speed, s, shape (batch,)."""
        horizontal = np.exp(self.theta[:, 1])
        return slant_over_speed_s(horizontal, self.theta[:, 2], self.height_m)

    def law(self, time_s: FloatArray) -> Passage:
        """Evaluate the passage that was fitted.

        Parameters
        ----------
        time_s
            Times of reception in seconds.
        """
        return law_of(self.theta, time_s, self.medium, self.change)


def fit_passage(
    blocks: Blocks,
    start: FloatArray,
    turn: FloatArray,
    medium: Medium,
    *,
    with_coloured_noise: bool = True,
    change: Change | None = None,
) -> PassageFit:
    """Fit a passage to every row of a batch.

    Parameters
    ----------
    blocks
        Measurements in fit units; one row serves all starts.
    start
        Unknowns to start from, shape (batch, 4 or more).
    turn
        Sign of the bearing trend of every row, +1 or -1.
    medium
        Sound speed and depth difference. A depth difference with a deviation is an
        unknown with that prior.
    with_coloured_noise
        Whether coloured noise is looked for.
    change
        What changed beside the passage; the start then holds the depth difference and
        the unknowns of the change.
    """
    theta, medium = _unknowns(start, blocks, medium)
    free = free_unknowns(theta, blocks, medium)
    fixed = FitConstants(turn, start[:, FLOOR], free, change)
    state = passage_state(theta, fixed, blocks, medium, None)
    for _ in range(ROUGH_ROUNDS):
        weight = rough_weight(state.residual, blocks)
        data = weigh(state, weight, blocks, fixed)
        theta, normal = _descend(theta, data, medium, state.law, 8, ROUGH_TOLERANCE)
        state = passage_state(theta, fixed, blocks, medium, weight, normal)
    longest = _longest_correlation_time_s(theta, blocks, medium)
    noises = block_noises(state.residual, blocks, longest, longest if with_coloured_noise else None)
    weight = weight_of(noises)
    data = weigh(state, weight, blocks, fixed)
    theta, normal = _descend(theta, data, medium, state.law, 25)
    state = passage_state(theta, fixed, blocks, medium, weight, normal)
    if normal is None:
        normal = normal_equations(theta, data, medium, state.law)
    return _result(theta, data, (blocks, medium), (state, noises, normal))


def correct_frequencies(blocks: Blocks, fit: PassageFit) -> Blocks:
    """Return measurements without what frames and the surface image do to frequencies.

    A frame's frequency is a mean over its length, and lies inside the bend of the law. With
    its image in the surface, a source has the phase of one between both, which is farther
    from a deep sensor than the source is; what is not known of the image is kept as
    patterns, which `fit_with_coloured_noise` eliminates.

    Parameters
    ----------
    blocks
        Measurements in fit units, one row.
    fit
        Straight fit of one row, which says how the frequencies bend.
    """
    if blocks.blur_s2 is None or not fit.theta[0, 2]:
        return blocks
    near_s = BLUR_STEP * float(fit.range_over_speed_s[0])
    laws = [fit.law(blocks.time_s + lag) for lag in (-near_s, 0.0, near_s)]
    before, here, after = (law.shift[0] for law in laws)
    bend = (before + after - 2.0 * here) / near_s**2
    off, patterns = 0.5 * blocks.blur_s2[0] * bend, None
    lines, medium = blocks.parts[0], fit.medium
    weight = blocks.weight[0, lines]
    if medium.is_water and np.isfinite(medium.most_m):
        slant_m = abs(float(fit.theta[0, 2])) * fit.range_over_speed_s[0]
        log_range = np.log(slant_m) - 0.5 * laws[1].spread[0]
        mean, spread = surface_image(medium, blocks.mean_hz[0]).shifts(log_range, here)
        total = weight.sum(axis=0)
        patterns = (weight * spread).sum(axis=1) / np.where(total > 0, total, 1.0)
        off = off + mean
    value = blocks.value.copy()
    value[0, lines] -= np.where(weight > 0, off, 0.0)
    return replace(blocks, value=value, image_patterns=patterns)


def _unknowns(start: FloatArray, blocks: Blocks, medium: Medium) -> tuple[FloatArray, Medium]:
    """Add the depth difference to the unknowns where it is not exactly known.

    Without Doppler there is no speed, and its place is taken by the depth difference
    over an unknown speed, which parts slant and horizontal range over speed.
    """
    if blocks.shift.is_empty:
        if medium.height_m:
            typical = abs(medium.height_m) * SLOWEST_MPS
            medium = replace(
                medium,
                height_m=typical * SLOWNESS_SPM,
                height_std_m=typical * SLOWNESS_STD_SPM,
                most_m=np.inf,
            )
        else:
            medium = replace(medium, height_std_m=0.0)
    if start.shape[1] > CHANGED:
        return start, medium
    if not medium.height_std_m:
        return start[:, :HEIGHT], medium
    if start.shape[1] > HEIGHT:
        return start, medium
    height = np.full((start.shape[0], 1), medium.height_m)
    return np.concatenate([start, height], axis=1), medium


def weight_of(noises: Noises) -> FloatArray:
    """Return the weights that follow from the noise, of all rows.

    Parameters
    ----------
    noises
        Noise of the three kinds.
    """
    return np.concatenate([noise.weight for noise in noises], axis=1)


def take_rows(fit: PassageFit, one: IntArray | list[int]) -> PassageFit:
    """Return some rows of a batch.

    Parameters
    ----------
    fit
        Fit of a batch.
    one
        Rows that are wanted.
    """
    noises = tuple(
        type(noise)(*(getattr(noise, f.name)[one] for f in fields(noise))) for noise in fit.noises
    )
    return PassageFit(
        fit.theta[one],
        fit.turn[one],
        fit.bearing_deg[one],
        fit.rest_hz[one],
        fit.rest_std_hz[one],
        fit.level_db[one],
        fit.covariance[one],
        fit.cost[one],
        (noises[0], noises[1], noises[2]),
        fit.medium,
        fit.full_covariance[one],
        change=None
        if fit.change is None
        else replace(fit.change, time_s=fit.change.time_s[one], sign=fit.change.sign[one]),
    )


def join_rows(fits: list[PassageFit]) -> PassageFit:
    """Return the rows of several fits to the same data, with white noise, under another.

    Parameters
    ----------
    fits
        Fits of one medium and one kind of change.
    """
    joined: dict[str, Any] = {
        f.name: np.concatenate([getattr(fit, f.name) for fit in fits])
        for f in fields(PassageFit)
        if isinstance(getattr(fits[0], f.name), np.ndarray)
    }
    noises = tuple(
        BlockNoise(*(
            np.concatenate([getattr(fit.noises[kind], f.name) for fit in fits])
            for f in fields(BlockNoise)
        ))
        for kind in range(3)
    )  # fmt: skip
    changes = [fit.change for fit in fits if fit.change is not None]
    change = (
        replace(
            changes[0],
            time_s=np.concatenate([one.time_s for one in changes]),
            sign=np.concatenate([one.sign for one in changes]),
        )
        if changes
        else None
    )
    together = (noises[0], noises[1], noises[2])
    return replace(fits[0], **joined, noises=together, change=change)


def fit_with_coloured_noise(fit: PassageFit, blocks: Blocks, *, rounds: int = 2) -> PassageFit:
    """Fit one data set again with the covariance of its coloured noise.

    Returned as it is where the noise is white and no levels are beside frequencies,
    whose patterns (`source_patterns`) would be fitted, too.

    Parameters
    ----------
    fit
        Fit of one row.
    blocks
        Measurements in fit units, one row.
    rounds
        Rounds of noise and fit.
    """
    theta, noises, medium = fit.theta, fit.noises, fit.medium
    free = free_unknowns(theta, blocks, medium)
    fixed = FitConstants(fit.turn, theta[:, FLOOR], free, fit.change)
    slow: tuple[ColouredNoise, ...] = ()
    losses: Losses = NO_LOSS
    patterns: FloatArray = np.empty((0, blocks.time_s.size))
    # levels alone know nothing better: what patterns do to them is considered afterwards
    has_patterns = not (blocks.level.is_empty or blocks.shift.is_empty)
    state = passage_state(theta, fixed, blocks, medium, weight_of(noises))
    longest = _longest_correlation_time_s(theta, blocks, medium)
    # what a pattern has moved leaves residuals that look like noise: first without any
    for number in range(-1 if has_patterns else 0, rounds):
        noises = block_noises(state.residual, blocks, longest, 0.0)
        weight = weight_of(noises)
        data = weigh(state, weight, blocks, fixed)
        if has_patterns:
            patterns = source_patterns(theta, state.law, medium)
            losses = (None, None, with_patterns(data.pair_weight[0, 1], None, patterns))
            data = replace(data, losses=losses)
        if number >= 0:
            slow, losses = coloured_noises(theta, state, data, blocks, medium, patterns)
            if all(loss is None for loss in losses):
                return fit
        data = weigh(state, weight, blocks, fixed, losses)
        theta, normal = _descend(theta, data, medium, state.law, 15)
        state = passage_state(theta, fixed, blocks, medium, weight, normal)
    if normal is None:
        normal = normal_equations(theta, data, medium, state.law)
    return _result(theta, data, (blocks, medium), (state, noises, normal), slow)


def fit_with_line_levels(fit: PassageFit, blocks: Blocks) -> PassageFit:
    """Fit one data set again with the levels of its lines.

    Returned as it is where there are too few.

    Parameters
    ----------
    fit
        Fit of one row.
    blocks
        Measurements in fit units, one row.
    """
    theta, medium = fit.theta, fit.medium
    levels = line_levels(theta, blocks, medium, fit.change)
    if levels is None:
        return fit
    free = free_unknowns(theta, blocks, medium)
    fixed = FitConstants(fit.turn, theta[:, FLOOR], free, fit.change)
    weight = weight_of(fit.noises)
    state = passage_state(theta, fixed, blocks, medium, weight)
    data = weigh(state, weight, blocks, fixed, fit.losses)
    data = replace(data, line_levels=levels)
    theta, normal = _descend(theta, data, medium, state.law, 15)
    state = passage_state(theta, fixed, blocks, medium, weight, normal)
    if normal is None:
        normal = normal_equations(theta, data, medium, state.law)
    found = (state, fit.noises, normal)
    made = _result(theta, data, (blocks, medium), found, fit.slow)
    return replace(made, before_levels=fit)


def level_misfit(fit: PassageFit, blocks: Blocks) -> float:
    """Return the variance of level residuals, slow changes included, over its own.

    Parameters
    ----------
    fit
        Fit of one row.
    blocks
        Measurements in fit units, one row.
    """
    free = np.ones(fit.theta.shape, np.bool_)
    fixed = FitConstants(fit.turn, fit.theta[:, FLOOR], free, fit.change)
    weight = weight_of(fit.noises)
    state = passage_state(fit.theta, fixed, blocks, fit.medium, weight)
    longest = _longest_correlation_time_s(fit.theta, blocks, fit.medium)
    level = block_noises(state.residual, blocks, longest, longest)[2]
    return float(level.inflation[0] * level.scale[0, 0] ** 2)


def _descend(
    theta: FloatArray,
    data: WeightedData,
    medium: Medium,
    law: Passage,
    max_steps: int,
    tolerance: float = TOLERANCE,
) -> tuple[FloatArray, JointNormalEquations | None]:
    """Minimise with fixed weights; ``law`` is the passage at the start.

    Also returned is what was evaluated at the result, if anything was.
    """
    last: list[tuple[FloatArray, JointNormalEquations]] = []

    def evaluate(trial: FloatArray, _: IntArray) -> Evaluation:
        known = law if trial is theta else None
        normal = normal_equations(trial, data, medium, known)
        last[:] = [(trial, normal)]
        return normal.cost, normal.gradient, normal.matrix

    found = damped_least_squares(
        evaluate, theta, _limiter(medium, data.change), max_steps=max_steps, tolerance=tolerance
    )
    trial, normal = last[0]
    return found, normal if trial is found else None


def _longest_correlation_time_s(theta: FloatArray, blocks: Blocks, medium: Medium) -> float:
    span = float(blocks.time_s[-1] - blocks.time_s[0])
    step = span / max(blocks.time_s.size - 1, 1)
    slant = _slant_s(theta, medium)
    passage = float(median_where(slant, np.ones(theta.shape[0])))
    longest = max(LONGEST_CORRELATION * passage, 6 * step)
    return min(longest, span / 3)


def _slant_s(theta: FloatArray, medium: Medium) -> FloatArray:
    height = heights_m(theta, medium)
    return slant_over_speed_s(np.exp(theta[:, 1]), theta[:, 2], height)


def _limiter(
    medium: Medium, change: Change | None
) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Keep steps within the reach of the linearisation, and the speed below sound."""
    fastest = 0.8 * medium.sound_speed_mps

    def limit(theta: FloatArray, step: FloatArray) -> FloatArray:
        reach = np.empty_like(step)
        reach[:, 0] = 2 * _slant_s(theta, medium)
        reach[:, 1:4] = 1.0, np.inf, 2.0
        reach[:, HEIGHT:] = np.inf
        reach[:, HEIGHT:CHANGED] = medium.height_std_m
        if change is not None and change.kind in FREE_INSTANTS:
            reach[:, -1] = 0.5 * reach[:, 0]
        if change is not None and change.kind == TURN:
            reach[:, CHANGED] = LARGEST_TURN_STEP
            reach[:, CHANGED + 1] = 0.5 * theta[:, CHANGED + 1]
        limited: FloatArray = np.minimum(np.maximum(step, -reach), reach)
        speed = np.minimum(np.maximum(theta[:, 2] + step[:, 2], -fastest), fastest)
        limited[:, 2] = speed - theta[:, 2]
        if theta.shape[1] > HEIGHT:  # the source is in the water
            height = np.minimum(theta[:, HEIGHT] + limited[:, HEIGHT], medium.most_m)
            limited[:, HEIGHT] = height - theta[:, HEIGHT]
        if change is not None and change.kind == TURN:
            lasts = theta[:, CHANGED + 1]
            limited[:, CHANGED + 1] = np.maximum(limited[:, CHANGED + 1], SHORTEST_TURN_S - lasts)
        return limited

    return limit


def _result(
    theta: FloatArray,
    data: WeightedData,
    given: tuple[Blocks, Medium],
    last: tuple[PassageResiduals, Noises, JointNormalEquations],
    slow: tuple[ColouredNoise, ...] = (),
) -> PassageFit:
    (blocks, medium), (state, noises, normal) = given, last
    spread = passage_covariance(theta, data, normal, medium)
    change = data.change
    if change is not None and change.kind in FREE_INSTANTS:
        change = replace(change, time_s=change.time_s + theta[:, -1])
        theta = theta.copy()
        theta[:, -1] = 0.0
    rest = blocks.mean_hz * (1 + state.rest)
    return PassageFit(
        theta,
        data.turn,
        np.rad2deg(state.bearing) % 360.0,
        rest,
        np.broadcast_to(blocks.mean_hz, rest.shape) * spread.rest_std,
        NEPER_DB * state.level,
        spread.slant,
        noises[0].cost + noises[1].cost + noises[2].cost,
        noises,
        medium,
        spread.full,
        data.losses,
        slow,
        change,
    )


def coloured_noises(
    theta: FloatArray,
    state: PassageResiduals,
    data: WeightedData,
    blocks: Blocks,
    medium: Medium,
    patterns: FloatArray,
) -> tuple[tuple[ColouredNoise, ...], Losses]:
    """Find the coloured noise of every kind, and what it takes from the information.

    Parameters
    ----------
    theta
        Unknowns, one row.
    state
        Residuals at these unknowns.
    data
        Measurements with the weights of their white noise, less what patterns take: else
        the frequencies would seem to be as wrong as the levels are.
    blocks
        Measurements in fit units.
    medium
        Sound speed and depth difference.
    patterns
        What levels may have of their source, which is no noise, shape (patterns, n).
    """
    partials = np.swapaxes(pair_rows(theta, state.law, data)[0, :, 2:], -1, -2)
    model = state.bearing[0] + data.turn[0] * state.law.angle[0]
    lines, _, levels = blocks.parts
    of_image: FloatArray = np.zeros((0, blocks.time_s.size))
    if blocks.image_patterns is not None and not blocks.shift.is_empty:
        of_image = blocks.image_patterns
    series = (
        (
            state.residual[0, lines],
            data.shift_weight[0],
            np.concatenate([-state.law.shift_d[0, :, :3], of_image.T], axis=1),
        ),
        (data.pair[0, 0] - model, data.pair_weight[0, 0], partials[0, :, :3]),
        (
            state.residual[0, levels],
            data.pair_weight[0, 1],
            np.concatenate([partials[1, :, :4], patterns.T], axis=1),
        ),
    )
    normals = block_normals(theta, data, state.law)
    width = float(_slant_s(theta, medium)[0])
    found: list[ColouredNoise] = []
    losses: list[InformationLoss | None] = []
    for number, (residual, weight, design) in enumerate(series):
        mean, size = _combine(residual, weight)
        columns = np.concatenate([design, np.ones((size.size, 1))], axis=1)
        others = _others(normals, number, columns.shape[1], data.is_free[0])
        noise = fit_coloured_noise(mean, size, data.time_s, columns, width, others)
        found.append(noise)
        losses.append(None if noise.is_white else information_loss(size, data.time_s, noise))
    kinds = (
        (data.shift_weight[0].sum(axis=0), losses[0], of_image),
        (data.pair_weight[0, 1], losses[2], patterns),
    )
    first, last = (
        with_patterns(weight, loss, own) if own.size else loss for weight, loss, own in kinds
    )
    return tuple(found), (first, losses[1], last)


def _others(
    normals: list[NormalEquations], number: int, n_columns: int, free: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return the information of the other kinds, as rows of unit variance."""
    rest = [normal for k, normal in enumerate(normals) if k != number]
    matrix = np.sum([normal.matrix[0, :4, :4] for normal in rest], axis=0)
    gradient = np.sum([normal.gradient[0, :4] for normal in rest], axis=0)
    keep = np.flatnonzero(free[:3])
    if matrix[3, 3] > 0:  # the floor is the levels' own unknown: eliminate it
        gradient = gradient - matrix[:, 3] * gradient[3] / matrix[3, 3]
        matrix = matrix - np.outer(matrix[:, 3], matrix[3]) / matrix[3, 3]
    matrix, gradient = matrix[np.ix_(keep, keep)], gradient[keep]
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    good = values > 1e-9 * max(float(values.max(initial=0.0)), 1e-12)
    values, vectors = values[good], vectors[:, good]
    rows = np.zeros((values.size, n_columns))
    rows[:, keep] = np.sqrt(values)[:, None] * vectors.T * scale
    # the kinds' gradients cancel at the optimum: the others' own optimum is off it;
    # designs are partials of residuals, hence the sign of the rows
    shift = -(vectors.T @ (gradient / scale)) / np.sqrt(values)
    return shift, -rows


def _combine(residual: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """One residual per instant from all rows, and its inverse variance."""
    residual, weight = np.atleast_2d(residual), np.atleast_2d(weight)
    size = weight.sum(axis=0)
    mean = (weight * residual).sum(axis=0) / np.where(size > 0, size, 1.0)
    return mean, size
