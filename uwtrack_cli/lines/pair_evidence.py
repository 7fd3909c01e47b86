"""The evidence that two tracked lines come from one source, for all pairs of lines.

**Method.** The lines of one vessel shift by the same factor, so the difference of the
logarithms of their frequencies is constant within its uncertainty, while that of
unrelated lines varies as much as the lines do. The log-likelihood ratio of the two
statements is the evidence; lines that do not vary give none. Bearings add the evidence
of agreeing against being anywhere on the compass.

Lines are compared in stretches of a few frames, each a small table of the lines heard
in it: matrix products count what pairs have in common and sum its squares, and after
that one sweep over the tables sums the terms of the likelihoods, which depend on the
spread of the pair. There is no table of all lines and times, which a day would fill
with nothing.

**Conventions.** Evidence is in nepers; a pair that is not named has none.

**References.** Kass & Raftery, "Bayes factors", JASA 90, 773-795 (1995), for the scale:
3 nepers is strong.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_deg

LINE_WANDER = 2e-5
"""Relative jitter of one machine's lines against each other."""

BEARING_WANDER_DEG = 3.0
"""Spread of the bearings of one vessel's lines, from multipath."""

_SHAPE_SHARE = 0.2
"""Difference of the Doppler curves of one vessel, relative to their spread: smoothed
lines lag, and horns waver."""

_LEAST_COMMON = 4
"""Common times below which two lines are not compared."""

_LEAST_SHARE = 0.5
"""Share of the shorter line that two lines must be heard together for their Doppler to
join them: what they have in common at their ends alone is that neither bends."""

_ANYWHERE = float(np.log(360.0 / np.sqrt(2.0 * np.pi)))
"""Logarithm of the compass over the width of a normal density of one degree, nepers."""

_STRETCH = 32
"""Times in one table of lines."""

_MOST_CELLS = 16_384
"""Cells, about, of the tables of pairs and times that are worked on at once."""

_MOST_WAITING = 32_768
"""Pairs of stretches, at least, that wait until they are added to the others."""


@dataclass(frozen=True)
class LineSamples:
    """Smoothed lines on a grid of frames: arrays of shape (point,), but for two."""

    first: IntArray
    """First point of each line, and the number of points at last, shape (line + 1,)."""
    frame: IntArray
    """Frame of the point, ascending within its line."""
    frequency_hz: FloatArray
    """Smoothed frequency in Hz."""
    frequency_variance: FloatArray
    """Its variance in Hz^2."""
    bearing_deg: FloatArray
    """Smoothed bearing in degree, unwrapped; nan if unknown."""
    bearing_variance: FloatArray
    """Its variance in degree^2."""
    correlation_samples: float
    """Samples over which the errors of a line are correlated, at least 1."""

    @property
    def n_points(self) -> IntArray:
        """Number of points of each line, shape (line,)."""
        return np.diff(self.first)

    @property
    def row(self) -> IntArray:
        """Row of the line that each point belongs to."""
        return np.repeat(np.arange(self.first.size - 1), self.n_points)


@dataclass(frozen=True)
class PairEvidence:
    """Evidence that two lines have one source; arrays of shape (pair,)."""

    low: IntArray
    """Row of the first line of the pair."""
    high: IntArray
    """Row of the second one, which is greater."""
    nepers: FloatArray
    """The evidence in nepers; pairs that are not here have none."""


@dataclass(frozen=True)
class _Stretch:
    """The lines heard in a few consecutive times; tables of shape (line, time)."""

    rows: IntArray
    """Rows of these lines, ascending, shape (line,)."""
    heard: FloatArray
    """1 where the line has a point, else 0."""
    shift: FloatArray
    """Logarithm of the frequency over the line's mean frequency; 0 without a point."""
    noise: FloatArray
    """Relative variance of the frequency; 1 without a point."""
    is_known: FloatArray | None
    """1 where the bearing is known, else 0; None if no line has one."""
    bearing_deg: FloatArray
    """Bearing in degree from -180 up to 180; 0 where unknown."""
    bearing_variance: FloatArray
    """Its variance with that of multipath, degree^2; 1 where unknown."""


