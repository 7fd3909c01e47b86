"""Noise of the rows of a contact: white, that of own navigation, and one with a memory.

**Method.** Every value has the white noise that was stated. Errors of own position and
velocity are Ornstein-Uhlenbeck processes that all values share: a frequency tells the range
rate, which the difference of two positions moves, a delay the range, and a bearing what
lies across the line of sight. Noise with a memory is a sum of such processes, one set for all bearings, one for
all frequencies and one for delays; its strengths and correlation times come from the residuals
(`coloured_noise`). The processes are unknowns with the tridiagonal precision of a Markov
chain, and are projected out: with the partials G of the values by their nodes,
N^-1 = D^-1 - D^-1 G (M^-1 + G' D^-1 G)^-1 G' D^-1 in work that grows with the rows
(Woodbury's identity; Rue and Held 2005, ch. 2).

**Conventions.** Values are whitened by their stated deviations: bearings (stream, row),
then frequencies (line, row) and delays, flattened. Errors along and across the line of sight are
independent while it turns little within their correlation time.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.estimation.least_squares import orthonormal
from uwtrack_cli.motion.coloured_noise import SMALLEST_GAIN, SMALLEST_SHARE, WHITE, ColouredNoise
from uwtrack_cli.motion.target_motion.error_budget import (
    NuisanceDeviations,
    along_sight,
    looks_white,
)
from uwtrack_cli.motion.target_motion.objective import Residuals, loss_weight
from uwtrack_cli.motion.target_motion.problem import Problem

Colours = tuple[ColouredNoise, ColouredNoise, ColouredNoise]
"""Noise with a memory of bearings, of frequencies and of delays, in variances of one
value."""

NO_MEMORY: Colours = (WHITE, WHITE, WHITE)

N_CORRELATION_TIMES = 8
"""Correlation times that are tried, from the rows' spacing to the record's length."""

STRENGTHS = np.geomspace(0.01, 100.0, 9)
"""Variances of noise with a memory that are tried, over that of white noise."""

SAME_INSTANT = 1e-6
"""Share of a correlation time within which two instants are one node."""


@dataclass(frozen=True, eq=False)
class _Process:
    """One Ornstein-Uhlenbeck process that values share."""

    variance: float
    """Its variance."""
    correlation_time_s: float
    """Its correlation time, s."""
    time_s: FloatArray
    """Instants of it that every value holds, s, shape (values, k)."""
    gain: FloatArray
    """Partials of the value by these, same shape."""

    @property
    def of_value(self) -> FloatArray:
        """Variance that every value has from it, shape (values,)."""
        lag = self.time_s[:, :, np.newaxis] - self.time_s[:, np.newaxis]
        like = np.exp(-np.abs(lag) / self.correlation_time_s)
        each = np.einsum("vi,vij,vj->v", self.gain, like, self.gain)
        return np.asarray(self.variance * each)


@dataclass(frozen=True, eq=False)
class RowNoise:
    """Noise of the values of one contact."""

    white: FloatArray
    """Variance of the white part of every value, shape (values,)."""
    processes: tuple[_Process, ...]
    """What values share."""

    @property
    def variance(self) -> FloatArray:
        """Variance of every value, shape (values,)."""
        return self.white + sum(one.of_value for one in self.processes)

    @cached_property
    def _solver(self) -> tuple[Any, FloatArray, float] | None:
        """Partials of all values by all nodes, and the banded factor of their precision.

        Behind them the logarithm of the determinant of the nodes' prior covariance.
        """
        from scipy.linalg import cholesky_banded
        from scipy.sparse import coo_array

        times, rows, columns, gains, pairs = [], [], [], [], []
        first, volume = 0, 0.0
        for one in self.processes:
            value, place = np.nonzero(one.gain)
            if not value.size:
                continue
            grain = SAME_INSTANT * one.correlation_time_s
            keys, node = np.unique(np.rint(one.time_s[value, place] / grain), return_inverse=True)
            times.append(keys * grain)
            rows.append(value)
            columns.append(first + node)
            gains.append(one.gain[value, place])
            decay = np.exp(-np.diff(times[-1]) / one.correlation_time_s)
            new = one.variance * (1.0 - decay**2)
            here = first + np.arange(keys.size)
            inner = np.zeros(keys.size)
            inner[0] = 1.0 / one.variance
            inner[1:] += 1.0 / new
            inner[:-1] += decay**2 / new
            pairs.append((here, here, inner))
            pairs.append((here[1:], here[:-1], -decay / new))
            first += keys.size
            volume += float(np.log(one.variance) + np.log(new).sum())
        if not times:
            return None
        order = np.argsort(np.argsort(np.concatenate(times), kind="stable"))
        partials = coo_array(
            (np.concatenate(gains), (np.concatenate(rows), order[np.concatenate(columns)])),
            shape=(self.white.size, first),
        ).tocsr()
        told = (partials.T @ (partials / self.white[:, np.newaxis])).tocoo()
        lower = told.row >= told.col
        parts = [(told.row[lower], told.col[lower], told.data[lower])]
        for a, b, each in pairs:
            late, early = np.maximum(order[a], order[b]), np.minimum(order[a], order[b])
            parts.append((late, early, each))
        row, column, entry = (np.concatenate(part) for part in zip(*parts, strict=True))
        band = np.zeros((int((row - column).max()) + 1, first))
        np.add.at(band, (row - column, column), entry)
        return partials, cholesky_banded(band, lower=True), volume

    def weigh(self, values: FloatArray) -> FloatArray:
        """Return the inverse covariance times columns, shape (values, columns)."""
        from scipy.linalg import cho_solve_banded

        white = self.white[:, np.newaxis]
        plain = values / white
        if self._solver is None:
            return np.asarray(plain)
        partials, factor, _ = self._solver
        shared = cho_solve_banded((factor, True), partials.T @ plain)
        return np.asarray(plain - partials @ shared / white)

    @property
    def log_volume(self) -> float:
        """Logarithm of the determinant of the covariance."""
        total = float(np.log(self.white).sum())
        if self._solver is None:
            return total
        _, factor, volume = self._solver
        return total + 2.0 * float(np.log(factor[0]).sum()) + volume


def row_noise(
    problem: Problem, r: Residuals, nuisances: NuisanceDeviations, colours: Colours = NO_MEMORY
) -> RowNoise:
    """Return the noise of the values of one motion's residuals."""
    own = RowNoise(np.ones(_n_values(problem)), _navigation(problem, r, nuisances))
    if all(colour.is_white for colour in colours):
        return own
    time, share = _value_time_s(problem), whitened(problem, r)[1]
    white, memory = np.ones(own.white.size), list[_Process]()
    for of_kind, colour in zip(kinds_of(problem), colours, strict=True):
        white[of_kind] = colour.inflation
        gain = np.zeros(white.size)
        root = np.sqrt(np.maximum(_count(problem, of_kind), 1.0))
        each = (share * _measured(problem))[of_kind].reshape(-1, root.size) / root
        gain[of_kind] = each.ravel()
        memory += [
            _Process(colour.inflation * strength, time_s, time, gain[:, np.newaxis])
            for strength, time_s in zip(
                colour.variance.tolist(), colour.correlation_time_s.tolist(), strict=True
            )
        ]
    return RowNoise(white, (*own.processes, *memory))


