"""Joint maximum likelihood of a passage from all measurements of a contact.

**Method.** Rounds of Levenberg-Marquardt steps with fixed weights, and of weights from
the residuals: a robust loss, scales from the data, and the long-run variance of
coloured noise. All rows of the batch go at once: starts of one data set, or data sets
of a study. A single data set with coloured noise is then fitted again with the
covariance of that noise (`fit_with_coloured_noise`): each kind is condensed to one
residual per instant (the lines of a shaft jitter together), and strength and
correlation time come from the restricted likelihood.

Rest frequencies, the bearing at closest approach and the level are linear in the
model, so they are projected out (Golub and Pereyra 1973; Kaufman 1975): four unknowns
remain however many lines there are. All lines share the law, so one product of the
weights with five functions of time gives every sum of every line at once. Coloured
noise common to the lines takes information from the combined measurement of an
instant. In the covariance, an eliminated unknown has its own variance and follows the
others.

**Conventions.** Unknowns, in this order: t0 (s), ln of the horizontal range over speed
(s), v (m/s), the natural logarithm of the floor relative to the level at closest
approach, and, where it has a prior, the depth difference of sensor and source (m).
What changed
beside the passage (`Change`) has its unknowns behind these. Rest frequencies are
relative to the line's mean. The first axis is the batch; the rows
of the three kinds are under one another as in `Blocks`. Rows and columns of a
covariance that the data do not determine are nan.

**References.** Choi et al. (2014), eqs. 4-6 with free rest frequency, level and floor.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.acoustics.passage import (
    SLOWEST_MPS,
    Passage,
    bounded_speed,
    passage_law,
    slant_over_speed_s,
    with_other_leg,
)
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.estimation.least_squares import (
    Evaluation,
    damped_least_squares,
    inverse_or_nan,
)
from uwtrack_cli.estimation.robust import median_where
from uwtrack_cli.motion.coloured_noise import (
    ColouredNoise,
    InformationLoss,
    fit_coloured_noise,
    information_loss,
)
from uwtrack_cli.motion.passage.measurements import NEPER_DB, Blocks
from uwtrack_cli.motion.passage.noise import Noises, block_noises, rough_weight


@dataclass(frozen=True)
class DopplerSums:
    """Cost, gradient and matrix of the frequencies, rest frequencies eliminated."""

    cost: FloatArray
    """Half the weighted sum of squares, shape (batch,)."""
    gradient: FloatArray
    """Its gradient, shape (batch, motion): 3 unknowns, or 4 with the depth difference."""
    matrix: FloatArray
    """Gauss-Newton matrix, shape (batch, motion, motion)."""
    rest: FloatArray
    """Eliminated rest frequencies over the line's mean, less one, shape (batch,
    lines)."""
    variance: FloatArray
    """Their variance at a known motion, shape (batch, lines)."""
    follow: FloatArray
    """Their partials with respect to the motion, shape (batch, lines, motion)."""


@dataclass(frozen=True)
class LineSums:
    """What one round needs of frequencies and weights, whatever the motion."""

    factors: FloatArray
    """Weights, then weights times values, shape (batch, 2 lines, n)."""
    size: FloatArray
    """Sum of the weights, shape (batch, lines)."""
    first: FloatArray
    """Sum of weights times values, same shape."""
    second: FloatArray
    """Sum of weights times squared values, same shape."""


@dataclass(frozen=True)
class _Moments:
    """Weighted sums of products of every line.

    Of q = 1 + shift with itself, of q with e = value - shift and the partials of the
    shift, and of e and these partials among themselves.
    """

    qq: FloatArray
    """Sum of weights times q^2, shape (batch, lines)."""
    q: FloatArray
    """Sums of q times e and the partials, shape (batch, lines, 1 + motion)."""
    all: FloatArray
    """Sums of products of e and the partials, shape (batch, lines, 1 + motion,
    1 + motion)."""


def line_sums(shift: FloatArray, weight: FloatArray) -> LineSums:
    """Return what is the same for all steps of a round.

    Parameters
    ----------
    shift
        Frequencies over the line's mean, less one; shape (batch, lines, n).
    weight
        Inverse variances of the white part.
    """
    batch, lines, n = weight.shape
    factors = np.empty((batch, 2 * lines, n))
    value = factors[:, lines:]
    factors[:, :lines] = weight
    np.multiply(weight, shift, out=value)
    sums = factors.sum(axis=-1)
    square = (value * shift).sum(axis=-1)
    return LineSums(factors, sums[:, :lines], sums[:, lines:], square)


def doppler_sums(
    law: Passage,
    shift: FloatArray,
    weight: FloatArray,
    sums: LineSums,
    loss: InformationLoss | None,
) -> DopplerSums:
    """Return the normal equations of the frequencies alone.

    Parameters
    ----------
    law
        The passage at the times of the measurements.
    shift
        Frequencies over the line's mean, less one; shape (batch, lines, n).
    weight
        Inverse variances of the white part.
    sums
        Sums of these two.
    loss
        Information lost to coloured noise, or None.
    """
    moments = _sums(law, weight, sums)
    if loss is None:
        return _separate(moments)
    return _coupled(moments, law, shift, weight, loss)


def _sums(law: Passage, weight: FloatArray, sums: LineSums) -> _Moments:
    rows = law.rows[:, 0]
    batch, k, n = rows.shape
    lines = weight.shape[1]
    products = (rows[:, :, None] * rows[:, None]).reshape(batch, k * k, n)
    full = (weight @ np.swapaxes(products, 1, 2)).reshape(batch, lines, k, k)
    single = sums.factors @ np.swapaxes(rows, 1, 2)
    of_value = single[:, lines:]
    with_q = single[:, :lines] + full[..., 0, :]
    qq = sums.size + single[:, :lines, 0] + with_q[..., 0]
    with_e = of_value - full[..., 0, :]
    with_q[..., 0] = sums.first + of_value[..., 0] - with_q[..., 0]
    with_e[..., 0] = sums.second - of_value[..., 0] - with_e[..., 0]
    full[..., 0, :] = full[..., :, 0] = with_e
    return _Moments(np.where(qq > 0, qq, 1.0), with_q, full)


def _separate(sums: _Moments) -> DopplerSums:
    """Eliminate every line's rest frequency by itself: no noise in common."""
    shared = sums.q / sums.qq[..., None]
    rest = shared[..., 0]
    factor = np.empty_like(shared)
    factor[..., 0] = 1.0
    factor[..., 1:] = -(1 + rest)[..., None]
    left = sums.all - sums.q[..., :, None] * shared[..., None, :]
    left *= factor[..., :, None] * factor[..., None, :]
    total = left.sum(axis=1)
    return DopplerSums(
        0.5 * total[:, 0, 0],
        total[:, 1:, 0],
        total[:, 1:, 1:],
        rest,
        1 / sums.qq,
        -(factor * shared)[..., 1:],
    )


