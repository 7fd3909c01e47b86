"""Harmonic families by an a-contrario comb with a free offset.

**Method.** Every pair of peaks (i, j) is taken as the ends of a comb of m spacings,
D = (f_j - f_i)/m. An interior tooth is hit when a peak lies within tau of it (and in
the pair's direction). Under the null hypothesis peaks are Poisson and the number of
hits is binomial, so that the number of tests times the tail probability is the
expected number of such combs by chance (NFA): NFA < eps needs no calibration.
Teeth are interpolated between the pair, never extrapolated, so the error of the
spacing does not grow with the tooth.

**Conventions.** Peaks ascend in frequency. ``log10_chance`` is log10(NFA).

**References.** Desolneux, Moisan & Morel, "From Gestalt Theory to Image Analysis: A
Probabilistic Approach" (2008), for the principle; Choi (2014) for constant
differences as the mark of a vessel.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation.kalman import wrap_deg

TOLERANCE_SIGMAS = 2.5
"""Half width of a tooth in standard deviations of a difference."""

_MOST_TRIES = 2
"""Combs that a free peak may try to found a family."""

_MOST_PROLONGATIONS = 8
"""Rounds in which a family grows beyond its first comb."""

_RATIO = 1.02
"""Step of the table of probabilities; rounding is upwards, to the safe side."""


@dataclass(frozen=True)
class CombRule:
    """What counts as a comb.

    Attributes
    ----------
    spacing_hz
        Least and greatest distance of two teeth.
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
    def tolerance_hz(self) -> float:
        """Half width of a tooth."""
        return float(TOLERANCE_SIGMAS * np.sqrt(2.0) * self.sigma_hz)


@dataclass(frozen=True)
class Comb:
    """A family: members, their teeth and the expected number by chance."""

    members: IntArray
    teeth: IntArray
    spacing_hz: float
    log10_chance: float


def comb_tests(
    frequency_hz: FloatArray, bearing_deg: FloatArray, rule: CombRule
) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
    """Test every pair of peaks and number of spacings as the ends of a comb.

    Returns
    -------
    tuple of arrays
        Lower peak, upper peak, spacings and log10 of the chance of every test.
    """
    lower, upper, spacings = _hypotheses(frequency_hz, bearing_deg, rule)
    hits = _interior_hits(frequency_hz, bearing_deg, rule, lower, upper, spacings)
    density = _density(frequency_hz, rule, lower, upper, hits)
    share = min(1.0, 2.0 * rule.bearing_window_deg / 360.0)
    if not np.isfinite(bearing_deg).any():
        share = 1.0
    probability = -np.expm1(-2.0 * rule.tolerance_hz * density * share)
    step = np.ceil(np.log(np.maximum(probability, 1e-6) / 1e-6) / np.log(_RATIO))
    chance = _log10_tail(rule.most_spacings)[step.astype(np.int64), spacings - 1, hits]
    chance = chance + np.log10(max(lower.size, 1))
    return lower, upper, spacings, chance


def find_combs(
    frequency_hz: FloatArray,
    bearing_deg: FloatArray,
    rule: CombRule,
    greatest_chance: float,
) -> tuple[list[Comb], FloatArray]:
    """Find the families among the peaks of one instant.

    Parameters
    ----------
    frequency_hz
        Frequencies in Hz, ascending.
    bearing_deg
        Bearings in degrees, nan where unknown.
    rule
        What counts as a comb.
    greatest_chance
        Families with a greater expected number by chance are not reported.

    Returns
    -------
    tuple
        The families, least likely by chance first and disjoint, and for every
        peak log10 of the least chance of any comb that contains it.
    """
    score = np.full(frequency_hz.size, np.inf)
    if frequency_hz.size < 3:
        return [], score
    lower, upper, spacings, chance = comb_tests(frequency_hz, bearing_deg, rule)
    keep = np.flatnonzero(chance < np.log10(greatest_chance))
    keep = keep[np.argsort(chance[keep], kind="stable")]
    np.minimum.at(score, lower[keep], chance[keep])
    np.minimum.at(score, upper[keep], chance[keep])
    combs: list[Comb] = []
    owner = np.full(frequency_hz.size, -1)
    # every test marks its free ends, so few of the many tests are looked at
    tries = np.zeros(frequency_hz.size, dtype=np.int64)
    while keep.size:
        k, keep = keep[0], keep[1:]
        ends = np.array([lower[k], upper[k]])
        tries[ends] += 1
        comb = _members(
            frequency_hz, bearing_deg, rule,
            (int(ends[0]), int(ends[1]), int(spacings[k])), float(chance[k]),
        )  # fmt: skip
        if (owner[comb.members] < 0).all():
            ends = np.concatenate([lower[keep], upper[keep]])
            steps = np.tile(
                (frequency_hz[upper[keep]] - frequency_hz[lower[keep]])
                / spacings[keep], 2,
            )  # fmt: skip
            comb = _prolonged(comb, frequency_hz, ends[owner[ends] < 0],
                              steps[owner[ends] < 0], rule)  # fmt: skip
            owner[comb.members] = len(combs)
            combs.append(comb)
        is_open = (owner < 0) & (tries < _MOST_TRIES)
        keep = keep[is_open[lower[keep]] | is_open[upper[keep]]]
    for comb in combs:
        score[comb.members] = np.minimum(score[comb.members], comb.log10_chance)
    return combs, score


