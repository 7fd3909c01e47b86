"""The a-contrario comb test: how unlikely by chance a row of equidistant peaks is.

**Method.** Every pair of peaks (i, j) is taken as the ends of a comb of m spacings,
D = (f_j - f_i)/m. An interior tooth is hit when a peak lies within tau of it (and in
the pair's direction). Under the null hypothesis peaks are Poisson and the number of
hits is binomial, so that the number of tests times the tail probability is the
expected number of such combs by chance (NFA): NFA < eps needs no calibration.
Teeth are interpolated between the pair, never extrapolated, so the error of the
spacing does not grow with the tooth.

**Conventions.** Peaks ascend in frequency. An unknown bearing (nan) agrees with every
other.

**References.** Desolneux, Moisan & Morel, "From Gestalt Theory to Image Analysis: A
Probabilistic Approach" (2008).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_deg

TOLERANCE_SIGMAS = 2.5
"""Half width of a tooth in standard deviations of a difference."""

_RATIO = 1.02
"""Step of the table of probabilities; rounding is upwards, to the safe side."""


@dataclass(frozen=True)
class CombRule:
    """What counts as a comb.

    Attributes
    ----------
    spacing_hz
        Least and greatest distance of two teeth; teeth that would overlap are not
        tried, since one peak would count for two.
    most_spacings
        Greatest number of spacings between the ends of a comb.
    sigma_hz
        Standard deviation of a peak's frequency.
    bearing_window_deg
        Greatest difference of bearings in a family.
    band_hz
        Width of the band in which the peaks were sought.
    """

    spacing_hz: tuple[float, float]
    most_spacings: int
    sigma_hz: float
    bearing_window_deg: float
    band_hz: float

    @property
    def least_spacing_hz(self) -> float:
        """Least distance at which teeth are disjoint, and not below the wanted one."""
        return max(self.spacing_hz[0], 2.0 * self.tolerance_hz)

    @property
    def tolerance_hz(self) -> float:
        """Half width of a tooth."""
        return float(TOLERANCE_SIGMAS * np.sqrt(2.0) * self.sigma_hz)


class CombTests(NamedTuple):
    """Pairs of peaks tested as the ends of a comb; arrays of shape (test,)."""

    lower: IntArray
    """Peak at the lower end."""
    upper: IntArray
    """Peak at the upper end."""
    spacings: IntArray
    """Number of spacings between them."""
    log10_chance: FloatArray
    """Logarithm of the chance of as many hits by noise, in any of the tests."""


def comb_tests(
    frequency_hz: FloatArray,
    bearing_deg: FloatArray,
    rule: CombRule,
    greatest_chance: float | None = None,
) -> CombTests:
    """Test every pair of peaks and number of spacings as the ends of a comb.

    Peaks ascend in frequency; bearings are nan where unknown. Tests that a rough count
    shows to be above ``greatest_chance`` are left out, which saves most of the work;
    they count as tests all the same.
    """
    lower, upper, spacings = _hypotheses(frequency_hz, bearing_deg, rule)
    n_tests = max(lower.size, 1)
    share = min(1.0, 2.0 * rule.bearing_window_deg / 360.0)
    if not np.isfinite(bearing_deg).any():
        share = 1.0
    tail = _log10_tail(rule.most_spacings)
    scale = 2.0 * rule.tolerance_hz * share
    if greatest_chance is not None and lower.size:
        # in the least density that `_density` can give
        step = _tail_step(np.array(scale * frequency_hz.size / rule.band_hz))
        is_rare = tail[step] + np.log10(n_tests) < np.log10(greatest_chance)
        needed = np.where(is_rare.any(axis=1), is_rare.argmax(axis=1), tail.shape[2])
        most = _most_hits(frequency_hz, rule, lower, upper, spacings)
        keep = most >= needed[spacings - 1]
        lower, upper, spacings = lower[keep], upper[keep], spacings[keep]
    if not lower.size:
        return CombTests(lower, upper, spacings, np.zeros(0))
    hits = _interior_hits(frequency_hz, bearing_deg, rule, lower, upper, spacings)
    density = _density(frequency_hz, rule, lower, upper, hits)
    chance = tail[_tail_step(scale * density), spacings - 1, hits]
    return CombTests(lower, upper, spacings, chance + np.log10(n_tests))


def _tail_step(expected: FloatArray) -> IntArray:
    """Row of the table of tails for an expected number of peaks in a tooth."""
    probability = np.maximum(-np.expm1(-expected), 1e-6)
    step = np.ceil(np.log(probability / 1e-6) / np.log(_RATIO))
    return np.asarray(step, dtype=np.int64)


def _most_hits(
    frequency_hz: FloatArray, rule: CombRule, lower: IntArray, upper: IntArray, spacings: IntArray
) -> IntArray:
    """Upper bound of the interior hits: teeth rounded to cells, all directions."""
    step = rule.tolerance_hz
    low = float(frequency_hz[0]) - 3.0 * step
    cells = ((frequency_hz - low) / step).astype(np.int64)
    is_near = np.zeros(int((frequency_hz[-1] - low) / step) + 4, dtype=np.int8)
    # a tooth within the tolerance of a peak is in its cell or in the next one
    for shift in (-1, 0, 1):
        is_near[cells + shift] = 1
    place = (frequency_hz - low) / step
    cell, spacing = place[lower], (place[upper] - place[lower]) / spacings
    hits = np.zeros(spacings.size, dtype=np.int8)
    for tests in _teeth(spacings):
        cell[tests] += spacing[tests]
        hits[tests] += is_near.take(cell[tests].astype(np.intp))
    return hits


def _hypotheses(
    frequency_hz: FloatArray, bearing_deg: FloatArray, rule: CombRule
) -> tuple[IntArray, IntArray, IntArray]:
    """List pairs and numbers of spacings, ordered by number of spacings."""
    lower, upper = _pairs(frequency_hz.size)
    span = frequency_hz[upper] - frequency_hz[lower]
    fits = (span >= 2.0 * rule.least_spacing_hz) & (span <= rule.most_spacings * rule.spacing_hz[1])
    if np.isfinite(bearing_deg).any():
        circle = bearing_deg % 360.0
        fits &= _agree_on_circle(circle[lower], circle[upper], rule.bearing_window_deg)
    lower, upper, span = lower[fits], upper[fits], span[fits]
    counts = np.arange(2, rule.most_spacings + 1)
    spacing = span / counts[:, None]
    row, pair = np.nonzero((spacing >= rule.least_spacing_hz) & (spacing <= rule.spacing_hz[1]))
    return lower[pair], upper[pair], counts[row]


@lru_cache(maxsize=16)
def _pairs(n_peaks: int) -> tuple[IntArray, IntArray]:
    """List the pairs of peaks; most frames have as many as the one before."""
    lower, upper = np.triu_indices(n_peaks, 1)
    lower.setflags(write=False)
    upper.setflags(write=False)
    return lower, upper


def agree(a_deg: FloatArray, b_deg: FloatArray, window_deg: float) -> BoolArray:
    """Tell which bearings agree; an unknown one agrees with every other."""
    return ~(np.abs(wrap_deg(a_deg - b_deg)) > window_deg)


def _agree_on_circle(a_deg: FloatArray, b_deg: FloatArray, window_deg: float) -> BoolArray:
    """Tell the same of bearings in [0, 360], without a division."""
    apart = np.abs(a_deg - b_deg)
    return ~((apart > window_deg) & (apart < 360.0 - window_deg))


def _spread_deg(bearing_deg: FloatArray) -> float:
    """Return the width of the sector that holds all known bearings."""
    known = bearing_deg[np.isfinite(bearing_deg)]
    if known.size == 0:
        return 0.0
    turn = wrap_deg(known - known[0])
    return float(turn.max() - turn.min())


def _interior_hits(
    frequency_hz: FloatArray,
    bearing_deg: FloatArray,
    rule: CombRule,
    lower: IntArray,
    upper: IntArray,
    spacings: IntArray,
) -> IntArray:
    finder = _PeakFinder(frequency_hz, rule.tolerance_hz)
    spacing = (frequency_hz[upper] - frequency_hz[lower]) / spacings
    lowest = frequency_hz[lower] - rule.tolerance_hz
    circle, middle = bearing_deg % 360.0, np.empty(0)
    if _spread_deg(bearing_deg) > rule.bearing_window_deg:
        middle = circle[lower] + 0.5 * wrap_deg(circle[upper] - circle[lower])
        middle %= 360.0
    hits = np.zeros(spacings.size, dtype=np.int64)
    for tests in _teeth(spacings):
        lowest[tests] += spacing[tests]
        peak, is_near = finder.nearest_above(lowest[tests])
        if middle.size:
            at = np.flatnonzero(is_near)
            is_near[at] = _has_direction(
                finder, lowest[tests][at], peak[at], circle, middle[tests][at],
                rule.bearing_window_deg,
            )  # fmt: skip
        hits[tests] += is_near
    return hits


def _teeth(spacings: IntArray) -> Iterator[slice]:
    """Yield the tests that have a first interior tooth, then those with a second ...

    Tests are ordered by their numbers of spacings, so that they are the last ones.
    """
    for tooth in range(1, int(spacings[-1])):
        yield slice(int(spacings.searchsorted(tooth, "right")), None)


class _PeakFinder:
    """Finds, for many values, the first of few peaks that is not below."""

    def __init__(self, frequency_hz: FloatArray, tolerance_hz: float) -> None:
        low, high = float(frequency_hz[0]), float(frequency_hz[-1])
        self.width = 2.0 * tolerance_hz
        self.fence = np.append(frequency_hz, np.inf)
        step = max(tolerance_hz, (high - low) / 20_000.0)
        edges = np.arange(low - self.width, high + 2.0 * step, step)
        self.table = np.searchsorted(self.fence, edges)
        self.scale, self.origin = 1.0 / step, float(edges[0])

    def nearest_above(self, lowest: FloatArray) -> tuple[IntArray, BoolArray]:
        """Return the peak at or above each value, and whether it is in the tooth."""
        cell = ((lowest - self.origin) * self.scale).astype(np.intp)
        peak = self.table[cell]
        found = self.fence[peak]
        is_behind = found < lowest
        while is_behind.any():
            peak += is_behind
            found = self.fence[peak]
            is_behind = found < lowest
        return peak, found <= lowest + self.width


def _has_direction(
    finder: _PeakFinder,
    lowest: FloatArray,
    peak: IntArray,
    bearing_deg: FloatArray,
    middle_deg: FloatArray,
    window_deg: float,
) -> BoolArray:
    """Tell which teeth, hit by a peak, are hit by one from the right direction."""
    is_hit = _agree_on_circle(bearing_deg[peak], middle_deg, window_deg)
    left = np.flatnonzero(~is_hit)
    peak = peak[left]
    while left.size:
        # a peak from elsewhere may hide the right one behind it
        peak = peak + 1
        more = finder.fence[peak] <= lowest[left] + finder.width
        left, peak = left[more], peak[more]
        is_same = _agree_on_circle(bearing_deg[peak], middle_deg[left], window_deg)
        is_hit[left[is_same]] = True
        left, peak = left[~is_same], peak[~is_same]
    return is_hit


def _density(
    frequency_hz: FloatArray, rule: CombRule, lower: IntArray, upper: IntArray, hits: IntArray
) -> FloatArray:
    """Density of peaks, per Hz: of the band, or of the comb's own span if denser.

    Real lines crowd at low frequencies. The hits themselves are not counted in the
    span, or a complete comb would hide itself.
    """
    span = frequency_hz[upper] - frequency_hz[lower]
    others = np.maximum(upper - lower - 1 - hits, 0)
    return np.asarray(np.maximum(frequency_hz.size / rule.band_hz, others / span))


@lru_cache(maxsize=8)
def _log10_tail(most_spacings: int) -> FloatArray:
    """log10 P(Bin(n, q) >= k) at [step of q, n, k] for n < ``most_spacings``."""
    from scipy.special import betainc

    steps = int(np.ceil(np.log(1e6) / np.log(_RATIO))) + 1
    q = np.minimum(1e-6 * _RATIO ** np.arange(steps), 1.0)[:, None, None]
    n = np.arange(most_spacings)[None, :, None]
    k = np.arange(most_spacings)[None, None, :]
    tail = betainc(np.maximum(k, 1), np.maximum(n - k + 1, 1), q)
    table = np.log10(np.maximum(tail, 1e-300))
    table[:, :, 0] = 0.0
    return np.asarray(table)