def _coupled(
    sums: _Moments,
    law: Passage,
    shift: FloatArray,
    weight: FloatArray,
    loss: InformationLoss,
) -> DopplerSums:
    """Eliminate the rest frequencies together: coloured noise couples the lines."""
    total = weight.sum(axis=1)
    share = weight / np.where(total > 0, total, 1.0)[:, None, :]
    basis = share * (1 + law.shift)[:, None, :]
    mean = (share * (shift - law.shift[:, None, :])).sum(axis=1)
    lost_mean = loss.times(mean)
    inner = np.eye(basis.shape[1]) * sums.qq[:, None, :]
    inner = inner - basis @ np.swapaxes(loss.times(basis), 1, 2)
    right = sums.q[..., 0] - np.einsum("bkt,bt->bk", basis, lost_mean)
    inverse = np.linalg.inv(inner)
    rest = np.einsum("bkl,bl->bk", inverse, right)
    factor = 1 + rest
    cost = sums.all[..., 0, 0].sum(axis=-1) - (lost_mean * mean).sum(axis=-1)
    cost = 0.5 * (cost - (rest * right).sum(axis=-1))
    slope = -np.einsum("bkt,bk->bt", share, factor)[:, None, :] * np.swapaxes(
        law.shift_d, -1, -2
    )
    lost = loss.times(slope)
    left = mean - np.einsum("bkt,bk->bt", basis, rest)
    with_e, with_q = sums.all[..., 0, 1:], sums.q[..., 1:]
    gradient = -(factor[..., None] * (with_e - rest[..., None] * with_q)).sum(1)
    gradient = gradient - np.einsum("bpt,bt->bp", lost, left)
    cross = -factor[..., None] * with_q - basis @ np.swapaxes(lost, 1, 2)
    matrix = np.einsum("bk,bkpq->bpq", factor**2, sums.all[..., 1:, 1:])
    matrix = matrix - slope @ np.swapaxes(lost, 1, 2)
    follow = -np.einsum("bkl,blp->bkp", inverse, cross)
    matrix = matrix + np.einsum("bkp,bkq->bpq", cross, follow)
    variance = np.einsum("bkk->bk", inverse)
    return DopplerSums(cost, gradient, matrix, rest, variance, follow)


FLOOR, HEIGHT, CHANGED = 3, 4, 5
"""Places of the floor, the depth difference and the changes among the unknowns."""