def _prolonged(
    comb: Comb,
    frequency_hz: FloatArray,
    ends: IntArray,
    spacing_hz: FloatArray,
    rule: CombRule,
) -> Comb:
    """Add the ends of other significant combs that continue this one's teeth."""
    for _ in range(_MOST_PROLONGATIONS):
        spacing, _, _, _ = comb_fit(
            frequency_hz[comb.members], comb.teeth, rule.sigma_hz
        )
        middle = frequency_hz[comb.members].mean() - comb.teeth.mean() * spacing
        reach = (comb.teeth.max() - comb.teeth.min()) * 0.5 * spacing
        tooth = np.rint((frequency_hz[ends] - middle) / spacing)
        miss = np.abs(frequency_hz[ends] - middle - tooth * spacing)
        is_same = np.abs(spacing_hz / spacing - 1.0) * rule.most_spacings < 0.5
        centre = middle + comb.teeth.mean() * spacing
        is_near = np.abs(frequency_hz[ends] - centre) < 2.0 * reach + spacing
        fresh = np.flatnonzero(is_same & is_near & (miss <= rule.tolerance_hz))
        teeth = np.append(comb.teeth, tooth[fresh].astype(np.int64))
        members = np.append(comb.members, ends[fresh])
        # the first on a tooth stays: members before newcomers
        teeth, first = np.unique(teeth, return_index=True)
        if teeth.size == comb.teeth.size:
            break
        comb = Comb(members[first], teeth, spacing, comb.log10_chance)
    return Comb(
        comb.members, comb.teeth - comb.teeth.min(), comb.spacing_hz, comb.log10_chance
    )


def _hypotheses(
    frequency_hz: FloatArray, bearing_deg: FloatArray, rule: CombRule
) -> tuple[IntArray, IntArray, IntArray]:
    """List pairs and numbers of spacings, ordered by number of spacings."""
    lower, upper = np.triu_indices(frequency_hz.size, 1)
    span = frequency_hz[upper] - frequency_hz[lower]
    fits = (span >= 2.0 * rule.spacing_hz[0]) & (
        span <= rule.most_spacings * rule.spacing_hz[1]
    )
    if np.isfinite(bearing_deg).any():
        fits &= _agree(bearing_deg[lower], bearing_deg[upper], rule.bearing_window_deg)
    lower, upper, span = lower[fits], upper[fits], span[fits]
    counts = np.arange(2, rule.most_spacings + 1)
    spacing = span / counts[:, None]
    row, pair = np.nonzero(
        (spacing >= rule.spacing_hz[0]) & (spacing <= rule.spacing_hz[1])
    )
    return lower[pair], upper[pair], counts[row]


def _agree(a_deg: FloatArray, b_deg: FloatArray, window_deg: float) -> BoolArray:
    # an unknown bearing agrees with every other
    return ~(np.abs(wrap_deg(a_deg - b_deg)) > window_deg)


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
    base = frequency_hz[lower]
    spacing = (frequency_hz[upper] - base) / spacings
    base = base - rule.tolerance_hz
    has_directions = _spread_deg(bearing_deg) > rule.bearing_window_deg
    middle = bearing_deg[lower] + 0.5 * wrap_deg(
        bearing_deg[upper] - bearing_deg[lower]
    )
    hits = np.zeros(lower.size, dtype=np.int64)
    edges = np.searchsorted(spacings, np.arange(2, rule.most_spacings + 2))
    for inner, (start, stop) in enumerate(pairwise(edges), start=1):
        at = slice(start, stop)
        lowest = base[at, None] + spacing[at, None] * np.arange(1, inner + 1)
        peak, is_near = finder.nearest_above(lowest)
        if has_directions:
            _keep_direction(
                finder, lowest, peak, is_near, bearing_deg, middle[at],
                rule.bearing_window_deg,
            )  # fmt: skip
        hits[at] = np.count_nonzero(is_near, axis=1)
    return hits


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


