"""Several passages at once in broadband levels and bearings.

**Method.** Powers add, and so do intensities: the level is that of the sum of all
passing sources and a constant background, the bearing is the direction of the sum of
their intensities. All motions are fitted together (Levenberg-Marquardt steps with
robust weights), from a batch of starts. What one source alone would have given is the
working response of the joint fit: its own model plus the residual, with the
deviation, over its share of the whole.

**Conventions.** Powers are natural logarithms, bearings radians clockwise from north,
times those of reception. Unknowns of a start are ln N (background), the spreading
exponent over 20 log R (common to all: else one more source would make up for it),
ln K of the sources whose motion is known, and (t, ln d/v, ln K, bearing at closest
approach) of each other.

**References.** Choi et al. (2014), eq. 3, as a sum; Golub and Van Loan, section 6.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_rad
from uwtrack_cli.estimation.least_squares import Evaluation, damped_least_squares, inverse_or_nan
from uwtrack_cli.estimation.robust import CONSTANT, bisquare_weight, median_scale, neighbour_scale

N_COMMON = 4
"""Unknowns common to all: background, law of spreading, and the steady intensity, north
and east, over the power of the background: what stays is seldom alike from all sides."""

N_EACH = 4
"""Unknowns of a source: time, ln of d/v, ln of its power, bearing. Of one whose motion is
known: ln of its power, and how far time, ln of d/v and bearing lie off what is known, in
its deviations."""


@dataclass(frozen=True)
class BroadbandSeries:
    """Levels and bearings with their deviations, all (n,); nan is missing."""

    time_s: FloatArray
    """Times of reception, s, shape (n,)."""
    power: FloatArray
    """Natural logarithm of the power, shape (n,); nan is missing."""
    power_std: FloatArray
    """Its standard deviation."""
    bearing: FloatArray
    """Bearing in radians, shape (n,); nan is missing."""
    bearing_std: FloatArray
    """Its standard deviation in radians."""


@dataclass(frozen=True)
class KnownSources:
    """Sources whose motion is known: ln of (d/R)^2 and bearing, shape (m, n).

    What is known has deviations, within which levels and bearings may move it.
    """

    spread: FloatArray
    """Natural logarithm of (d/R)^2, shape (m, n)."""
    bearing: FloatArray
    """Bearing in radians, shape (m, n); nan where unknown."""
    spread_slope: FloatArray | None = None
    """What the spread changes by for a deviation of time, ln of d/v and bearing, shape
    (m, n, 3); None where all is known exactly."""
    bearing_slope: FloatArray | None = None
    """The same of the bearing, shape (m, n, 3)."""
    precision: FloatArray | None = None
    """Inverse of the correlation of these three, shape (m, 3, 3)."""

    @property
    def slopes(self) -> tuple[FloatArray, FloatArray]:
        """Slopes of spread and bearing, zero where all is known exactly."""
        none = np.zeros((*self.spread.shape, 3))
        found = (self.spread_slope, self.bearing_slope)
        spread, bearing = (none if one is None else one for one in found)
        return spread, np.nan_to_num(bearing)

    def moved(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return ln of the powers, spread and bearing for unknowns of a joint fit.

        Parameters
        ----------
        theta
            Unknowns, shape (batch, 4 + 4 m + 4 k).

        Returns
        -------
        tuple of arrays
            Shapes (batch, m, 1), (batch, m, n) and (batch, m, n).
        """
        batch, count = theta.shape[0], self.spread.shape[0]
        own = theta[:, N_COMMON : N_COMMON + N_EACH * count]
        own = own.reshape(batch, count, N_EACH)
        spread, bearing = self.slopes
        return (
            own[..., :1],
            self.spread + np.einsum("mnp,bmp->bmn", spread, own[..., 1:]),
            self.bearing + np.einsum("mnp,bmp->bmn", bearing, own[..., 1:]),
        )


class SourceParts(NamedTuple):
    """Power and intensity of every source, and of what is always there."""

    power: FloatArray
    """Powers, shape (batch, m + k, n)."""
    intensity: NDArray[np.complex128]
    """Intensities, north + i east, same shape."""
    background: FloatArray
    """Power of the background, shape (batch, 1)."""
    steady: NDArray[np.complex128]
    """Intensity of the background, shape (batch, 1)."""