def find_colours(
    problem: Problem,
    r: Residuals,
    nuisances: NuisanceDeviations,
    design: FloatArray,
    prior_rows: FloatArray,
) -> Colours:
    """Find the memory of the noise of bearings, frequencies and delays in residuals.

    ``design`` are the partials of the whitened values by all that was fitted, shape
    (values, p), and ``prior_rows`` those of what was expected, shape (k, p).

    Notes
    -----
    One series stands for a kind: the sum of its values at a row over the root of their
    number, which holds what they have in common.
    """
    own = _navigation(problem, r, nuisances)
    z, _ = whitened(problem, r)
    found = []
    for of_kind in kinds_of(problem):
        count = _count(problem, of_kind)
        if not count.any():
            found.append(WHITE)
            continue
        measured = count > 0
        value, columns = (_pooled(x, of_kind, count)[measured] for x in (z, design))
        known = tuple(
            replace(
                one, time_s=one.time_s[of_kind][: count.size][measured],
                gain=_pooled(one.gain, of_kind, count)[measured],
            )
            for one in own
        )  # fmt: skip
        expected = RowNoise(np.ones(value.size), known).variance
        if looks_white(value / np.sqrt(expected)):
            found.append(WHITE)
            continue
        rest = np.concatenate([np.delete(design, of_kind, axis=0), prior_rows])
        upper = np.asarray(np.linalg.qr(rest, mode="r"))
        found.append(_memory(value, problem.row_time_s[measured], columns, upper, known))
    return found[0], found[1], found[2]