STEP, RAMP, MANOEUVRE = "frequency-step", "frequency-ramp", "manoeuvre"

CHANGE_STD = {STEP: (0.02,), RAMP: (2e-4, 1e4), MANOEUVRE: (4.0, 4.0)}
"""Deviations of the changes before the fit: share of all rest frequencies; the same per
second, and the instant, s; velocity along and across the course, m/s."""

N_SIZES = {STEP: 1, RAMP: 1, MANOEUVRE: 2}
"""How many of these are sizes. A step and a manoeuvre make the frequencies jump, so
that their instants are sought one by one; that of a ramp is fitted with its slope."""


@dataclass(frozen=True)
class Change:
    """What changed once beside the passage: all rest frequencies, or the velocity.

    Its unknowns stand behind the depth difference: the step of the rest frequencies as
    a share, their slope (1/s) and what its instant is later by (s), or the differences
    of the velocity along the course and away from the sensor (m/s).
    """

    kind: str
    """'frequency-step', 'frequency-ramp' or 'manoeuvre'."""
    time_s: FloatArray
    """When it was, s: received for the frequencies, geometric for a manoeuvre; shape
    (batch,)."""
    sign: FloatArray
    """+1 where what changed follows that instant, -1 where it goes before, same shape."""

    @property
    def std(self) -> FloatArray:
        """Deviations of its unknowns before the fit."""
        return np.array(CHANGE_STD[self.kind])

    def law(self, straight: Passage, theta: FloatArray, time_s: FloatArray,
            medium: Medium) -> Passage:  # fmt: skip
        """Put the change into a straight passage.

        Parameters
        ----------
        straight
            The passage with the partials by the depth difference.
        theta
            Unknowns, with those of the change.
        time_s
            Times in seconds.
        medium
            Sound speed.
        """
        if self.kind == MANOEUVRE:
            change = (self.time_s, self.sign, theta[:, CHANGED:])
            return with_other_leg(
                straight, time_s, theta[:, :3], change, medium.sound_speed_mps,
                theta[:, HEIGHT],
            )  # fmt: skip
        count = CHANGED + self.std.size
        rows = np.zeros((*straight.rows.shape[:2], count, time_s.size))
        rows[:, :, :5] = straight.rows
        moved = self
        if self.kind == RAMP:
            moved = replace(self, time_s=self.time_s + theta[:, CHANGED + 1])
            is_changed = moved.shape(time_s) != 0.0
            slope = theta[:, CHANGED, None]
            rows[:, 0, 6] = np.where(is_changed, -slope * (1 + straight.shift), 0.0)
        shape = moved.shape(time_s)
        factor = 1 + theta[:, CHANGED, None] * shape
        rows[:, 0, 5] = (1 + straight.shift) * shape
        rows[:, 0, :5] *= factor[:, None]
        rows[:, 0, 0] += factor - 1
        return Passage(rows)

    def shape(self, time_s: FloatArray) -> FloatArray:
        """Return what a frequency does for each unit of its change, shape (batch, n).

        Parameters
        ----------
        time_s
            Times in seconds.
        """
        lag = time_s - self.time_s[:, None]
        is_changed = self.sign[:, None] * lag > 0
        return np.where(is_changed, lag if self.kind == RAMP else 1.0, 0.0)


FLOOR_PRIOR_DEVIATION = 4.0
"""Weak prior of ln floor about its start, so that an invisible floor is harmless."""


Losses = tuple[InformationLoss | None, InformationLoss | None, InformationLoss | None]
"""Information that coloured noise takes from each kind; None is white noise."""

NO_LOSS: Losses = (None, None, None)


@dataclass(frozen=True)
class WeightedData:
    """Blocks with the weights of one round, for every row of the batch."""

    time_s: FloatArray
    """Times of reception, s, shape (n,)."""
    shift: FloatArray
    """Frequencies over the line's mean, less one, shape (1 or batch, lines, n)."""
    shift_weight: FloatArray
    """Their inverse variances, shape (batch, lines, n)."""
    sums: LineSums
    """Sums of these two, the same for all steps of a round."""
    pair: FloatArray
    """One unwrapped combined bearing (rad) and the level (ln) per time, shape
    (batch, 2, n)."""
    pair_weight: FloatArray
    """Their inverse variances, same shape."""
    floor_start: FloatArray
    """ln of the floor at the start, the mean of its prior, shape (batch,)."""
    turn: FloatArray
    """Sign of the bearing trend, shape (batch,)."""
    is_free: BoolArray
    """Which unknowns the data can change, shape (batch, unknowns)."""
    losses: Losses = NO_LOSS
    """Information that coloured noise takes from frequencies, bearings and levels."""
    change: Change | None = None
    """What changed beside the passage."""