def source_parts(
    theta: FloatArray, turn: FloatArray, time_s: FloatArray, known: KnownSources
) -> SourceParts:
    """Return the parts of the broadband sound.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 + 4 m + 4 k).
    turn
        Sign of the bearing trend of the free sources, shape (batch, k).
    time_s
        Times of reception in seconds, shape (n,).
    known
        Sources of known motion.
    """
    n_known, batch = known.spread.shape[0], theta.shape[0]
    free = theta[:, N_COMMON + N_EACH * n_known :].reshape(batch, -1, N_EACH)
    law = theta[:, 1, None, None]
    x = (time_s - free[..., 0:1]) / np.exp(free[..., 1:2])
    moving = np.exp(free[..., 2:3] - law * np.log1p(x**2))
    angle = free[..., 3:4] + turn[..., None] * np.arctan(x)
    own, spread, bearing = known.moved(theta)
    steady = np.exp(own + law * spread)
    power = np.concatenate([steady, moving], axis=1)
    # a known source without bearings has no share in the intensity
    seen = np.nan_to_num(np.exp(1j * bearing))
    direction = np.concatenate([seen, np.exp(1j * angle)], axis=1)
    background = np.exp(theta[:, :1])
    flow = background * (theta[:, 2:3] + 1j * theta[:, 3:4])
    return SourceParts(power, power * direction, background, flow)


def sum_residuals(
    theta: FloatArray, turn: FloatArray, sound: BroadbandSeries, known: KnownSources
) -> tuple[FloatArray, FloatArray]:
    """Residuals of levels and bearings (batch, 2 n), and their partials.

    Parameters
    ----------
    theta
        Unknowns, shape (batch, 4 + 4 m + 4 k).
    turn
        Sign of the bearing trend of the free sources, shape (batch, k).
    sound
        Levels and bearings.
    known
        Sources of known motion.
    """
    power, vector, background, flow = source_parts(theta, turn, sound.time_s, known)
    n_known, (batch, n_all, n) = known.spread.shape[0], power.shape
    total = background + power.sum(axis=1)
    whole = flow + vector.sum(axis=1)
    size = np.maximum(np.abs(whole) ** 2, 1e-300)
    turned = wrap_rad(np.nan_to_num(sound.bearing) - np.angle(whole))
    residual = np.concatenate([np.nan_to_num(sound.power) - np.log(total), turned], axis=1)
    slope = np.zeros((batch, 2 * n, theta.shape[1]))
    to_angle = whole.conj() / size
    slope[:, :n, 0] = -background / total
    slope[:, n:, 0] = -(flow * to_angle).imag
    slope[:, n:, 2] = -(background * to_angle).imag
    slope[:, n:, 3] = -(1j * background * to_angle).imag
    share = power / total[:, None]
    pull = vector * to_angle[:, None]
    _, spread, _ = known.moved(theta)
    slope[:, :n, 1] = -(share[:, :n_known] * spread).sum(axis=1)
    slope[:, n:, 1] = -(pull[:, :n_known].imag * spread).sum(axis=1)
    by_spread, by_bearing = known.slopes
    for row in range(n_known):
        first = N_COMMON + N_EACH * row
        own, drawn = share[:, row], pull[:, row]
        slope[:, :n, first], slope[:, n:, first] = -own, -drawn.imag
        columns = slice(first + 1, first + N_EACH)
        louder = theta[:, 1, None, None] * by_spread[row]
        slope[:, :n, columns] = -own[..., None] * louder
        twist = louder + 1j * by_bearing[row]
        slope[:, n:, columns] = -(drawn[..., None] * twist).imag
    law = theta[:, 1, None]
    for row in range(n_all - n_known):
        first = N_COMMON + N_EACH * (n_known + row)
        t0, width = theta[:, first, None], np.exp(theta[:, first + 1, None])
        x = (sound.time_s - t0) / width
        own, drawn = share[:, n_known + row], pull[:, n_known + row]
        sense = turn[:, row, None]
        slow = 1 / (1 + x**2)
        slope[:, :n, 1] += own * np.log1p(x**2)
        slope[:, n:, 1] += drawn.imag * np.log1p(x**2)
        slope[:, :n, first] = -own * law * 2 * x * slow / width
        slope[:, :n, first + 1] = -own * law * 2 * x**2 * slow
        slope[:, :n, first + 2] = -own
        fall, swing = 2 * law * x, 1j * sense
        slope[:, n:, first] = -(drawn * (fall - swing)).imag * slow / width
        slope[:, n:, first + 1] = -(drawn * (fall - swing) * x).imag * slow
        slope[:, n:, first + 2] = -drawn.imag
        slope[:, n:, first + 3] = -drawn.real
    return residual, slope