def pair_evidence(samples: LineSamples) -> PairEvidence:
    """Return the evidence that two lines have one source, for pairs heard together."""
    pair, common = _in_common(samples)
    if not pair.size:
        return PairEvidence(pair, pair, np.zeros(0))
    n_lines = samples.first.size - 1
    together = common[0]
    square = common[3:] / together - (common[1:3] / together) ** 2
    spread = np.maximum(square, 0.0).sum(axis=0)
    sums = np.zeros((9, pair.size))
    for stretch in _stretches(samples):
        for rows in _portions(stretch):
            number = _pair_numbers(stretch, rows, n_lines)
            place = np.minimum(pair.searchsorted(number), pair.size - 1)
            is_pair = pair[place] == number
            terms = _terms(stretch, rows, np.where(is_pair, spread[place], 0.0))
            sums[:, place[is_pair]] += terms[:, is_pair]
    steps, (weight, first, second), apart = sums[0], sums[1:4], sums[4:7]
    mean = first / weight
    misfit = second - mean * first
    apart_misfit = apart[2] - 2.0 * mean * apart[1] + mean**2 * apart[0]
    doppler = 0.5 * (steps - misfit + apart_misfit)
    low, high = pair // n_lines, pair % n_lines
    # the end of one passage and the beginning of the next bend alike: hardly
    shorter = np.minimum(samples.n_points[low], samples.n_points[high])
    is_long = together >= _LEAST_SHARE * shorter
    evidence = np.where(is_long, doppler, np.minimum(doppler, 0.0))
    evidence += np.where(sums[8] >= _LEAST_COMMON, sums[7], 0.0)
    some = evidence != 0.0
    return PairEvidence(low[some], high[some], evidence[some] / samples.correlation_samples)


