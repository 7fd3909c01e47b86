"""Harmonic families: disjoint combs that chance does not explain.

**Method.** The least likely comb by chance founds a family; ends of other significant
combs that lie on its teeth prolong it; the rest is searched again. Spacing and offset
are fitted by least squares, which also tells a true harmonic series, whose lines are
multiples of the spacing, from a progression with an offset.

**Conventions.** Peaks ascend in frequency. ``log10_chance`` is log10(NFA).

**References.** Desolneux, Moisan & Morel (2008) for the test; Choi (2014) for constant
differences as the mark of a vessel.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uwtrack_cli.data.base import FloatArray, IntArray
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.lines.families.comb_test import TOLERANCE_SIGMAS, CombRule, agree, comb_tests

_MOST_TRIES = 2
"""Combs that a free peak may try to found a family."""

_MOST_PROLONGATIONS = 8
"""Rounds in which a family grows beyond its first comb."""


@dataclass(frozen=True)
class Comb:
    """A family: members, their teeth and the expected number by chance."""

    members: IntArray
    """Positions of the peaks that belong to it, shape (member,)."""
    teeth: IntArray
    """Number of each member's tooth from the lowest, shape (member,)."""
    spacing_hz: float
    """Distance of neighbouring teeth, Hz."""
    log10_chance: float
    """Logarithm of the expected number of such combs by chance."""


class CombFit(NamedTuple):
    """Spacing and offset of a comb, by least squares."""

    spacing_hz: float
    """Distance of neighbouring teeth, Hz."""
    spacing_std_hz: float
    """Its standard deviation, Hz."""
    offset_hz: float
    """Frequency of the lowest member modulo the spacing, Hz."""
    is_harmonic: bool
    """Whether the teeth are multiples of the spacing."""


def find_combs(
    frequency_hz: FloatArray, bearing_deg: FloatArray, rule: CombRule, greatest_chance: float
) -> tuple[list[Comb], FloatArray]:
    """Find the families among the peaks of one instant.

    Peaks ascend in frequency, Hz; bearings, degrees, are nan where unknown. Returns the
    families whose expected number by chance is not above the greatest, least likely
    ones first and disjoint, and for every peak log10 of the least chance of any comb
    that contains it.
    """
    score = np.full(frequency_hz.size, np.inf)
    if frequency_hz.size < 3:
        return [], score
    lower, upper, spacings, chance = comb_tests(frequency_hz, bearing_deg, rule, greatest_chance)
    keep = np.flatnonzero(chance < np.log10(greatest_chance))
    keep = keep[np.argsort(chance[keep], kind="stable")]
    np.minimum.at(score, lower[keep], chance[keep])
    np.minimum.at(score, upper[keep], chance[keep])
    combs: list[Comb] = []
    owner = np.full(frequency_hz.size, -1)
    # every test marks its free ends, so few of the many tests are looked at
    tries = np.zeros(frequency_hz.size, dtype=np.int64)
    at = 0
    while at < keep.size:
        k, at = keep[at], at + 1
        ends = np.array([lower[k], upper[k]])
        tries[ends] += 1
        is_news = bool((tries[ends] == _MOST_TRIES).any())
        if (owner[ends] < 0).all():
            comb = _members(
                frequency_hz, bearing_deg, rule,
                (int(ends[0]), int(ends[1]), int(spacings[k])), float(chance[k]),
            )  # fmt: skip
            if (owner[comb.members] < 0).all():
                rest = keep[at:]
                ends = np.concatenate([lower[rest], upper[rest]])
                steps = np.tile(
                    (frequency_hz[upper[rest]] - frequency_hz[lower[rest]]) / spacings[rest], 2
                )
                is_free = owner[ends] < 0
                comb = _prolonged(comb, frequency_hz, ends[is_free], steps[is_free], rule)
                owner[comb.members] = len(combs)
                combs.append(comb)
                is_news = True
        if is_news:
            is_open = (owner < 0) & (tries < _MOST_TRIES)
            keep = keep[at:]
            keep, at = keep[is_open[lower[keep]] | is_open[upper[keep]]], 0
    for comb in combs:
        score[comb.members] = np.minimum(score[comb.members], comb.log10_chance)
    return combs, score