BACKGROUND_STD = 2.0
"""Weak prior of ln N about its start, so that an unheard background is harmless."""

LAW_STD, LOWEST_LAW, HIGHEST_LAW = 0.25, 0.4, 1.6
"""The law of spreading over 20 log R: prior deviation (15 to 25 log R), and bounds."""

STEADY_STD = 0.5
"""Prior deviation of the steady intensity, north and east, over the background's power:
isotropic noise has none, and one distant source alone has one."""

ROUNDS = 3
"""Rounds of robust weights."""

SMALLEST_SHARE = 0.2
"""A source's share of the intensity below which a bearing is not used for it."""

LARGEST_SCATTER_RAD = 1.0
"""Bearings less certain than this are not used in a search."""


@dataclass(frozen=True)
class SourceFit:
    """A joint fit: unknowns, turns of the free sources, cost, the known ones."""

    theta: FloatArray
    """Unknowns, shape (4 + 4 m + 4 k,)."""
    turn: FloatArray
    """Sign of the bearing trend of the free sources, shape (k,)."""
    cost: float
    """Robust loss of the residuals plus the priors."""
    n_known: int
    """Number m of sources whose motion is known."""

    @property
    def background(self) -> float:
        """Natural logarithm of the background power."""
        return float(self.theta[0])

    @property
    def motion(self) -> FloatArray:
        """Rows of (t, ln d/v, ln K, bearing) of the free sources."""
        return self.theta[N_COMMON + N_EACH * self.n_known :].reshape(-1, N_EACH)

    def take(self, rows: list[int]) -> "SourceFit":
        """Return some of the free sources."""
        head = self.theta[: N_COMMON + N_EACH * self.n_known]
        theta = np.concatenate([head, self.motion[rows].ravel()])
        return replace(self, theta=theta, turn=self.turn[rows])


def no_sources(sound: BroadbandSeries, known: KnownSources) -> SourceFit:
    """Fit the background and the powers of the known sources alone.

    Parameters
    ----------
    sound
        Levels and bearings.
    known
        Sources of known motion.
    """
    count = known.spread.shape[0]
    loudest = float(np.nanquantile(sound.power, 0.98))
    theta = np.zeros((1, N_COMMON + N_EACH * count))
    theta[0, :2] = _quiet(sound), 1.0
    theta[0, N_COMMON::N_EACH] = loudest
    return fit_sources(sound, known, theta, np.empty((1, 0)))