def _stretches(samples: LineSamples) -> Iterator[_Stretch]:
    """Yield the tables of a few times each, of lines that are long enough."""
    row, n_points = samples.row, samples.n_points
    points = np.flatnonzero((n_points >= _LEAST_COMMON)[row])
    _, time = np.unique(samples.frame[points], return_inverse=True)
    # by stretch, and in it by line and time as before
    order = np.argsort(time // _STRETCH, kind="stable")
    ends = np.bincount(time // _STRETCH).cumsum().tolist()
    total_hz = np.bincount(row, samples.frequency_hz, n_points.size)
    mean_hz = total_hz / np.maximum(n_points, 1)
    for begin, end in zip([0, *ends], ends, strict=False):
        at = points[order[begin:end]]
        rows, line = np.unique(row[at], return_inverse=True)
        frequency_hz = samples.frequency_hz[at]
        bearing_deg = wrap_deg(samples.bearing_deg[at])
        variance = samples.bearing_variance[at]
        is_known = np.isfinite(bearing_deg) & np.isfinite(variance)
        table = np.zeros((6, rows.size, _STRETCH))
        table[2] = table[5] = 1.0
        table[:, line, time[order[begin:end]] % _STRETCH] = (
            np.ones(at.size),
            np.log(frequency_hz / mean_hz[row[at]]),
            samples.frequency_variance[at] / frequency_hz**2,
            is_known,
            np.where(is_known, bearing_deg, 0.0),
            np.where(is_known, variance + 0.5 * BEARING_WANDER_DEG**2, 1.0),
        )
        heard, shift, noise, known, bearing, doubt = table
        yield _Stretch(rows, heard, shift, noise, known if is_known.any() else None, bearing, doubt)


def _in_common(samples: LineSamples) -> tuple[IntArray, FloatArray]:
    """Return the pairs of lines that are heard together, and sums over their times.

    The number of a pair is the row of its first line times the lines, plus that of the
    second; ascending, shape (pair,). The sums are times in common, shifts of either
    line in them, and their squares, shape (5, pair).
    """
    n_lines = samples.first.size - 1
    pair: IntArray = np.zeros(0, dtype=np.int64)
    sums: FloatArray = np.zeros((5, 0))
    waiting = [(pair, sums)]
    n_waiting = 0
    for stretch in _stretches(samples):
        heard, shift = stretch.heard.T, stretch.shift
        together = stretch.heard @ heard
        one, two = np.nonzero(np.triu(together, 1))
        shifted, squared = shift @ heard, shift**2 @ heard
        number = stretch.rows[one] * n_lines + stretch.rows[two]
        waiting.append((number, np.stack([
            together[one, two], shifted[one, two], shifted[two, one],
            squared[one, two], squared[two, one],
        ])))  # fmt: skip
        n_waiting += number.size
        if n_waiting > max(_MOST_WAITING, pair.size):
            pair, sums = _gathered(waiting)
            waiting, n_waiting = [(pair, sums)], 0
    pair, sums = _gathered(waiting)
    is_enough = sums[0] >= _LEAST_COMMON
    return pair[is_enough], sums[:, is_enough]


def _gathered(parts: Sequence[tuple[IntArray, FloatArray]]) -> tuple[IntArray, FloatArray]:
    """Add the sums of equal pairs."""
    numbers, sums = zip(*parts, strict=True)
    pair, place = np.unique(np.concatenate(numbers), return_inverse=True)
    added = [np.bincount(place, row, minlength=pair.size) for row in np.concatenate(sums, axis=1)]
    return pair, np.stack(added)


def _portions(stretch: _Stretch) -> Iterator[slice]:
    """Cut the lines of a stretch into parts whose pairs are few enough at a time."""
    n_lines, begin = stretch.rows.size, 0
    while begin < n_lines:
        end = begin + max(1, _MOST_CELLS // (_STRETCH * (n_lines - begin)))
        yield slice(begin, min(end, n_lines))
        begin = end


def _pair_numbers(stretch: _Stretch, rows: slice, n_lines: int) -> IntArray:
    """Return the numbers of the pairs of some lines with those after them.

    Shape (line, other); -1 where the other is not the later line.
    """
    own, others = stretch.rows[rows], stretch.rows[rows.start :]
    numbers = own[:, None] * n_lines + others
    return np.where(others > own[:, None], numbers, -1)


def _terms(stretch: _Stretch, rows: slice, spread: FloatArray) -> FloatArray:
    """Sum the terms of the likelihoods of some lines with all from their first on.

    Parameters
    ----------
    stretch
        The lines.
    rows
        The first lines of the pairs.
    spread
        Variances of both lines' shifts in all times in common, summed, shape
        (line, other).

    Returns
    -------
    FloatArray
        Sums over the times in common, shape (9, line, other): the logarithm of the two
        variances' ratio; weight, weight times shift and times its square, for one
        source, then for two; nepers of the bearings, and times with bearings.
    """
    after = slice(rows.start, None)
    noise = stretch.noise[rows, None] + stretch.noise[after]
    noise += (2.0 * LINE_WANDER**2 + _SHAPE_SHARE**2 * spread)[..., None]
    heard = stretch.heard[rows, None] * stretch.heard[after]
    off = stretch.shift[rows, None] - stretch.shift[after]
    apart = noise + spread[..., None]
    sums = np.zeros((9, *spread.shape))
    sums[0] = np.einsum("ijk,ijk->ij", heard, np.log(apart / noise))
    for row, variance in ((1, noise), (4, apart)):
        weight = heard / variance
        sums[row] = weight.sum(axis=-1)
        weight *= off
        sums[row + 1] = weight.sum(axis=-1)
        sums[row + 2] = np.einsum("ijk,ijk->ij", weight, off)
    if stretch.is_known is not None:
        known = stretch.is_known[rows, None] * stretch.is_known[after]
        turn = np.abs(stretch.bearing_deg[rows, None] - stretch.bearing_deg[after])
        turn = np.minimum(turn, 360.0 - turn)
        total = stretch.bearing_variance[rows, None] + stretch.bearing_variance[after]
        turn *= turn
        turn /= total
        turn += np.log(total)
        n_known = known.sum(axis=-1)
        sums[7] = _ANYWHERE * n_known - 0.5 * np.einsum("ijk,ijk->ij", known, turn)
        sums[8] = n_known
    return sums
