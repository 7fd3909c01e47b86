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

import numpy as np

from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.estimation.kalman import wrap_deg

TOLERANCE_SIGMAS = 2.5
"""Half width of a tooth in standard deviations of a difference."""


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
        return TOLERANCE_SIGMAS * np.sqrt(2.0) * self.sigma_hz


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
    has_bearing = bool(np.isfinite(bearing_deg).any())
    share = min(1.0, 2.0 * rule.bearing_window_deg / 360.0) if has_bearing else 1.0
    density = frequency_hz.size / rule.band_hz
    hit_probability = 1.0 - np.exp(-2.0 * rule.tolerance_hz * density * share)
    table = _log10_tail(rule.most_spacings, round(float(hit_probability), 12))
    chance = table[spacings - 1, hits] + np.log10(max(lower.size, 1))
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
    combs: list[Comb] = []
    is_used = np.zeros(frequency_hz.size, dtype=bool)
    for k in keep:
        if is_used[lower[k]] and is_used[upper[k]]:
            continue
        comb = _members(
            frequency_hz, bearing_deg, rule,
            (int(lower[k]), int(upper[k]), int(spacings[k])), float(chance[k]),
        )  # fmt: skip
        score[comb.members] = np.minimum(score[comb.members], chance[k])
        if not is_used[comb.members].any():
            combs.append(comb)
        is_used[comb.members] = True
    return combs, score


def _hypotheses(
    frequency_hz: FloatArray, bearing_deg: FloatArray, rule: CombRule
) -> tuple[IntArray, IntArray, IntArray]:
    lower, upper = np.triu_indices(frequency_hz.size, 1)
    span = frequency_hz[upper] - frequency_hz[lower]
    fits = (span >= 2.0 * rule.spacing_hz[0]) & (
        span <= rule.most_spacings * rule.spacing_hz[1]
    )
    fits &= _agree(bearing_deg[lower], bearing_deg[upper], rule.bearing_window_deg)
    lower, upper, span = lower[fits], upper[fits], span[fits]
    counts = np.arange(2, rule.most_spacings + 1)
    spacing = span[:, None] / counts
    pair, column = np.nonzero(
        (spacing >= rule.spacing_hz[0]) & (spacing <= rule.spacing_hz[1])
    )
    return lower[pair], upper[pair], counts[column]


def _agree(a_deg: FloatArray, b_deg: FloatArray, window_deg: float) -> BoolArray:
    # an unknown bearing agrees with every other
    return ~(np.abs(wrap_deg(a_deg - b_deg)) > window_deg)


def _interior_hits(
    frequency_hz: FloatArray,
    bearing_deg: FloatArray,
    rule: CombRule,
    lower: IntArray,
    upper: IntArray,
    spacings: IntArray,
) -> IntArray:
    test = np.repeat(np.arange(lower.size), spacings - 1)
    first = np.cumsum(spacings - 1) - (spacings - 1)
    tooth = np.arange(test.size) - np.repeat(first, spacings - 1) + 1
    spacing = (frequency_hz[upper] - frequency_hz[lower]) / spacings
    place = frequency_hz[lower][test] + tooth * spacing[test]
    is_hit = np.zeros(test.size, dtype=bool)
    pair_bearing = bearing_deg[lower] + 0.5 * wrap_deg(
        bearing_deg[upper] - bearing_deg[lower]
    )
    candidate = np.searchsorted(frequency_hz, place - rule.tolerance_hz)
    open_ = np.arange(test.size)
    while open_.size:
        inside = candidate[open_] < frequency_hz.size
        open_ = open_[inside]
        peak = candidate[open_]
        near = frequency_hz[peak] <= place[open_] + rule.tolerance_hz
        open_, peak = open_[near], peak[near]
        same = _agree(
            bearing_deg[peak], pair_bearing[test[open_]], rule.bearing_window_deg
        )
        is_hit[open_[same]] = True
        open_ = open_[~same]
        candidate[open_] += 1
    return np.bincount(test[is_hit], minlength=lower.size)


@lru_cache(maxsize=256)
def _log10_tail(most_spacings: int, probability: float) -> FloatArray:
    """log10 P(Bin(n, q) >= k) at [n, k] for n < ``most_spacings``."""
    from scipy.stats import binom

    n = np.arange(most_spacings)[:, None]
    k = np.arange(most_spacings)[None, :]
    with np.errstate(divide="ignore"):
        table = np.asarray(binom.logsf(k - 1, n, probability)) / np.log(10.0)
    table[:, 0] = 0.0
    return table


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