def fit_sources(
    sound: BroadbandSeries, known: KnownSources, start: FloatArray, turn: FloatArray
) -> SourceFit:
    """Fit all sources together from every start; the best is returned.

    Parameters
    ----------
    sound
        Levels and bearings.
    known
        Sources of known motion.
    start
        Unknowns to start from, shape (batch, 4 + 4 m + 4 k).
    turn
        Sign of the bearing trend of the free sources, shape (batch, k).
    """
    theta = start
    n_known = known.spread.shape[0]
    precision = _precision(sound)
    middle, prior = _prior(sound, known)
    head = middle.size
    for _ in range(ROUNDS):
        residual = sum_residuals(theta, turn, sound, known)[0]
        weight = _weights(residual, precision)

        def evaluate(theta: FloatArray, _: IntArray, weight: FloatArray = weight) -> Evaluation:
            residual, slope = sum_residuals(theta, turn, sound, known)
            weighted = weight[..., None] * slope
            gradient = np.einsum("bnp,bn->bp", weighted, residual)
            matrix = np.swapaxes(weighted, 1, 2) @ slope
            offset = theta[:, :head] - middle
            pull = offset @ prior
            gradient[:, :head] += pull
            matrix[:, :head, :head] += prior
            cost = 0.5 * (weight * residual**2).sum(axis=-1)
            return cost + 0.5 * (pull * offset).sum(axis=-1), gradient, matrix

        theta = damped_least_squares(
            evaluate, theta, _limiter(n_known, sound), max_steps=25, tolerance=0.01
        )
    residual = sum_residuals(theta, turn, sound, known)[0]
    share = np.minimum(residual**2 * precision / CONSTANT**2, 1.0)
    cost = (CONSTANT**2 / 6 * (1 - (1 - share) ** 3)).sum(axis=-1)
    offset = theta[:, :head] - middle
    cost += 0.5 * ((offset @ prior) * offset).sum(axis=-1)
    best = int(np.argmin(np.where(np.isfinite(cost), cost, np.inf)))
    return SourceFit(theta[best], turn[best], float(cost[best]), n_known)


WIDENED = [N_COMMON, N_COMMON + 1, N_COMMON + 3]
"""Places of time, ln of d/v and bearing behind the common unknowns."""


def _prior(sound: BroadbandSeries, known: KnownSources) -> tuple[FloatArray, FloatArray]:
    """Return middle and precision of what is common and of the sources that are known."""
    count = known.spread.shape[0]
    middle = np.zeros(N_COMMON + N_EACH * count)
    middle[:2] = _quiet(sound), 1.0
    std = np.array([BACKGROUND_STD, LAW_STD, STEADY_STD, STEADY_STD])
    precision = np.zeros((middle.size, middle.size))
    precision[:N_COMMON, :N_COMMON] = np.diag(std**-2.0)
    for row in range(count):
        own = slice(N_COMMON + N_EACH * row + 1, N_COMMON + N_EACH * (row + 1))
        told = np.eye(3) if known.precision is None else known.precision[row]
        precision[own, own] = told
    return middle, precision


def widening(sources: SourceFit, sound: BroadbandSeries, known: KnownSources) -> FloatArray:
    """Return how much the other sources widen (t, ln d/v, bearing) of each free one.

    Parameters
    ----------
    sources
        Joint fit.
    sound
        Levels and bearings.
    known
        Sources of known motion.

    Returns
    -------
    FloatArray
        Factors of the deviations, shape (k, 3), one or more.
    """
    residual, slope = sum_residuals(sources.theta[None], sources.turn[None], sound, known)
    precision = _precision(sound)
    weight = _weights(residual, precision)
    matrix: FloatArray = (np.swapaxes(weight[..., None] * slope, 1, 2) @ slope)[0]
    matrix[np.diag_indices_from(matrix)] += 1e-9
    middle, prior = _prior(sound, known)
    matrix[: middle.size, : middle.size] += prior
    joint = np.sqrt(np.diag(inverse_or_nan(matrix)))
    factors = np.ones((sources.turn.size, 3))
    for row in range(sources.turn.size):
        first = N_COMMON + N_EACH * (sources.n_known + row)
        own = np.array([*range(N_COMMON), *range(first, first + N_EACH)])
        alone = np.sqrt(np.diag(inverse_or_nan(matrix[np.ix_(own, own)])))
        factors[row] = np.nan_to_num(joint[own] / alone, nan=1.0)[WIDENED]
    return np.maximum(factors, 1.0)