def _prolonged(
    comb: Comb, frequency_hz: FloatArray, ends: IntArray, spacing_hz: FloatArray, rule: CombRule
) -> Comb:
    """Add the ends of other significant combs that continue this one's teeth."""
    for _ in range(_MOST_PROLONGATIONS):
        own_hz = frequency_hz[comb.members]
        spacing = comb_fit(own_hz, comb.teeth, rule.sigma_hz).spacing_hz
        mean_tooth = float(comb.teeth.sum()) / comb.teeth.size
        middle = float(own_hz.sum()) / own_hz.size - mean_tooth * spacing
        reach = (comb.teeth.max() - comb.teeth.min()) * 0.5 * spacing
        ends_hz = frequency_hz[ends]
        tooth = np.rint((ends_hz - middle) / spacing)
        miss = np.abs(ends_hz - middle - tooth * spacing)
        is_same = np.abs(spacing_hz / spacing - 1.0) * rule.most_spacings < 0.5
        centre = middle + mean_tooth * spacing
        is_near = np.abs(ends_hz - centre) < 2.0 * reach + spacing
        fresh = np.flatnonzero(is_same & is_near & (miss <= rule.tolerance_hz))
        teeth = np.append(comb.teeth, tooth[fresh].astype(np.int64))
        members = np.append(comb.members, ends[fresh])
        # the first on a tooth stays: members before newcomers
        teeth, first = np.unique(teeth, return_index=True)
        if teeth.size == comb.teeth.size:
            break
        comb = Comb(members[first], teeth, spacing, comb.log10_chance)
    return Comb(comb.members, comb.teeth - comb.teeth.min(), comb.spacing_hz, comb.log10_chance)


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
    belongs &= agree(bearing_deg, np.full_like(bearing_deg, middle), rule.bearing_window_deg)
    belongs[[low, high]] = True
    members = np.flatnonzero(belongs)
    order = np.lexsort((miss[members], tooth[members]))
    # where two peaks share a tooth the nearer one is the member
    is_first = np.append(True, np.diff(tooth[members][order]) > 0)
    members = np.sort(members[order][is_first])
    return Comb(members, tooth[members].astype(np.int64), float(spacing), chance)


def comb_fit(frequency_hz: FloatArray, teeth: IntArray, sigma_hz: float) -> CombFit:
    """Fit spacing and offset to the members of a comb by least squares.

    Teeth are counted from any of them; ``sigma_hz`` is the deviation of a frequency.

    Examples
    --------
    >>> comb_fit(np.array([60.0, 80.0, 120.0]), np.array([0, 1, 3]), 0.01).is_harmonic
    True
    >>> comb_fit(np.array([67.0, 87.0, 127.0]), np.array([0, 1, 3]), 0.01).is_harmonic
    False
    """
    middle = float(teeth.sum()) / teeth.size
    centred = teeth - middle
    spread = float(np.sum(centred**2))
    spacing = float(np.sum(centred * frequency_hz) / spread)
    spacing_std = sigma_hz / np.sqrt(spread)
    number = float(frequency_hz.sum()) / teeth.size / spacing - middle
    order = round(number)
    # variance of mean(f) - (order + mean tooth) * spacing
    lever = order + middle
    std = np.hypot(sigma_hz / np.sqrt(teeth.size), lever * spacing_std)
    miss = abs(number - order) * spacing
    # a miss that chance would allow at every offset says nothing
    is_harmonic = miss <= TOLERANCE_SIGMAS * std < 0.15 * spacing
    offset = float(frequency_hz.min()) % spacing
    return CombFit(spacing, float(spacing_std), offset, bool(is_harmonic))