def _memory(
    value: FloatArray,
    time_s: FloatArray,
    design: FloatArray,
    others: FloatArray,
    known: tuple[_Process, ...],
) -> ColouredNoise:
    """Return white and Markov noise of a series by the restricted likelihood.

    Residuals in stated deviations, shape (n,), what was fitted to them, shape (n, p), what
    holds that in place elsewhere, shape (k, p), and the noise that is known. The mean over all strengths and correlation
    times that are likely, uniform in their logarithms; the total is no smaller than was
    stated.
    """
    basis = orthonormal(np.concatenate([design, others]))
    n, step_s = value.size, float(np.median(np.diff(np.unique(time_s))))
    own = np.column_stack([value, basis[:n]])
    rest = basis[n:].T @ basis[n:]
    times = np.geomspace(step_s, float(np.ptp(time_s)), N_CORRELATION_TIMES)
    odds = np.append(0.0, STRENGTHS)
    likelihood = np.full((times.size, odds.size), -np.inf)
    total = np.ones_like(likelihood)
    plain, white = 0.0, 0.0
    for (row, memory_s), (column, more) in product(enumerate(times), enumerate(odds)):
        share = more / (1.0 + more)
        if row and not share:
            continue
        memory = _Process(share, memory_s, time_s[:, np.newaxis], np.ones((n, 1)))
        noise = RowNoise(np.full(n, 1.0 - share), (*known, memory) if share else known)
        gram = own.T @ noise.weigh(own)
        matrix = gram[1:, 1:] + rest
        square = float(gram[0, 0] - gram[0, 1:] @ np.linalg.solve(matrix, gram[0, 1:]))
        total[row, column] = power = max(square / n, 1.0)
        volume = noise.log_volume + float(np.linalg.slogdet(matrix)[1])
        likelihood[row, column] = -0.5 * (n * np.log(power) + square / power + volume)
        if not share:
            plain, white = -0.5 * (square + volume), float(likelihood[row, column])
    chance = np.exp(likelihood - likelihood.max())
    chance[:, 0] = 0.0
    if likelihood[:, 1:].max() <= white + SMALLEST_GAIN:
        inflation = float(total[0, 0]) if white > plain + SMALLEST_GAIN else 1.0
        return ColouredNoise(np.empty(0), np.empty(0), inflation)
    weight = chance / chance.sum() * total
    inner = float((weight / (1.0 + odds)).sum())
    strength = (weight * (odds / (1.0 + odds))).sum(axis=1) / inner
    kept = strength > SMALLEST_SHARE * strength.sum()
    return ColouredNoise(strength[kept], times[kept], inner)