@dataclass(frozen=True)
class NormalEquations:
    """Cost and normal equations at one set of unknowns."""

    cost: FloatArray
    """Half the weighted sum of squares, shape (batch,)."""
    gradient: FloatArray
    """Its gradient, shape (batch, unknowns)."""
    matrix: FloatArray
    """Gauss-Newton matrix, shape (batch, unknowns, unknowns)."""


@dataclass(frozen=True)
class JointNormalEquations(NormalEquations):
    """Those of all kinds, the frequencies' own part, and the passage."""

    doppler: DopplerSums
    """The frequencies' own part."""
    law: Passage
    """The passage at these unknowns."""


def free_unknowns(theta: FloatArray, blocks: Blocks, medium: Medium) -> BoolArray:
    """Return which unknowns the data can determine.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    blocks
        Measurements in fit units.
    medium
        The depth difference: known exactly, or with a prior.
    """
    free = np.ones(theta.shape, dtype=np.bool_)
    free[:, 2] &= not blocks.shift.is_empty
    free[:, FLOOR] &= not blocks.level.is_empty
    if theta.shape[1] > HEIGHT and not medium.height_std_m:
        free[:, HEIGHT] = False
    return free


def motion_places(theta: FloatArray) -> list[int]:
    """Return the places of the motion among the unknowns: all but the floor.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    """
    return [n for n in range(theta.shape[-1]) if n != FLOOR]


def heights_m(theta: FloatArray, medium: Medium) -> FloatArray | float:
    """Return the depth difference of every row, or the one that is known.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    medium
        Sound speed and depth difference.
    """
    return theta[:, HEIGHT] if theta.shape[1] > HEIGHT else medium.height_m


def law_of(
    theta: FloatArray, time_s: FloatArray, medium: Medium, change: Change | None = None
) -> Passage:
    """Evaluate the passage of every row.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    time_s
        Times in seconds.
    medium
        Sound speed and depth difference.
    change
        What changed beside the passage, or None.
    """
    c, height = medium.sound_speed_mps, heights_m(theta, medium)
    free = theta.shape[1] > HEIGHT
    if theta.shape[0] == 1:
        known = float(np.ravel(height)[0])
        one = passage_law(time_s, theta[0, :3], c, known, with_height=free)
        law = Passage(one.rows[None])
    else:
        law = passage_law(time_s, theta[:, :3], c, height, with_height=free)
    return law if change is None else change.law(law, theta, time_s, medium)


def normal_equations(
    theta: FloatArray, data: WeightedData, medium: Medium, law: Passage | None = None
) -> JointNormalEquations:
    """Return half the weighted square sum, its gradient and Gauss-Newton matrix.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    data
        Measurements and weights.
    medium
        Sound speed and depth difference.
    law
        The passage at these unknowns, if it is known already.
    """
    if law is None:
        law = law_of(theta, data.time_s, medium, data.change)
    doppler = doppler_sums(
        law, data.shift, data.shift_weight, data.sums, data.losses[0]
    )
    full = _reduced(theta, law, data).sum(axis=1)
    cost = doppler.cost + 0.5 * full[:, 0, 0]
    gradient, matrix = full[:, 1:, 0], full[:, 1:, 1:]
    gradient[:, :3] += doppler.gradient[:, :3]
    matrix[:, :3, :3] += doppler.matrix[:, :3, :3]
    priors: list[tuple[int, FloatArray | float, float]] = [
        (FLOOR, data.floor_start, FLOOR_PRIOR_DEVIATION)
    ]
    if theta.shape[1] > HEIGHT:
        gradient[:, HEIGHT:] += doppler.gradient[:, 3:]
        matrix[:, HEIGHT:, HEIGHT:] += doppler.matrix[:, 3:, 3:]
        matrix[:, HEIGHT:, :3] += doppler.matrix[:, 3:, :3]
        matrix[:, :3, HEIGHT:] += doppler.matrix[:, :3, 3:]
        if medium.height_std_m:
            priors.append((HEIGHT, medium.height_m, medium.height_std_m))
    if data.change is not None:
        stds = enumerate(data.change.std, CHANGED)
        priors += [(place, 0.0, float(std)) for place, std in stds]
    for place, mean, std in priors:
        offset = (theta[:, place] - mean) / std
        cost = cost + 0.5 * offset**2
        gradient[:, place] += offset / std
        matrix[:, place, place] += std**-2
    free = data.is_free
    if not free.all():
        both = free[:, :, None] & free[:, None, :]
        gradient = np.where(free, gradient, 0.0)
        matrix = np.where(both, matrix, np.eye(theta.shape[1]))
    return JointNormalEquations(cost, gradient, matrix, doppler, law)