def _keep_direction(
    finder: _PeakFinder,
    lowest: FloatArray,
    peak: IntArray,
    is_near: BoolArray,
    bearing_deg: FloatArray,
    middle_deg: FloatArray,
    window_deg: float,
) -> None:
    """Unmark teeth that no peak from the right direction hits."""
    row, column = np.nonzero(is_near)
    at = peak[row, column]
    while row.size:
        is_same = _agree(bearing_deg[at], middle_deg[row], window_deg)
        row, column, at = row[~is_same], column[~is_same], at[~is_same] + 1
        # a peak from elsewhere may hide the right one behind it
        more = finder.fence[at] <= lowest[row, column] + finder.width
        is_near[row[~more], column[~more]] = False
        row, column, at = row[more], column[more], at[more]


def _density(
    frequency_hz: FloatArray,
    rule: CombRule,
    lower: IntArray,
    upper: IntArray,
    hits: IntArray,
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


def _members(
    frequency_hz: FloatArray,
    bearing_deg: FloatArray,
    rule: CombRule,
    comb: tuple[int, int, int],
    chance: float,
) -> Comb:
    low, high, count = comb
    spacing = (frequency_hz[high] - frequency_hz[low]) / count
    tooth = np.rint((frequency_hz - frequency_hz[low]) / spacing)
    miss = np.abs(frequency_hz - frequency_hz[low] - tooth * spacing)
    middle = bearing_deg[low] + 0.5 * wrap_deg(bearing_deg[high] - bearing_deg[low])
    belongs = (miss <= rule.tolerance_hz) & (tooth >= 0) & (tooth <= count)
    belongs &= _agree(bearing_deg, np.full_like(bearing_deg, middle),
                      rule.bearing_window_deg)  # fmt: skip
    belongs[[low, high]] = True
    members = np.flatnonzero(belongs)
    order = np.lexsort((miss[members], tooth[members]))
    # where two peaks share a tooth the nearer one is the member
    is_first = np.append(True, np.diff(tooth[members][order]) > 0)
    members = np.sort(members[order][is_first])
    return Comb(members, tooth[members].astype(np.int64), float(spacing), chance)


def comb_fit(
    frequency_hz: FloatArray, teeth: IntArray, sigma_hz: float
) -> tuple[float, float, float, bool]:
    """Fit spacing and offset to the members of a comb by least squares.

    Parameters
    ----------
    frequency_hz
        Frequencies of the members in Hz.
    teeth
        Number of the tooth of each, counted from any of them.
    sigma_hz
        Standard deviation of a frequency in Hz.

    Returns
    -------
    tuple
        Spacing, its standard deviation, the lowest member's frequency modulo the
        spacing (all in Hz), and whether the teeth are multiples of the spacing.

    Examples
    --------
    >>> comb_fit(np.array([60.0, 80.0, 120.0]), np.array([0, 1, 3]), 0.01)[3]
    True
    >>> comb_fit(np.array([67.0, 87.0, 127.0]), np.array([0, 1, 3]), 0.01)[3]
    False
    """
    centred = teeth - teeth.mean()
    spread = float(np.sum(centred**2))
    spacing = float(np.sum(centred * frequency_hz) / spread)
    spacing_std = sigma_hz / np.sqrt(spread)
    number = float(frequency_hz.mean()) / spacing - float(teeth.mean())
    order = round(number)
    # variance of mean(f) - (order + mean tooth) * spacing
    lever = order + float(teeth.mean())
    std = np.hypot(sigma_hz / np.sqrt(teeth.size), lever * spacing_std)
    miss = abs(number - order) * spacing
    # a miss that chance would allow at every offset says nothing
    is_harmonic = miss <= TOLERANCE_SIGMAS * std < 0.15 * spacing
    offset = float(frequency_hz.min()) % spacing
    return spacing, float(spacing_std), offset, bool(is_harmonic)