def alike_rows(colour: ColouredNoise, time_s: FloatArray) -> float:
    """Return the rows that count as one in the scatter of a mean square.

    The sum of the squared correlations over all lags (Bartlett 1946).
    """
    if not colour.variance.size or time_s.size < 2:
        return 1.0
    lag = np.arange(time_s.size) * float(np.ptp(time_s)) / (time_s.size - 1)
    like = np.exp(-lag[1:, np.newaxis] / colour.correlation_time_s) @ colour.variance
    like = like / (1.0 + colour.variance.sum())
    return 1.0 + 2.0 * float((like**2).sum())


def whitened(problem: Problem, r: Residuals) -> tuple[FloatArray, FloatArray]:
    """Return residuals as the loss weighs them, and the root of that weight."""
    z = np.concatenate([r.bearing[0].ravel(), r.frequency[0].ravel()])
    share = np.sqrt(np.maximum(loss_weight(z, problem.loss), 0.0))
    return share * z, share


def _n_values(problem: Problem) -> int:
    return (len(problem.bearing_weight) + problem.n_lines) * problem.n_rows


def kinds_of(problem: Problem) -> tuple[slice, slice, slice]:
    """Return the values that are bearings, frequencies, and delays."""
    n = problem.bearing_weight.size
    m = n + problem.n_tones * problem.n_rows
    return slice(0, n), slice(n, m), slice(m, _n_values(problem))


def _value_time_s(problem: Problem) -> FloatArray:
    """Return the time of every value, s, shape (values, 1)."""
    series = len(problem.bearing_weight) + problem.n_lines
    return np.tile(problem.row_time_s, series)[:, np.newaxis]


def _measured(problem: Problem) -> FloatArray:
    weight = [problem.bearing_weight.ravel(), problem.frequency_weight.ravel()]
    return (np.concatenate(weight) > 0).astype(float)


def _pooled(values: FloatArray, of_kind: slice, count: FloatArray) -> FloatArray:
    """Return the sums of a kind's values at every row over the root of their number."""
    rows = values[of_kind].reshape(-1, count.size, *values.shape[1:])
    root = np.sqrt(np.maximum(count, 1.0))
    return np.asarray(rows.sum(axis=0) / root.reshape(-1, *[1] * (values.ndim - 1)))


def _count(problem: Problem, of_kind: slice) -> FloatArray:
    return np.asarray(_measured(problem)[of_kind].reshape(-1, problem.n_rows).sum(axis=0))


def _navigation(
    problem: Problem, r: Residuals, nuisances: NuisanceDeviations
) -> tuple[_Process, ...]:
    """Return what errors of own position and velocity do to the values."""
    _, share = whitened(problem, r)
    bearings, *_ = kinds_of(problem)
    track, memory_s = problem.track, nuisances.correlation_time_s
    time = _value_time_s(problem)
    turn, rate, near = (np.zeros(share.size) for _ in range(3))
    across = np.hypot(*r.prediction.bearing_jacobian[0, :2])
    turn[bearings] = (problem.bearing_weight * np.abs(r.side[0]) * across).ravel()
    velocity, place = along_sight(problem, r)
    rate[bearings.stop :], near[bearings.stop :] = velocity.ravel(), place.ravel()
    turn, rate, near = share * turn, share * rate, share * near
    found = []
    if nuisances.own_position_m:
        variance = nuisances.own_position_m**2
        found.append(_Process(variance, memory_s, time, turn[:, np.newaxis]))
        series = time.size // problem.n_rows
        over = np.tile(track.interval_s, series)[:, np.newaxis]
        early = time - over * (0.5 if track.before is None else 1.0)
        step = rate[:, np.newaxis] / over
        ends = np.concatenate([early, early + over, time], axis=1)
        gain = np.concatenate([-step, step, near[:, np.newaxis]], axis=1)
        found.append(_Process(variance, memory_s, ends, gain))
    if nuisances.own_velocity_mps:
        variance = nuisances.own_velocity_mps**2
        found.append(_Process(variance, memory_s, time, rate[:, np.newaxis]))
    return tuple(found)