def block_normals(
    theta: FloatArray, data: WeightedData, law: Passage
) -> list[NormalEquations]:
    """Return the normal equations of frequencies, bearings and levels apart.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    data
        Measurements and weights.
    law
        The passage at these unknowns.
    """
    doppler = doppler_sums(
        law, data.shift, data.shift_weight, data.sums, data.losses[0]
    )
    places = motion_places(theta)
    gradient = np.zeros(theta.shape)
    gradient[:, places] = doppler.gradient
    matrix = np.zeros((*theta.shape, theta.shape[1]))
    matrix[:, np.array(places)[:, None], places] = doppler.matrix
    first = NormalEquations(doppler.cost, gradient, matrix)
    full = _reduced(theta, law, data)
    others = [
        NormalEquations(0.5 * full[:, k, 0, 0], full[:, k, 1:, 0], full[:, k, 1:, 1:])
        for k in range(2)
    ]
    return [first, *others]


def pair_rows(theta: FloatArray, law: Passage, data: WeightedData) -> FloatArray:
    """Return a one, the residual but for its constant, and its partials.

    Shape (batch, 2, 2 + unknowns, n), for the bearings and the levels.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    law
        The passage at the times of the measurements.
    data
        Measurements and weights.
    """
    turn = data.turn[:, None]
    floor = theta[:, 3:4]
    total = np.logaddexp(law.spread, floor)
    share = np.exp(law.spread - total)
    rows = np.empty((*data.pair.shape[:2], 2 + theta.shape[1], data.pair.shape[-1]))
    rows[:, :, 0] = 1.0
    rows[:, 0, 1] = data.pair[:, 0] - turn * law.angle
    rows[:, 1, 1] = data.pair[:, 1] - total
    np.multiply(law.rows[:, 1, 1:4], -turn[..., None], out=rows[:, 0, 2:5])
    np.multiply(law.rows[:, 2, 1:4], -share[:, None], out=rows[:, 1, 2:5])
    rows[:, 0, 2 + FLOOR] = 0.0
    rows[:, 1, 2 + FLOOR] = share - 1
    if theta.shape[1] > HEIGHT:
        others = slice(2 + HEIGHT, None)
        np.multiply(law.rows[:, 1, 4:], -turn[..., None], out=rows[:, 0, others])
        np.multiply(law.rows[:, 2, 4:], -share[:, None], out=rows[:, 1, others])
    return rows


def _reduced(theta: FloatArray, law: Passage, data: WeightedData) -> FloatArray:
    """Sum products of residual and partials, the constants projected out."""
    rows = pair_rows(theta, law, data)
    weighted = data.pair_weight[:, :, None] * rows
    for kind, loss in enumerate(data.losses[1:]):
        if loss is not None:
            weighted[:, kind] -= loss.times(rows[:, kind])
    full = weighted @ np.swapaxes(rows, -1, -2)
    first = full[..., 0, :]
    size = np.where(first[..., 0] > 0, first[..., 0], 1.0)[..., None]
    out: FloatArray = full - first[..., :, None] * (first / size)[..., None, :]
    return out[..., 1:, 1:]


@dataclass(frozen=True)
class PassageCovariance:
    """Covariance of the motion and deviations of the rest frequencies (relative)."""

    full: FloatArray
    """Of t0 (s), horizontal range over speed (s), v (m/s), bearing (degrees), depth
    difference (m) and what changed, shape (batch, 5 or more, same); a known depth
    difference has zeros."""
    slant: FloatArray
    """Of t0 (s), slant range over speed (s), v (m/s) and bearing (degrees), shape
    (batch, 4, 4)."""
    rest_std: FloatArray
    """Relative deviation of the rest frequencies, shape (batch, lines)."""