def alone(
    sources: SourceFit, row: int | None, sound: BroadbandSeries, known: KnownSources
) -> BroadbandSeries:
    """Return what one source alone would have given, or what is yet unexplained.

    Parameters
    ----------
    sources
        Joint fit.
    row
        The source, the known ones first; None for what is not explained, to search.
    sound
        Levels and bearings.
    known
        Sources of known motion, on the same times.
    """
    parts, vectors, background, flow = source_parts(
        sources.theta[None], sources.turn[None], sound.time_s, known
    )
    power, vector = parts[0], vectors[0]
    total = background[0] + power.sum(axis=0)
    whole = flow[0] + vector.sum(axis=0)
    left = sound.power - np.log(total)
    if row is None:
        return _unexplained(sound, left, whole, float(background[0, 0]))
    own = power[row] + background[0]
    factor = total / own
    direction = vector[row]
    size = np.maximum(np.abs(whole) ** 2, 1e-300)
    share = (direction * whole.conj()).real / size
    turned = wrap_rad(sound.bearing - np.angle(whole))
    usable = share > SMALLEST_SHARE
    share = np.where(usable, share, np.nan)
    return BroadbandSeries(
        sound.time_s,
        np.log(own) + left * factor,
        sound.power_std * factor,
        np.angle(direction) + turned / share,
        sound.bearing_std / share,
    )


def _unexplained(
    sound: BroadbandSeries, left: FloatArray, whole: FloatArray, background: float
) -> BroadbandSeries:
    """Levels over what is explained; directions of the intensity that is not."""
    measured = np.maximum(np.exp(sound.power) - background, 0.0)
    vector = measured * np.exp(1j * sound.bearing) - whole
    error = np.hypot(measured * sound.bearing_std, np.exp(sound.power) * sound.power_std)
    std = error / np.maximum(np.abs(vector), 1e-300)
    return BroadbandSeries(
        sound.time_s,
        left + np.log(background),
        sound.power_std,
        np.angle(vector),
        np.where(std < LARGEST_SCATTER_RAD, std, np.nan),
    )


def _quiet(sound: BroadbandSeries) -> float:
    """Return the level that one frame of ten stays below."""
    return float(np.nanquantile(sound.power, 0.1))


def _precision(sound: BroadbandSeries) -> FloatArray:
    """Inverse variances of levels and bearings, at the scale of their neighbours."""
    parts = []
    for value, std in (
        (sound.power, sound.power_std),
        (np.unwrap(np.nan_to_num(sound.bearing)), sound.bearing_std),
    ):
        good = np.isfinite(value) & np.isfinite(std) & (std > 0)
        weight = np.where(good, 1 / np.where(good, std, 1.0) ** 2, 0.0)
        scale = neighbour_scale(np.where(good, value, 0.0), weight)
        parts.append(weight / np.maximum(scale, 1.0) ** 2)
    return np.concatenate(parts)


def _weights(residual: FloatArray, precision: FloatArray) -> FloatArray:
    """Robust weights, at the residuals' own scale while sources are missing."""
    kinds = []
    half = precision.size // 2
    for part in (slice(0, half), slice(half, None)):
        deviation = residual[:, part] * np.sqrt(precision[part])
        known = np.broadcast_to(precision[part], deviation.shape)
        scale = np.maximum(median_scale(deviation, known), 1.0)[:, None]
        kinds.append(precision[part] * bisquare_weight(deviation / scale) / scale**2)
    return np.concatenate(kinds, axis=1)


def _limiter(
    n_known: int, sound: BroadbandSeries
) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Keep steps within the reach of the linearisation, and widths sensible."""
    step_s = float(np.median(np.diff(sound.time_s)))
    low, high = np.log(step_s), np.log(2 * float(np.ptp(sound.time_s)))

    def limit(theta: FloatArray, step: FloatArray) -> FloatArray:
        limited = np.clip(step, -2.0, 2.0)
        times = slice(N_COMMON + N_EACH * n_known, None, N_EACH)
        widths = slice(N_COMMON + N_EACH * n_known + 1, None, N_EACH)
        limited[:, 0] = np.clip(step[:, 0], -0.5, 0.5)
        law = theta[:, 1] + np.clip(step[:, 1], -0.1, 0.1)
        limited[:, 1] = np.clip(law, LOWEST_LAW, HIGHEST_LAW) - theta[:, 1]
        limited[:, 2:N_COMMON] = np.clip(step[:, 2:N_COMMON], -0.3, 0.3)
        reach = 2 * np.exp(theta[:, widths])
        limited[:, times] = np.clip(step[:, times], -reach, reach)
        wider = theta[:, widths] + np.clip(step[:, widths], -1.0, 1.0)
        limited[:, widths] = np.clip(wider, low, high) - theta[:, widths]
        return limited

    return limit