def passage_covariance(
    theta: FloatArray, data: WeightedData, normal: JointNormalEquations, medium: Medium
) -> PassageCovariance:
    """Return covariance and deviations at the optimum of every row.

    Parameters
    ----------
    theta
        Fitted unknowns, shape (batch, 4 or more).
    data
        Measurements with their final weights.
    normal
        Normal equations at the optimum.
    medium
        Sound speed and depth difference.
    """
    places = np.array(motion_places(theta))
    inner = inverse_or_nan(normal.matrix)[:, places[:, None], places]
    constant = data.pair_weight[:, 0]
    if data.losses[1] is not None:
        constant = constant - data.losses[1].times(np.ones_like(constant))
    bearing_size = constant.sum(axis=-1)
    has_bearing = bearing_size > 0
    size = np.where(has_bearing, bearing_size, 1.0)
    follow = (
        data.turn[:, None]
        * -(normal.law.rows[:, 1, 1:] @ constant[..., None])[..., 0]
        / size[:, None]
    )
    count = max(theta.shape[1], 5)
    full = np.zeros((theta.shape[0], count, count))
    to = np.array([0, 1, 2, *range(4, count)][: places.size])
    full[:, to[:, None], to] = inner
    cross = np.einsum("bpq,bq->bp", inner, follow)
    full[:, to, 3] = full[:, 3, to] = cross
    full[:, 3, 3] = 1 / size + (cross * follow).sum(axis=-1)
    unit = np.ones((theta.shape[0], count))
    unit[:, 1] = np.exp(theta[:, 1])
    unit[:, 3] = np.rad2deg(1.0)
    full *= unit[:, :, None] * unit[:, None, :]
    known = np.ones((theta.shape[0], count), np.bool_)
    known[:, 2] = data.is_free[:, 2]
    known[:, 3] = has_bearing
    turn = slant_partials(theta, medium)
    return PassageCovariance(
        _or_nan(full, known),
        _or_nan(turn @ full[:, :5, :5] @ np.swapaxes(turn, 1, 2), known[:, :4]),
        _rest_std(data, normal.doppler, inner),
    )


def slant_partials(theta: FloatArray, medium: Medium) -> FloatArray:
    """Differentiate (t0, slant over speed, v, bearing) by the horizontal unknowns.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    medium
        Sound speed and depth difference.

    Returns
    -------
    FloatArray
        Shape (batch, 4, 5); the last unknown is the depth difference.
    """
    height = heights_m(theta, medium)
    slant = slant_over_speed_s(np.exp(theta[:, 1]), theta[:, 2], height)
    speed, slope = bounded_speed(theta[:, 2])
    turn = np.zeros((theta.shape[0], 4, 5))
    turn[:, range(4), range(4)] = 1.0
    turn[:, 1, 1] = np.exp(theta[:, 1]) / slant
    turn[:, 1, 2] = -(height**2) / (speed**3 * slant) * slope
    turn[:, 1, 4] = height / (speed**2 * slant)
    return turn


def _or_nan(covariance: FloatArray, known: BoolArray) -> FloatArray:
    """Put nan where a quantity is not known, or its variance is not positive."""
    sound = (np.einsum("bii->bi", covariance) >= 0) & known
    return np.where(sound[:, :, None] & sound[:, None, :], covariance, np.nan)


def _rest_std(
    data: WeightedData, doppler: DopplerSums, inner: FloatArray
) -> FloatArray:
    measured = data.shift_weight.sum(axis=-1) > 0
    moved = ((doppler.follow @ inner) * doppler.follow).sum(axis=-1)
    variance: FloatArray = np.where(measured, doppler.variance + moved, np.nan)
    return np.sqrt(np.where(variance > 0, variance, np.nan))


@dataclass(frozen=True)
class PassageResiduals:
    """The law, the linear unknowns and the residuals of all rows."""

    law: Passage
    """The passage at the trial unknowns."""
    rest: FloatArray
    """Rest frequencies over the line's mean, less one, shape (batch, lines)."""
    bearing: FloatArray
    """Bearing at closest approach, rad, shape (batch,)."""
    level: FloatArray
    """Level at closest approach, ln of power, shape (batch,)."""
    residual: FloatArray
    """Measured less modelled, shape (batch, rows, n)."""


@dataclass(frozen=True)
class FitConstants:
    """What a fit does not change: turn, start of the floor, what is free, what changed."""

    turn: FloatArray
    """Sign of the bearing trend, +1 or -1, shape (batch,)."""
    floor: FloatArray
    """ln of the floor at the start, shape (batch,)."""
    free: BoolArray
    """Which unknowns the data can change, shape (batch, unknowns)."""
    change: Change | None = None
    """What changed beside the passage."""


def passage_state(
    theta: FloatArray,
    fixed: FitConstants,
    blocks: Blocks,
    medium: Medium,
    weight: FloatArray | None,
    normal: JointNormalEquations | None = None,
) -> PassageResiduals:
    """Evaluate the model, and its linear unknowns by weighted means.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 or more).
    fixed
        Turn of every row.
    blocks
        Measurements in fit units.
    medium
        Sound speed and depth difference.
    weight
        Weights of the last round; None takes the nominal ones.
    normal
        What was evaluated at these unknowns already, if anything.
    """
    if normal is None:
        law = law_of(theta, blocks.time_s, medium, fixed.change)
    else:
        law = normal.law
    is_rough = weight is None
    if weight is None:
        weight = blocks.weight
    lines, bearings, levels = blocks.parts
    residual = np.empty((theta.shape[0], *blocks.value.shape[1:]))
    of_line, basis = residual[:, lines], 1 + law.shift
    np.subtract(blocks.value[:, lines], law.shift[:, None], out=of_line)
    rest = _mean_ratio(of_line, basis, weight[:, lines])
    of_line -= rest[..., None] * basis[:, None]
    angle = fixed.turn[:, None] * law.angle
    around = blocks.value[:, bearings] - angle[:, None]
    centre = _circular_centre(around, weight[:, bearings])
    residual[:, bearings] = wrap_rad(around - centre[:, None, None])
    total = np.logaddexp(law.spread, theta[:, 3:4])
    above = blocks.value[:, levels] - total[:, None]
    level = _level_centre(above, weight[:, levels], is_rough)
    np.subtract(above, level[:, None, None], out=residual[:, levels])
    return PassageResiduals(law, rest, centre, level, residual)


def weigh(
    state: PassageResiduals,
    weight: FloatArray,
    blocks: Blocks,
    fixed: FitConstants,
    losses: Losses = NO_LOSS,
) -> WeightedData:
    """Put measurements and weights of one round together.

    Parameters
    ----------
    state
        The model at the present unknowns.
    weight
        Inverse variances of all rows.
    blocks
        Measurements in fit units.
    fixed
        Turn, floor and freedom.
    losses
        Information lost to coloured noise.
    """
    lines, bearings, levels = blocks.parts
    size = weight[:, bearings].sum(axis=1)
    near = (weight[:, bearings] * state.residual[:, bearings]).sum(axis=1)
    angle = fixed.turn[:, None] * state.law.angle
    pair = np.empty((fixed.turn.size, 2, blocks.time_s.size))
    pair[:, 0] = state.bearing[:, None] + angle + near / np.where(size > 0, size, 1.0)
    pair[:, 1] = blocks.value[:, levels][:, 0]
    pair_weight = np.empty_like(pair)
    pair_weight[:, 0] = size
    pair_weight[:, 1] = weight[:, levels][:, 0]
    return WeightedData(
        blocks.time_s,
        blocks.value[:, lines],
        weight[:, lines],
        line_sums(blocks.value[:, lines], weight[:, lines]),
        pair,
        pair_weight,
        fixed.floor,
        fixed.turn,
        fixed.free,
        losses,
        fixed.change,
    )


def _mean_ratio(value: FloatArray, basis: FloatArray, weight: FloatArray) -> FloatArray:
    """Fit value = ratio * basis (one basis for all rows) by weighted least squares."""
    below = (weight @ (basis**2)[..., None])[..., 0]
    above = ((weight * value) @ basis[..., None])[..., 0]
    ratio: FloatArray = above / np.where(below > 0, below, 1.0)
    return ratio


def _circular_centre(angle: FloatArray, weight: FloatArray) -> FloatArray:
    """Average directions, with one Newton step to the least-squares mean."""
    east = (weight * np.sin(angle)).sum(axis=(1, 2))
    north = (weight * np.cos(angle)).sum(axis=(1, 2))
    centre = np.arctan2(east, north)
    size = weight.sum(axis=(1, 2))
    near = wrap_rad(angle - centre[:, None, None])
    mean = (weight * near).sum(axis=(1, 2)) / np.where(size > 0, size, 1.0)
    turned: FloatArray = centre + mean
    return turned


def _level_centre(value: FloatArray, weight: FloatArray, is_rough: bool) -> FloatArray:
    if is_rough:
        flat = value.reshape(value.shape[0], -1)
        known = np.broadcast_to(weight, value.shape).reshape(flat.shape)
        middle = median_where(flat, known)
        return np.where(np.isfinite(middle), middle, 0.0)
    size = weight.sum(axis=(1, 2))
    mean: FloatArray = (weight * value).sum(axis=(1, 2)) / np.where(size > 0, size, 1.0)
    return mean


LONGEST_CORRELATION = 1.5
"""Bartlett's window in units of d/v: 60 s where d/v is 40 s."""

ROUGH_ROUNDS = 2
"""Rounds with simple robust weights before those that judge the noise in full."""

ROUGH_TOLERANCE = 20.0
"""Gain in log-likelihood at which a rough round ends, with one more step."""

SLOWNESS_SPM, SLOWNESS_STD_SPM = 0.22, 0.14
"""Inverse speed of vessels without Doppler, s/m: mean and deviation of 2 to 12 m/s."""

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
    rounds: int = 1,
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
    rounds
        Rounds with full weights, after the rough ones.
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
    for _ in range(rounds):
        correlation_time = (
            _longest_correlation_time_s(theta, blocks, medium)
            if with_coloured_noise
            else None
        )
        noises = block_noises(state.residual, blocks, correlation_time)
        weight = weight_of(noises)
        data = weigh(state, weight, blocks, fixed)
        theta, normal = _descend(theta, data, medium, state.law, 25)
        state = passage_state(theta, fixed, blocks, medium, weight, normal)
    if normal is None:
        normal = normal_equations(theta, data, medium, state.law)
    return _result(theta, data, (blocks, medium), (state, noises, normal))


def _unknowns(
    start: FloatArray, blocks: Blocks, medium: Medium
) -> tuple[FloatArray, Medium]:
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
        type(noise)(*(getattr(noise, f.name)[one] for f in fields(noise)))
        for noise in fit.noises
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
        else replace(
            fit.change, time_s=fit.change.time_s[one], sign=fit.change.sign[one]
        ),
    )


def fit_with_coloured_noise(
    fit: PassageFit, blocks: Blocks, *, rounds: int = 2
) -> PassageFit:
    """Fit one data set again with the covariance of its coloured noise.

    Returned as it is where the noise is white.

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
    losses = NO_LOSS
    state = passage_state(theta, fixed, blocks, medium, weight_of(noises))
    for _ in range(rounds):
        noises = block_noises(state.residual, blocks, 0.0)
        weight = weight_of(noises)
        data = weigh(state, weight, blocks, fixed)
        slow, losses = coloured_noises(theta, state, data, blocks, medium)
        if all(noise.is_white for noise in slow):
            return fit
        data = weigh(state, weight, blocks, fixed, losses)
        theta, normal = _descend(theta, data, medium, state.law, 15)
        state = passage_state(theta, fixed, blocks, medium, weight, normal)
    if normal is None:
        normal = normal_equations(theta, data, medium, state.law)
    return _result(theta, data, (blocks, medium), (state, noises, normal), slow)


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
    level = block_noises(state.residual, blocks, longest)[2]
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

    def evaluate(trial: FloatArray) -> Evaluation:
        known = law if trial is theta else None
        normal = normal_equations(trial, data, medium, known)
        last[:] = [(trial, normal)]
        return normal.cost, normal.gradient, normal.matrix

    found = damped_least_squares(
        evaluate, theta, _limiter(medium, data.change), max_steps=max_steps,
        tolerance=tolerance,
    )  # fmt: skip
    trial, normal = last[0]
    return found, normal if trial is found else None


def _longest_correlation_time_s(
    theta: FloatArray, blocks: Blocks, medium: Medium
) -> float:
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
        if change is not None and change.kind == RAMP:
            reach[:, CHANGED + 1] = 0.5 * reach[:, 0]
        limited: FloatArray = np.minimum(np.maximum(step, -reach), reach)
        speed = np.minimum(np.maximum(theta[:, 2] + step[:, 2], -fastest), fastest)
        limited[:, 2] = speed - theta[:, 2]
        if theta.shape[1] > HEIGHT:  # the source is in the water
            height = np.minimum(theta[:, HEIGHT] + limited[:, HEIGHT], medium.most_m)
            limited[:, HEIGHT] = height - theta[:, HEIGHT]
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
    if change is not None and change.kind == RAMP:
        change = replace(change, time_s=change.time_s + theta[:, CHANGED + 1])
        theta = theta.copy()
        theta[:, CHANGED + 1] = 0.0
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
) -> tuple[tuple[ColouredNoise, ...], Losses]:
    """Find the coloured noise of every kind, and what it takes from the information.

    Parameters
    ----------
    theta
        Unknowns, one row.
    state
        Residuals at these unknowns.
    data
        Measurements with the weights of their white noise.
    blocks
        Measurements in fit units.
    medium
        Sound speed and depth difference.
    """
    partials = np.swapaxes(pair_rows(theta, state.law, data)[0, :, 2:], -1, -2)
    model = state.bearing[0] + data.turn[0] * state.law.angle[0]
    lines, _, levels = blocks.parts
    series = (
        (state.residual[0, lines], data.shift_weight[0], -state.law.shift_d[0, :, :3]),
        (data.pair[0, 0] - model, data.pair_weight[0, 0], partials[0, :, :3]),
        (state.residual[0, levels], data.pair_weight[0, 1], partials[1, :, :4]),
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
        losses.append(
            None if noise.is_white else information_loss(size, data.time_s, noise)
        )
    return tuple(found), (losses[0], losses[1], losses[2])


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
